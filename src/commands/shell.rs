//! `depthloom completions` and `depthloom man`.

use clap::CommandFactory;

use crate::args::Cli;
use crate::exit::{Exit, Stop};
use crate::streams::print;

/// Prints the completion script of a shell.
pub fn completions(shell: clap_complete::Shell) -> Result<Exit, Stop> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "depthloom", &mut script);
    print(&script)?;
    Ok(Exit::Whole)
}

/// Prints the manual page.
pub fn man() -> Result<Exit, Stop> {
    let mut page = Vec::new();
    let rendered = clap_mangen::Man::new(Cli::command()).render(&mut page);
    rendered.map_err(|error| Stop::because(Exit::Engine, "failed to write the manual page", &error))?;
    print(&page)?;
    Ok(Exit::Whole)
}
