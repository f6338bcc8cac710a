//! `depthloom inspect` of a data set: its frames and faults, and the `sources:` entry for an experiment.

mod contact_sheet;
mod contents;
mod seen;
mod stanza;

use depthloom_graphs::plan::FrameIndex;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use depthloom_datasets::inspection;
use depthloom_graphs::contracts::{Fact, Recognised, Survey};
use depthloom_graphs::registry::SourceEntry;
use depthloom_graphs::{Context, Fault, Port, Registry, Scratch, Source, Value, ValueType};
use depthloom_terminal::{CliError, ExitCode, print, print_path};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value as Json};

use self::contact_sheet::Sheet;
use self::contents::{Contents, contents};
use self::seen::{Calibration, ImageSize, Seen, Truth};
use self::stanza::stanza;
use super::Subject;
use crate::args::InspectArgs;
use crate::check_data::{DataFact, file_of};
use crate::output;
use crate::output::delivery::replaces_only_outputs;
use crate::output::diagnostics::Error;
use crate::output::warnings::WarningCollector;

/// The number of frames that are read, evenly spaced.
const LOOKED_AT: usize = 16;

/// The largest number of faults that are printed per source.
const MOST_FAULTS: usize = 8;

/// The kind that accepts any two folders: it is tried only if no other recognises a folder.
const ANY_PAIRS: &str = "images";

/// Output of `inspect` for a data set or bag.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Data {
    /// The kind of thing that was inspected: `data-set`.
    subject: Subject,
    root: String,
    /// The recognised data sets; empty if no known layout was found.
    found: Vec<DataSet>,
    /// The contact sheet that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    sheet: Option<Option<String>>,
    /// YAML: the entry for `sources:` of an experiment.
    #[serde(skip_serializing_if = "Option::is_none")]
    stanza: Option<Option<String>>,
    /// The files of a folder with no known layout.
    #[serde(skip_serializing_if = "Option::is_none")]
    contents: Option<Vec<Contents>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// A data set.
#[derive(JsonSchema, Serialize)]
pub(crate) struct DataSet {
    what: String,
    /// The kind of the source.
    kind: String,
    name: String,
    /// Its parameters.
    with: Map<String, Json>,
    /// Other ways to read it.
    alternatives: Json,
    frames: u64,
    /// The number of frames that were read.
    looked_at: u64,
    sizes: Vec<ImageSize>,
    calibration: Option<Calibration>,
    /// By port.
    truth: BTreeMap<String, Truth>,
    facts: Vec<DataFact>,
    faults: Vec<DataSetFault>,
    warnings: Vec<String>,
}

/// What is wrong with a data set.
#[derive(JsonSchema, Serialize)]
pub(crate) struct DataSetFault {
    message: String,
    help: Option<String>,
}

impl From<&Wrong> for DataSetFault {
    fn from(fault: &Wrong) -> Self {
        Self { message: fault.what.clone(), help: fault.remedy.clone() }
    }
}

