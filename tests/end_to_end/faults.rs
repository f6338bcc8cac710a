//! Faults found by reviews, each test named `fault_<number>_<behaviour>` with the number in that review.

mod analysis;
mod folders;
mod language;
mod learning;
mod limits;
mod networks;
mod recordings;
mod runs;
mod signals;
mod small;
