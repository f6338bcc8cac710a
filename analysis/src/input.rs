//! What a recording has, and what it lacks: its condition, warnings, maps and frames without a score; and the paper's numbers to compare with.

pub(crate) mod condition;
pub(crate) mod frame_choice;
pub(crate) mod maps;
pub(crate) mod paper;
pub(crate) mod unscored;
pub(crate) mod warnings;
