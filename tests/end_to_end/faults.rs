//! Faults found in released versions, each named `fault_<number>_<what holds now>` after the review that found it.

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
