//! The `depthloom` command: parses, assembles the registry, calls the engine, prints.

mod args;
mod commands;
mod diagnostics;
mod environment;
mod exit;
mod memory;
mod models;
mod panics;
mod progress;
mod registry;
mod run_folder;
mod signals;
mod streams;

use std::io;
use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use crate::args::{Cli, Command};
use crate::exit::{Exit, Stop};

fn main() -> ExitCode {
    signals::outlive_file_size_limit();
    let exit = panics::watched(program).unwrap_or_else(|Stop { exit, message, remedy }| {
        diagnostics::print_stop(&message, remedy.as_deref());
        exit
    });
    ExitCode::from(exit as u8)
}

fn program() -> Result<Exit, Stop> {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return match error.print() {
                Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                    Err(Stop::because(Exit::Engine, "failed to print", &error))
                }
                Ok(()) | Err(_) => Ok(Exit::Whole),
            };
        }
        Err(error) => {
            // The exit code tells it where standard error cannot.
            let _ = error.print();
            return Ok(Exit::Before);
        }
    };
    diagnostics::set_colour(cli.color);
    match cli.command {
        Command::Run(args) => commands::run::run(&args),
        Command::Check(args) => commands::check::check(&args),
        Command::Plan(args) => commands::plan::plan(&args),
        Command::Graph(args) => commands::plan::graph(&args),
        Command::Report(args) => commands::report::report(&args),
        Command::Timings(args) => commands::report::timings(&args),
        Command::Nodes(args) => commands::nodes::nodes(&args),
        Command::Synth(args) => commands::synth::synth(&args),
        Command::Doctor(args) => commands::doctor::doctor(args.json),
        Command::Schema => commands::nodes::schema(),
        Command::Completions { shell } => commands::shell::completions(shell),
        Command::Man => commands::shell::man(),
    }
}