/// Describes a data set and prints the source to paste.
pub(super) fn inspect(args: &InspectArgs, path: &Path, registry: &Registry) -> Result<ExitCode, CliError> {
    let root = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    if root.to_str().is_none() {
        let what = format!("the name of {} is not UTF-8, so no experiment can name it", root.display());
        return Err(CliError::usage(what, "rename the folder"));
    }
    let mut sources = recognised(registry, &root);
    if sources.is_empty() {
        return unknown(args, &root);
    }
    name(&mut sources);
    let mut sheet = args.contact_sheet.as_ref().map(|_| Sheet::default());
    for source in &mut sources {
        source.look(sheet.as_mut());
    }
    let stanza = stanza(&sources);
    let unusable = stanza.is_none().then(|| {
        let what = format!("{}: no frame can be read", root.display());
        CliError::usage(
            what,
            "repair the faults that are listed as `wrong`, or name the folder that the data set was unpacked to",
        )
    });
    // The results are printed even if the sheet cannot be written.
    let written = || match (&args.contact_sheet, &sheet) {
        (Some(path), Some(sheet)) if unusable.is_none() => write(path, sheet).map(|()| Some(path)),
        _ => Ok(None),
    };
    if args.output.json {
        let (sheet, stop) = match written() {
            Ok(sheet) => (sheet.map(|path| path.to_string_lossy().into_owned()), unusable),
            Err(stop) => (None, Some(stop)),
        };
        output::print(&Data {
            subject: Subject::DataSet,
            root: root.to_string_lossy().into_owned(),
            found: sources.iter().map(DataSet::from).collect(),
            sheet: Some(sheet),
            stanza: Some(stanza),
            contents: None,
            error: stop.as_ref().map(Error::from),
        })?;
        return Ok(stop.map_or(ExitCode::Success, |stop| stop.exit));
    }
    let mut text = String::new();
    let mut remedies = BTreeSet::new();
    sources.iter().for_each(|source| text.push_str(&source.text(&mut remedies)));
    text.push_str(stanza.as_deref().unwrap_or_default());
    print(text)?;
    written()?.map_or(Ok(()), |path| print_path("contact sheet: ", path))?;
    unusable.map_or(Ok(ExitCode::Success), Err)
}

/// The sources that a folder is recognised as; else those of the folders and files in it; else any pairs of images in
/// it.
fn recognised<'a>(registry: &'a Registry, root: &Path) -> Vec<RecognisedSource<'a>> {
    let by_kinds = |path: &Path| -> Vec<RecognisedSource<'a>> {
        let kinds = registry.sources().filter(|entry| entry.declaration.kind != ANY_PAIRS);
        kinds.flat_map(|entry| RecognisedSource::recognise(entry, path)).collect()
    };
    let mut found = by_kinds(root);
    if found.is_empty() {
        found = entries_of(root).iter().flat_map(|path| by_kinds(path)).collect();
    }
    if found.is_empty() {
        found = registry
            .source_kind(ANY_PAIRS)
            .into_iter()
            .flat_map(|entry| RecognisedSource::recognise(entry, root))
            .collect();
    }
    found
}

struct RecognisedSource<'a> {
    entry: &'a SourceEntry,
    name: String,
    what: String,
    /// Without defaults, as in the entry to paste.
    params: Json,
    alternatives: Vec<String>,
    frames: Vec<String>,
    facts: Vec<Fact>,
    faults: Vec<Wrong>,
    warnings: Vec<String>,
    seen: Seen,
}

struct Wrong {
    what: String,
    remedy: Option<String>,
}

impl From<&Fault> for Wrong {
    fn from(fault: &Fault) -> Self {
        Self { what: fault.chain(), remedy: fault.remedy_text().map(ToOwned::to_owned) }
    }
}

/// The folders in a folder, and the files in it that may be a bag or a recording, sorted. At most 200 entries are read.
fn entries_of(root: &Path) -> Vec<PathBuf> {
    let is_bag = |path: &Path| path.extension().is_some_and(|ending| ending == "mcap" || ending == "db3");
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten().take(200);
    let paths = entries.map(|entry| entry.path());
    // No experiment can name a path that is not UTF-8.
    let paths = paths.filter(|path| path.to_str().is_some());
    let mut found: Vec<PathBuf> = paths.filter(|path| path.is_dir() || is_bag(path) && path.is_file()).collect();
    found.sort_unstable();
    found
}

/// Names sources by the last part of their kind, with numbers if several have the same one.
fn name(sources: &mut [RecognisedSource<'_>]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for source in sources {
        let kind = source.entry.declaration.kind;
        let end = kind.rsplit('/').next().unwrap_or(kind);
        let base: String = end.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let count = counts.entry(base.clone()).or_default();
        *count += 1;
        source.name = if *count == 1 { base } else { format!("{base}_{count}") };
    }
}

