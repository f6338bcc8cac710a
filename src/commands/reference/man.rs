//! `depthloom man`: manual pages, one for the program and one for each of its commands.

use std::io;
use std::path::Path;

use clap_mangen::Man;
use clap_mangen::roff::{Inline, Roff, bold, roman};
use depthloom_graphs::language::nearest;
use depthloom_terminal::{CliError, ExitCode, print_bytes, print_path};

use crate::args::ManArgs;

/// When this version was released, as CHANGELOG.md has it: pages bear no date of the clock, so that equal versions
/// print equal ones.
const RELEASED: &str = "2026-11-25";

/// Prints a page of a program, or writes all.
pub(crate) fn man(args: &ManArgs, program: clap::Command) -> Result<ExitCode, CliError> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    if let Some(out) = &args.out {
        write_all(&program, out)?;
        print_path("manual pages in ", out)?;
        return Ok(ExitCode::Success);
    }
    let shown = match &args.command {
        None => &program,
        Some(name) => {
            let found = name.split([' ', '-']).try_fold(&program, |command, name| command.find_subcommand(name));
            found.ok_or_else(|| unknown(name, &program))?
        }
    };
    let page =
        page(shown).map_err(|error| CliError::because(ExitCode::Engine, "failed to write the manual page", &error))?;
    print_bytes(&page)?;
    Ok(ExitCode::Success)
}

fn unknown(name: &str, program: &clap::Command) -> CliError {
    let near = nearest(name, program.get_subcommands().map(clap::Command::get_name));
    CliError::unknown(format!("there is no command `{name}`"), near, "`depthloom help` lists them all")
}

fn write_all(program: &clap::Command, out: &Path) -> Result<(), CliError> {
    let failed = |what: &Path, error: &io::Error| {
        CliError::because(ExitCode::Engine, format_args!("failed to write {}", what.display()), error)
    };
    std::fs::create_dir_all(out).map_err(|error| failed(out, &error))?;
    for command in and_below(program) {
        let file = out.join(format!("{}.1", display_name(command)));
        let written = page(command).and_then(|page| depthloom_durable::write(&file, &page));
        written.map_err(|error| failed(&file, &error))?;
    }
    Ok(())
}

fn and_below(command: &clap::Command) -> Vec<&clap::Command> {
    let below = command.get_subcommands().filter(|below| !below.is_hide_set());
    std::iter::once(command).chain(below.flat_map(and_below)).collect()
}

/// `depthloom`, `depthloom-runs`, `depthloom-runs-rm`.
fn display_name(command: &clap::Command) -> &str {
    command.get_display_name().unwrap_or(command.get_name())
}

/// A page in roff: clap's sections, then ours.
fn page(command: &clap::Command) -> io::Result<Vec<u8>> {
    let man = Man::new(command.clone()).date(RELEASED).source(source()).manual("depthloom manual");
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    man.render_options_section(&mut page)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    footer(command).to_writer(&mut page)?;
    Ok(tidied(&String::from_utf8_lossy(&page)).into_bytes())
}

/// The longest line of a page's source, bytes: the limit of `mandoc -Tlint`.
const LINE_BYTES: usize = 78;

/// A page in the usual style of roff: definitions once, the title in capitals, no repeated spaces, short lines.
fn tidied(page: &str) -> String {
    let lines: Vec<&str> = page.lines().map(str::trim_end).collect();
    let mut tidied = String::new();
    for (number, line) in lines.iter().enumerate() {
        let before = number.checked_sub(1).map_or("", |before| lines[before]);
        let after = lines.get(number + 1).copied().unwrap_or_default();
        let is_set_up = line.contains(".ds Aq ") && lines[..number].contains(line);
        // An empty line is a space as well.
        let is_spaced = *line == ".br" && (before.is_empty() || after.is_empty());
        if is_set_up || is_spaced {
            continue;
        }
        match line.strip_prefix(".TH ").and_then(|title| title.split_once(' ')) {
            Some((name, rest)) => tidied.push_str(&format!(".TH {} {rest}", name.to_uppercase())),
            None if line.is_empty() => tidied.push_str(".sp"),
            // The line behind `.TP` is the paragraph's tag as a whole.
            None if line.starts_with('.') || before == ".TP" => tidied.push_str(line),
            None => tidied.push_str(&wrapped(line)),
        }
        tidied.push('\n');
    }
    tidied
}

/// A line of text as several, broken at its spaces.
fn wrapped(line: &str) -> String {
    let mut wrapped = String::new();
    let mut bytes = 0;
    for word in line.split(' ').filter(|word| !word.is_empty()) {
        if bytes > 0 && bytes + 1 + word.len() > LINE_BYTES {
            wrapped.push('\n');
            bytes = 0;
            // At a line's start these would be requests.
            if word.starts_with(['.', '\'']) {
                wrapped.push_str("\\&");
            }
        } else if bytes > 0 {
            wrapped.push(' ');
            bytes += 1;
        }
        wrapped.push_str(word);
        bytes += word.len();
    }
    wrapped
}

fn source() -> String {
    format!("depthloom {}", env!("CARGO_PKG_VERSION"))
}

/// Exit codes, the examples of the help text, and other pages.
fn footer(command: &clap::Command) -> Roff {
    let mut roff = Roff::new();
    roff.control("SH", ["EXIT STATUS"]);
    for (code, about) in ExitCode::ALL {
        paragraph(&mut roff, (code as u8).to_string(), about);
    }
    roff.control("SH", ["EXAMPLES"]);
    let help = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
    let examples: Vec<&str> = help.lines().skip(1).take_while(|line| !line.is_empty()).map(str::trim).collect();
    for example in examples.chunks_exact(2) {
        paragraph(&mut roff, example[0].to_owned(), example[1]);
    }
    roff.control("SH", ["SEE ALSO"]);
    roff.text(see_also(command));
    roff
}

fn paragraph(roff: &mut Roff, tag: String, about: &str) {
    roff.control("TP", []);
    roff.text([bold(tag)]);
    roff.text([roman(about)]);
}

/// From a command to its own, and back.
fn see_also(command: &clap::Command) -> Vec<Inline> {
    let page = |name: &str| [bold(name), roman("(1)")].to_vec();
    let above = display_name(command).strip_suffix(&format!("-{}", command.get_name()));
    let pages: Vec<Vec<Inline>> = above
        .into_iter()
        .chain(command.get_subcommands().filter(|below| !below.is_hide_set()).map(display_name))
        .map(page)
        .collect();
    pages.join(&roman(", "))
}
