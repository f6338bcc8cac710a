//! The `depthloom` command: parses, assembles the registry, calls the engine, prints.

mod args;
mod commands;
mod diagnostics;
mod environment;
mod exit;
mod progress;
mod registry;
mod run_folder;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use crate::args::{Cli, Command};
use crate::exit::{Exit, Stop};

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // A reader that closed the pipe early (`--help | head`) is no error.
            let _ = error.print();
            let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            return ExitCode::from(if asked { Exit::Whole as u8 } else { Exit::Before as u8 });
        }
    };
    diagnostics::set_colour(cli.color);
    let ended = match cli.command {
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
    };
    match ended {
        Ok(exit) => ExitCode::from(exit as u8),
        Err(Stop { exit, message, remedy }) => {
            diagnostics::print_stop(&message, remedy.as_deref());
            ExitCode::from(exit as u8)
        }
    }
}