impl<'a> RecognisedSource<'a> {
    fn recognise(entry: &'a SourceEntry, path: &Path) -> impl Iterator<Item = Self> {
        entry.recognise(path).into_iter().map(move |Recognised { what, params, alternatives }| Self {
            entry,
            name: String::new(),
            what,
            params,
            alternatives,
            frames: Vec::new(),
            facts: Vec::new(),
            faults: Vec::new(),
            warnings: Vec::new(),
            seen: Seen::default(),
        })
    }

    /// Opens the source and reads evenly spaced frames.
    fn look(&mut self, mut sheet: Option<&mut Sheet>) {
        let resolved = match self.entry.resolve(&self.params) {
            Ok(resolved) => resolved,
            Err(error) => return self.faults.push(Wrong { what: error.what, remedy: None }),
        };
        let Survey { source, faults, facts } = self.entry.survey(&resolved);
        self.faults.extend(faults.iter().map(Wrong::from));
        self.facts = facts;
        let (Some(source), Ok(ports)) = (source, self.entry.outputs(&resolved)) else { return };
        self.frames = source.frames().iter().map(|frame| frame.id.to_string()).collect();
        self.warnings = source.warnings().to_vec();
        let count = self.frames.len();
        let mut positions: Vec<FrameIndex> =
            (0..LOOKED_AT).map(|at| at * count / LOOKED_AT).filter(|at| *at < count).map(FrameIndex).collect();
        positions.dedup();
        if let Some(sheet) = sheet.as_deref_mut() {
            sheet.begin();
        }
        let warnings = WarningCollector::default();
        for position in positions {
            let mut scratch = Scratch::default();
            let read = source.examine(position, &mut Context::new(&warnings, &mut scratch));
            match read.and_then(|read| read.outputs.in_order_of(&ports).map_err(|fault| vec![fault])) {
                Ok(values) => self.examine(&*source, position, &ports, &values, sheet.as_deref_mut()),
                Err(faults) => self.faults.extend(faults.iter().map(Wrong::from)),
            }
        }
        self.warnings.extend(warnings.into_warnings());
    }

    /// Summarises the values of a frame, and checks them against each other.
    fn examine(
        &mut self,
        source: &dyn Source,
        position: FrameIndex,
        ports: &[Port],
        values: &[Option<Value>],
        sheet: Option<&mut Sheet>,
    ) {
        self.seen.frames += 1;
        for (port, value) in ports.iter().zip(values) {
            if let Some(value) = value {
                self.seen.take(port.name, value);
            }
        }
        let files = source.files(position);
        self.seen.calibration_is_assumed |=
            !files.is_empty() && !files.iter().any(|(part, _)| part.starts_with("calibration"));
        for found in inspection::inspect(ports, values) {
            let place = match file_of(found.port, &files) {
                Some(path) => path.display().to_string(),
                None => format!("frame {}", self.frames[position]),
            };
            let remedy = Some(found.remedy.to_owned());
            self.faults.push(Wrong { what: format!("{place}: {}", found.what), remedy });
        }
        if let Some(sheet) = sheet {
            let value = |name: &str| ports.iter().position(|port| port.name == name).and_then(|at| values[at].as_ref());
            let truth = ports.iter().zip(values).find_map(|(port, value)| {
                value.as_ref().filter(|_| matches!(port.value_type, ValueType::Depth | ValueType::TrueDisparity))
            });
            sheet.add(value("left"), value("depth").or(truth));
        }
    }

