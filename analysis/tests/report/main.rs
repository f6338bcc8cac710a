//! Reports of synthetic recordings, compared with the recorded values.

mod fixture;
mod page;
mod report;
mod unchanged;
