//! Commands that compute tables and figures of recorded runs.

pub(crate) mod analyse;
pub(crate) mod compare;
pub(crate) mod explain;
pub(crate) mod figure;
pub(crate) mod report;
pub(crate) mod samples;
pub(crate) mod table;
