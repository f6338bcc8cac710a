//! What a recording has and lacks, before anything is computed of it: scores, timings, warnings, damage, parameters.
//! And the scores of the paper, to compare with.

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
