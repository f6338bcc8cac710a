//! The commands, one file each (two where they are two views of one thing).

pub mod check;
pub mod check_data;
pub mod compare;
pub mod completions;
pub mod data;
pub mod doctor;
pub mod dora;
pub mod explain;
pub mod export;
pub mod figure;
pub mod info;
pub mod man;
pub mod new;
pub mod nodes;
pub mod onnx;
pub mod page;
pub mod plan;
pub mod recover;
pub mod replay;
pub mod report;
pub mod run;
pub mod runs;
pub mod samples;
pub mod synth;
pub mod table;
