//! The tables, samples and page of a run.

pub(crate) mod frames;
pub(crate) mod page;
pub(crate) mod report;
pub(crate) mod samples;
