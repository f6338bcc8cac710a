//! depthloom: reproducible depth-estimation experiments from one YAML file.
//!
//! This crate is the command line, as a library: your own program adds node and source kinds to the
//! [`registry()`] and passes it to [`main()`]. It then has every command, with its own kinds in schema, reference,
//! checks and completion:
//!
//! ```no_run
//! use std::process::ExitCode;
//!
//! fn main() -> ExitCode {
//!     let registry = depthloom::registry(); // .node::<MyNode>().source::<MySource>()
//!     depthloom::main(registry)
//! }
//! ```
//!
//! What a kind consists of (values, ports, the contracts) is in [`graphs`]; `examples/own-node` is such a program.

pub use depthloom_graphs as graphs;
pub use memory::ExitIfRefused;

mod allow_exec;
mod args;
mod check_data;
mod command_line;
mod commands;
mod completion;
mod execution;
mod experiment;
mod memory;
mod output;
mod panics;
mod process_limits;
mod results;
mod signals;
mod truths;

use std::io;

use clap::error::ErrorKind;
use depthloom_graphs::Registry;
use depthloom_terminal::{CliError, ExitCode};

use crate::args::Command;
use crate::output::diagnostics;

/// A run and its report need 300 to 400 KiB.
const STACK_BYTES: usize = 768 << 10;

/// The kinds that depthloom comes with.
#[must_use]
pub fn registry() -> Registry {
    depthloom_learning::register(depthloom_nodes::registry()).source::<depthloom_recording::Mcap>()
}

/// The whole program: runs the command in the arguments of the process with the kinds of `registry`, and returns the
/// exit code.
///
/// If a kind is registered twice, the program ends at once with exit code 2.
///
/// It takes the process's signals, its panic hook and its standard streams; a process calls it once, from its `main`.
#[must_use]
#[expect(clippy::needless_pass_by_value, reason = "a process calls it once, and needs its kinds no longer")]
pub fn main(registry: Registry) -> std::process::ExitCode {
    depthloom_runs::environment::mark_start();
    memory::keep_freed();
    grow_stack();
    signals::outlive_file_size_limit();
    let as_json = command_line::asks_for_json(std::env::args_os());
    let exit = panics::watched(as_json, || program(&registry, as_json)).unwrap_or_else(|stop| {
        diagnostics::print_stop(&stop);
        print_error_json(as_json, &stop);
        stop.exit
    });
    std::process::ExitCode::from(exit as u8)
}

/// Makes the stack of this thread as large as the program needs it.
///
/// The stack of a process's first thread grows on demand: where the system refuses memory at such a moment, it ends the
/// process with SIGSEGV. A thread with a stack of its own would be one more than some systems allow.
#[inline(never)]
fn grow_stack() {
    std::hint::black_box(std::mem::MaybeUninit::<[u8; STACK_BYTES]>::uninit());
}

/// With `--json` errors are JSON, too; they are printed to standard error in any case.
fn print_error_json(as_json: bool, stop: &CliError) {
    if as_json {
        // If standard output cannot be written, only the exit code reports the error.
        let _ = output::print(&diagnostics::Failed::from(stop));
    }
}

fn program(registry: &Registry, as_json: bool) -> Result<ExitCode, CliError> {
    registry
        .check()
        .map_err(|clash| CliError::usage(clash.to_string(), "register it once, or rename one of the two"))?;
    if completion::answer(|| command_line::own_command(registry))? {
        return Ok(ExitCode::Success);
    }
    let cli = match command_line::parse(registry) {
        Ok(cli) => cli,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return match error.print() {
                Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                    Err(CliError::because(ExitCode::Engine, "failed to print", &error))
                }
                Ok(()) | Err(_) => Ok(ExitCode::Success),
            };
        }
        Err(error) => {
            // If standard error cannot be written, only the exit code reports the error.
            let _ = error.print();
            print_error_json(as_json, &command_line::stop_of(&error));
            return Ok(ExitCode::Usage);
        }
    };
    diagnostics::set_colour(cli.color);
    match cli.command {
        Command::Run(args) => commands::experiments::run::run(&args, registry),
        Command::Live(args) => commands::experiments::live::live(&args, registry),
        Command::Evaluate(args) => commands::evaluate::evaluate(&args, registry),
        Command::Check(args) => commands::experiments::check::check(&args, registry),
        Command::Inspect(args) => commands::inspect::inspect(&args, registry),
        Command::Plan(args) => commands::experiments::plan::plan(&args, registry),
        Command::Graph(args) => commands::experiments::graph::graph(&args, registry),
        Command::Lsp(_) => commands::experiments::lsp::lsp(registry),
        Command::Report(args) => commands::analysis::report::report(&args),
        Command::Table(args) => commands::analysis::table::table(&args),
        Command::Compare(args) => commands::analysis::compare::compare(&args),
        Command::Explain(args) => commands::analysis::explain::explain(&args),
        Command::Analyse(args) => commands::analysis::analyse::analyse(&args),
        Command::Figure(args) => commands::analysis::figure::figure(&args),
        Command::Export(args) => commands::recordings::export::export(&args),
        Command::Verify(args) => commands::recordings::verify::verify(&args, registry),
        Command::Submit(args) => commands::cluster::submit::submit(&args, registry),
        Command::Jobs(args) => commands::cluster::jobs(&args, registry),
        Command::Runs(args) => commands::recordings::runs::runs(&args),
        Command::Nodes(args) => commands::reference::nodes::nodes(&args, registry),
        Command::Dora(args) => commands::experiments::dora::dora(&args, registry),
        Command::DoraNode(args) => commands::experiments::dora_node::dora_node(args, registry),
        Command::Synth(args) => commands::experiments::synth::synth(&args),
        Command::Doctor(args) => commands::reference::doctor::doctor(args.json),
        Command::New(args) => commands::experiments::new::new(&args),
        Command::Schema(args) => {
            let named = |(name, _): &&(&str, _)| args.of.as_deref() == Some(name);
            commands::reference::schema::schema(
                commands::SCHEMAS.iter().find(named).map(|(_, schema)| *schema),
                registry,
            )
        }
        Command::Completions { shell } => {
            commands::reference::completions::completions(shell, &command_line::own_command(registry))
        }
        Command::Man(args) => commands::reference::man::man(&args, command_line::own_command(registry)),
    }
}

#[cfg(test)]
mod tests {
    use super::{ExitCode, program, registry};

    #[test]
    fn a_kind_registered_twice_is_refused_before_anything_else() {
        let stop = program(&registry().merge(registry()), false).unwrap_err();
        assert_eq!(stop.exit, ExitCode::Usage);
        assert!(
            stop.message.what.starts_with("kind `confidence/edges` is registered twice: by "),
            "{}",
            stop.message.what
        );
    }
}
