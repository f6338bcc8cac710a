//! The inputs of analyses: scores, timings, warnings, damage and parameters of a recording, and the published scores of
//! the paper.

pub(crate) mod condition;
pub(crate) mod frame_choice;
pub(crate) mod maps;
pub(crate) mod paper;
pub(crate) mod parameters;
pub(crate) mod reading;
pub(crate) mod rows;
pub(crate) mod timings;
pub(crate) mod unscored;
pub(crate) mod warnings;
