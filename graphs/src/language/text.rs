//! Text: files, trees with positions, one document out of `extends`, graph files and the environment, and diagnostics.
//! Knows no kind.

pub(crate) mod diagnostics;
pub(crate) mod environment;
pub(crate) mod files;
pub(crate) mod glob;
pub(crate) mod merge;
pub(crate) mod names;
pub(crate) mod parse;
pub(crate) mod paths;
pub(crate) mod resolved;
pub(crate) mod run_files;
pub(crate) mod source_file;
pub(crate) mod tree;
pub(crate) mod word;
