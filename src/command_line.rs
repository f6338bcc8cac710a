//! The command line as a whole: the grammar, its help texts, errors for removed names, and completion from a registry.

mod removed;

use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::Path;

use clap::builder::PossibleValuesParser;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory as _, FromArgMatches as _};
use depthloom_graphs::Registry;
use depthloom_graphs::language::nearest;
use depthloom_terminal::{CliError, ExitCode};

use crate::args::{Cli, GROUPS};
use crate::commands::SCHEMAS;
use crate::completion;

/// The grammar with everything that help, manual and completion need.
pub(crate) fn command(registry: &Registry) -> clap::Command {
    let command = Cli::command();
    let about = |sub: &clap::Command| sub.get_about().map(ToString::to_string).unwrap_or_default();
    let subs: Vec<_> = command.get_subcommands().map(|sub| (sub.get_name().to_owned(), about(sub))).collect();
    let pages = completion::words(subs.iter().map(|(name, about)| (name.as_str(), about.as_str())));
    with_groups(with_exit_codes(command))
        .mut_subcommand("nodes", |nodes| nodes.mut_arg("kind", |kind| kind.add(completion::kinds(registry))))
        .mut_subcommand("schema", |schema| {
            let names = SCHEMAS.iter().map(|(name, _)| *name);
            schema.mut_arg("of", |output| output.value_parser(PossibleValuesParser::new(names)))
        })
        .mut_subcommand("man", |man| man.mut_arg("command", |command| command.add(pages)))
}

/// Adds the page of exit codes to the end of the help text of a command and of its own commands.
fn with_exit_codes(command: clap::Command) -> clap::Command {
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let examples = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
    let page = concat!("Exit codes: ", env!("CARGO_PKG_REPOSITORY"), "/blob/main/docs/reference/exit-codes.md");
    let command = command.after_long_help(format!("{examples}\n{page}"));
    names.iter().fold(command, |command, name| command.mut_subcommand(name, with_exit_codes))
}

/// Lists the commands by workflow in the help text of the program.
fn with_groups(command: clap::Command) -> clap::Command {
    let header = *command.get_styles().get_header();
    let literal = *command.get_styles().get_literal();
    let mut template = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    for (group, names) in GROUPS {
        let _ = write!(template, "\n{header}{group}:{header:#}\n");
        for name in names {
            let about = command.find_subcommand(name).and_then(clap::Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _ = writeln!(template, "  {literal}{name:11}{literal:#}  {about}");
        }
    }
    let _ = write!(
        template,
        "\n`depthloom help COMMAND` explains a command; `depthloom COMMAND -h` lists its options.\n\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    );
    command.help_template(template)
}

/// The same under the name that the program was called by: a program with kinds of its own has its own name.
pub(crate) fn own_command(registry: &Registry) -> clap::Command {
    completion::with_contents(command(registry), registry).name(own_name())
}

/// The name that the program was called by.
pub(crate) fn own_name() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let stem = Path::new(&called).file_stem().and_then(|stem| stem.to_str());
    stem.filter(|stem| !stem.is_empty()).unwrap_or("depthloom").to_owned()
}

/// Whether arguments have `--json`, also if they are wrong.
pub(crate) fn asks_for_json(arguments: impl IntoIterator<Item = OsString>) -> bool {
    arguments.into_iter().take_while(|argument| argument != "--").any(|argument| argument == "--json")
}

pub(crate) fn parse(registry: &Registry) -> Result<Cli, clap::Error> {
    let mut command = command(registry);
    let matches = command.try_get_matches_from_mut(std::env::args_os());
    let mut matches = matches
        .map_err(|error| removed::error(&mut command).unwrap_or_else(|| with_nearest_command(error, &command)))?;
    Cli::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut command))
}

/// Suggests the nearest command, if one is near. The similarity measure of clap would suggest `runs` for `rnu`.
fn with_nearest_command(mut error: clap::Error, command: &clap::Command) -> clap::Error {
    if error.kind() == ErrorKind::InvalidSubcommand
        && let Some(ContextValue::String(written)) = error.get(ContextKind::InvalidSubcommand)
        && let Some(near) = nearest(written, command.get_subcommands().map(clap::Command::get_name))
    {
        let near = ContextValue::String(near.to_owned());
        error.insert(ContextKind::SuggestedSubcommand, near);
    }
    error
}

/// An error of the arguments as any other error: a message and its remedies.
pub(crate) fn stop_of(error: &clap::Error) -> CliError {
    let text = error.render().to_string();
    let plain = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let (message, rest) = text.split_once("\n\n").unwrap_or((&text, ""));
    let stop = CliError::new(ExitCode::Usage, plain(message.trim_start_matches("error: ")));
    let tips = rest.lines().filter_map(|line| line.trim().strip_prefix("tip: "));
    tips.fold(stop, |stop, tip| stop.also(plain(tip)))
}
