//! Reports of recordings made here: the files against what was recorded.

mod fixture;
mod page;
mod report;
mod unchanged;
