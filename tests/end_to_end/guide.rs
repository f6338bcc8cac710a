//! The guide (`docs/`): its commands are run and their output is compared, its links are checked, its reference is
//! generated from the program, and mdBook builds it.
//!
//! CONTRIBUTING.md, "The guide", describes the comments by which a page declares commands and expected output.
//! `DEPTHLOOM_WRITE_GUIDE=1` writes the generated parts: the reference, output that the pages show in full, figures,
//! screenshots and blocks of numbers.

mod beyond;
mod links;
mod numbers;
mod page;
mod pictures;
mod reference;
mod run;

use std::path::PathBuf;

use crate::support::workspace;

/// The folder of the book.
fn book() -> PathBuf {
    workspace().join("docs")
}

/// Whether to write generated parts instead of comparing them.
fn writes() -> bool {
    std::env::var_os("DEPTHLOOM_WRITE_GUIDE").is_some_and(|value| !value.is_empty() && value != "0")
}