    /// One line per fact and fault; each remedy is printed once.
    fn text(&self, remedies: &mut BTreeSet<String>) -> String {
        let mut text = format!("{} ({})\n", self.what, self.entry.declaration.kind);
        let mut line = |label: &str, what: &str| {
            let _ = writeln!(text, "  {label:12} {what}");
        };
        let read = match (self.frames.len(), self.seen.frames) {
            (count, read) if count == read => "all were read".to_owned(),
            (_, 0) => "none could be read".to_owned(),
            (_, 1) => "1 was read".to_owned(),
            (_, read) => format!("{read} were read"),
        };
        match self.frames.as_slice() {
            [] => line("frames", "none"),
            [only] if self.seen.frames == 1 => line("frames", &format!("1: {only}")),
            [only] => line("frames", &format!("1: {only}; it cannot be read")),
            [first, .., last] => line("frames", &format!("{}: {first} to {last}; {read}", self.frames.len())),
        }
        for Fact { label, text } in &self.facts {
            line(label, text);
        }
        for (label, what) in self.seen.lines() {
            line(label, &what);
        }
        for Wrong { what, remedy } in self.faults.iter().take(MOST_FAULTS) {
            line("wrong", what);
            if let Some(remedy) = remedy.as_ref().filter(|remedy| remedies.insert((*remedy).clone())) {
                line("  help", remedy);
            }
        }
        if self.faults.len() > MOST_FAULTS {
            let more = self.faults.len() - MOST_FAULTS;
            line("wrong", &format!("and {more} more: `depthloom check EXPERIMENT --data` lists all"));
        }
        for warning in &self.warnings {
            line("warning", warning);
        }
        text.push('\n');
        text
    }
}

impl From<&RecognisedSource<'_>> for DataSet {
    fn from(source: &RecognisedSource<'_>) -> Self {
        Self {
            what: source.what.clone(),
            kind: source.entry.declaration.kind.to_owned(),
            name: source.name.clone(),
            with: source.params.as_object().cloned().unwrap_or_default(),
            alternatives: source.alternatives.clone().into(),
            frames: source.frames.len() as u64,
            looked_at: source.seen.frames as u64,
            sizes: source.seen.sizes(),
            calibration: source.seen.calibration(),
            truth: source.seen.truth_of_ports(),
            facts: source.facts.iter().map(DataFact::from).collect(),
            faults: source.faults.iter().map(DataSetFault::from).collect(),
            warnings: source.warnings.clone(),
        }
    }
}

/// Lists the files of a folder that no kind of source recognises.
fn unknown(args: &InspectArgs, root: &Path) -> Result<ExitCode, CliError> {
    let found = contents(root);
    let stop = match root.is_dir() {
        true => CliError::usage(
            format!("no known data set layout was found in {}", root.display()),
            "for images use the source `images` (`depthloom nodes images`), for predictions of another program `depthloom evaluate`, or the kinds `depth/files` and `disparity/files`; `depthloom nodes` lists the other kinds with their layouts",
        ),
        false => CliError::usage(
            format!("{} is not a bag, a recording, an ONNX file or a folder", root.display()),
            "name the folder of a data set, the folder or a file (.mcap, .db3) of a ROS 2 bag, a run, or an .onnx file",
        ),
    };
    if args.output.json {
        output::print(&Data {
            subject: Subject::DataSet,
            root: root.to_string_lossy().into_owned(),
            found: Vec::new(),
            sheet: None,
            stanza: None,
            contents: Some(found),
            error: Some(Error::from(&stop)),
        })?;
        return Ok(stop.exit);
    }
    let mut text = String::new();
    for Contents { folder, ending, files } in &found {
        let _ = writeln!(text, "{files:6} {ending:8} in {folder}");
    }
    if found.is_empty() && root.is_dir() {
        text.push_str("no files\n");
    }
    print(text)?;
    Err(stop)
}

fn write(path: &Path, sheet: &Sheet) -> Result<(), CliError> {
    replaces_only_outputs(path)?;
    let failed = |error: std::io::Error| {
        CliError::because(ExitCode::Engine, format!("failed to write {}", path.display()), &error)
            .remedy("name a file with --contact-sheet, in a folder that exists and can be written")
    };
    let bytes = sheet.png().ok_or_else(|| {
        CliError::usage(
            "no frame can be shown: none has a left image",
            "`depthloom inspect ROOT` without --contact-sheet describes the data set",
        )
    })?;
    depthloom_durable::write(path, &bytes).map_err(failed)
}
