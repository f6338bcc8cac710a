//! Prints tables and figures, or writes them to the file of `--out`.

use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::Path;

use depthloom_analysis::{SAMPLES, Table, TableOutput, recording_notes};
use depthloom_graphs::Key;
use depthloom_recording::Recording;
use depthloom_runs::{failed, run_folder};
use depthloom_terminal::{CliError, ExitCode, print, print_bytes, print_quoted, say};

use crate::args::{TableFormat, TableOutputArgs};
use crate::output::{self, CommandOutput};

/// The width of a table on a terminal, in columns of text.
const TERMINAL_WIDTH: usize = 110;

/// The format of a table, and the file to write.
pub(crate) struct Delivery<'a> {
    pub format: TableFormat,
    out: Option<&'a Path>,
}

impl<'a> Delivery<'a> {
    /// Checks that the output can be written where the arguments say.
    pub(crate) fn new(args: &'a TableOutputArgs) -> Result<Self, CliError> {
        let out = args.out.as_deref();
        let default = if args.json { TableFormat::Json } else { TableFormat::Terminal };
        let format = args.format.unwrap_or(default);
        if format == TableFormat::Parquet && out.is_none() && io::stdout().is_terminal() {
            return Err(CliError::usage(
                "`--format parquet` is not text and cannot be printed on a terminal",
                "name a file with --out, or use a pipe",
            ));
        }
        if let Some(out) = out {
            can_be_written(out)?;
        }
        Ok(Self { format, out })
    }

    /// Prints a table, or writes it to the file, as JSON of type `T`; `run` is the key of the plan it is of,
    /// `recordings` are those.
    pub(crate) fn answer<T: CommandOutput + From<TableOutput>>(
        &self,
        table: &Table,
        run: &Key,
        recordings: &[&Path],
    ) -> Result<(), CliError> {
        self.table(table, TERMINAL_WIDTH, run, recordings, || output::text(&T::from(table.output())))
    }

    /// Prints a table, or writes it to the file; `json` is its JSON form.
    pub(crate) fn table(
        &self,
        table: &Table,
        width: usize,
        run: &Key,
        recordings: &[&Path],
        json: impl FnOnce() -> String,
    ) -> Result<(), CliError> {
        let bytes = match self.format {
            TableFormat::Terminal => table.terminal(width).into_bytes(),
            TableFormat::Md => table.markdown().into_bytes(),
            TableFormat::Csv => table.csv(),
            TableFormat::Parquet => table.parquet("asked", run).map_err(failed)?,
            TableFormat::Latex => table.latex().into_bytes(),
            TableFormat::Json => json().into_bytes(),
        };
        self.deliver(&bytes, recordings)
    }

    /// Prints the notes on the condition of recordings as warnings, if the format has no place for notes.
    pub(crate) fn warn_of_condition<'r>(&self, recordings: impl IntoIterator<Item = &'r Recording>) {
        if matches!(self.format, TableFormat::Csv | TableFormat::Parquet) {
            let notes = recordings.into_iter().flat_map(recording_notes);
            notes.for_each(|note| say(format_args!("warning: {note}")));
        }
    }

    /// Whether the output is text for a terminal.
    pub(crate) fn is_shown(&self) -> bool {
        self.format == TableFormat::Terminal && self.out.is_none()
    }

    /// Prints it, or writes it to the file; `recordings` are those that it is of.
    pub(crate) fn deliver(&self, bytes: &[u8], recordings: &[&Path]) -> Result<(), CliError> {
        match (self.out, self.format) {
            (Some(out), _) => write_named(out, bytes, recordings),
            (None, TableFormat::Parquet) => print_bytes(bytes),
            (None, TableFormat::Json) => print_quoted(&String::from_utf8_lossy(bytes)),
            (None, _) => print(String::from_utf8_lossy(bytes)),
        }
    }
}

/// Writes the file of `--out`, but not over a file of one of the runs with these recordings.
pub(crate) fn write_named(out: &Path, bytes: &[u8], recordings: &[&Path]) -> Result<(), CliError> {
    if recordings.iter().any(|recording| is_of_the_run(out, recording)) {
        let what = format!("cannot write {}: it is a file of the run", out.display());
        return Err(CliError::usage(what, "choose another file"));
    }
    write(out, bytes).map_err(|error| {
        CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", out.display()), &error)
    })
}

/// The extensions of outputs: an existing file with another one (an experiment, a network, a program) is the user's.
const OUTPUTS: [&str; 12] = ["csv", "jpeg", "jpg", "json", "md", "parquet", "pdf", "png", "svg", "tex", "txt", "webp"];

/// Whether a file can be an earlier output, by its extension.
fn is_output(file: &Path) -> bool {
    file.extension().is_none_or(|extension| OUTPUTS.iter().any(|output| extension.eq_ignore_ascii_case(output)))
}

/// Refuses to replace a file of a run, a recording, or a file that is not an output.
pub(crate) fn replaces_only_outputs(out: &Path) -> Result<(), CliError> {
    let is_of_a_run = || run_folder::around(out.parent().unwrap_or(Path::new("."))).is_some();
    let what = match out.is_file() {
        true if is_of_a_run() => "it is a file of a run",
        true if depthloom_runs::is_recording(out) => "it is a recording",
        true if !is_output(out) => "it exists, and is not a table or a picture",
        _ => return Ok(()),
    };
    Err(CliError::usage(format!("cannot write {}: {what}", out.display()), "choose another file"))
}

/// Refuses a path that cannot be written as a file.
pub(crate) fn can_be_written(out: &Path) -> Result<(), CliError> {
    let cannot = |what: String| CliError::new(ExitCode::Usage, format!("cannot write {}: {what}", out.display()));
    if out.is_dir() {
        let file = out.join("table.csv");
        return Err(cannot("it is a folder".to_owned()).remedy(format!("name a file in it, e.g. {}", file.display())));
    }
    if out.is_symlink() && !is_stream(out) {
        // In a folder of another user it may lead to any file of this user.
        return Err(cannot("it is a symbolic link".to_owned()).remedy("name the file that it leads to"));
    }
    replaces_only_outputs(out)?;
    match out.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        None => Ok(()),
        Some(folder) => {
            let stop = cannot(format!("there is no folder {}", folder.display()));
            Err(stop.remedy(format!("create it (`mkdir -p {}`), or choose another --out", folder.display())))
        }
    }
}

/// Writes the file, or into the pipe or device of that name (`/dev/stdout`).
fn write(out: &Path, bytes: &[u8]) -> io::Result<()> {
    if is_stream(out) { fs::write(out, bytes) } else { depthloom_durable::write(out, bytes) }
}

/// Whether a path leads to a pipe or device, or to where the system names this process' own streams (`/dev/stdout`,
/// `/dev/fd/3`).
fn is_stream(out: &Path) -> bool {
    ["/dev", "/proc"].iter().any(|folder| out.starts_with(folder))
        || fs::metadata(out).is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// Whether a file is the recording, or its samples, or is stored in the folder of its run.
///
/// Beside a recording outside of a run's folder other files can be replaced: they are not the run's.
fn is_of_the_run(out: &Path, recording: &Path) -> bool {
    let (Ok(out), Ok(recording)) = (out.canonicalize(), recording.canonicalize()) else { return false };
    let Some(folder) = recording.parent().filter(|folder| out.parent() == Some(folder)) else { return false };
    out == recording || out == recording.with_file_name(SAMPLES) || run_folder::around(folder).is_some()
}
