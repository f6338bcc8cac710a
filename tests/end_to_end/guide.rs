//! The guide (`docs/`): its commands are run and their outputs compared, its links lead somewhere, its reference is
//! what the program says, and it is a book.
//!
//! How a page says what is run, with what, and what comes of it: CONTRIBUTING.md, "The guide".
//! `DEPTHLOOM_WRITE_GUIDE=1` writes what is generated: the reference, and the outputs that the pages show in whole.

mod links;
mod page;
mod reference;
mod run;

use std::path::PathBuf;

use crate::support::workspace;

/// Where the book lies.
fn book() -> PathBuf {
    workspace().join("docs")
}

/// Whether generated parts are to be written, not compared.
fn writes() -> bool {
    std::env::var_os("DEPTHLOOM_WRITE_GUIDE").is_some_and(|told| !told.is_empty() && told != "0")
}
