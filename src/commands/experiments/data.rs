//! `depthloom data`: what a folder holds, and the source that it is.

mod contact_sheet;
mod contents;
mod seen;
mod stanza;

use depthloom_graphs::plan::FrameIndex;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use depthloom_datasets::inspection::inspect;
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
use crate::args::DataArgs;
use crate::check_data::{DataFact, file_of};
use crate::output;
use crate::output::delivery::replaces_no_run;
use crate::output::diagnostics::Error;
use crate::output::warnings::WarningCollector;

/// As many frames are read of a data set, from all over it.
const LOOKED_AT: usize = 16;

/// The most faults that are told of a source.
const MOST_FAULTS: usize = 8;

/// The kind that takes any two folders: asked only where no other knows a folder.
const ANY_PAIRS: &str = "images";

/// Of `data`: what a folder holds.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Data {
    root: String,
    /// The data sets it is; none where it is laid out as nothing that is known.
    found: Vec<DataSet>,
    /// The contact sheet that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    sheet: Option<Option<String>>,
    /// What to paste into an experiment.
    #[serde(skip_serializing_if = "Option::is_none")]
    stanza: Option<Option<String>>,
    /// What lies in a folder that is nothing known.
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
    /// How many frames were looked at.
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

/// Says what a folder holds and prints the source to paste.
pub(crate) fn data(args: &DataArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let root = std::path::absolute(&args.root).unwrap_or_else(|_| args.root.clone());
    if !root.exists() {
        let what = format!("there is no folder {}", root.display());
        return Err(CliError::usage(what, "name the folder that the data set was unpacked to"));
    }
    if root.to_str().is_none() {
        let what = format!("the name of {} is not UTF-8: no experiment can name it", root.display());
        return Err(CliError::usage(what, "rename the folder"));
    }
    let mut known = known(registry, &root);
    if known.is_empty() {
        return unknown(args, &root);
    }
    name(&mut known);
    let mut sheet = args.sheet.as_ref().map(|_| Sheet::default());
    for one in &mut known {
        one.look(sheet.as_mut());
    }
    let stanza = stanza(&known);
    let unusable = stanza.is_none().then(|| {
        let what = format!("{}: no frame can be read", root.display());
        CliError::usage(what, "repair what is listed as `wrong`, or name the folder that the data set was unpacked to")
    });
    // What was found is told, whether or not the sheet can be written.
    let written = || match (&args.sheet, &sheet) {
        (Some(path), Some(sheet)) if unusable.is_none() => write(path, sheet).map(|()| Some(path)),
        _ => Ok(None),
    };
    if args.output.json {
        let (sheet, stop) = match written() {
            Ok(sheet) => (sheet.map(|path| path.to_string_lossy().into_owned()), unusable),
            Err(stop) => (None, Some(stop)),
        };
        output::print(&Data {
            root: root.to_string_lossy().into_owned(),
            found: known.iter().map(DataSet::from).collect(),
            sheet: Some(sheet),
            stanza: Some(stanza),
            contents: None,
            error: stop.as_ref().map(Error::from),
        })?;
        return Ok(stop.map_or(ExitCode::Success, |stop| stop.exit));
    }
    let mut text = String::new();
    let mut said = BTreeSet::new();
    known.iter().for_each(|one| text.push_str(&one.text(&mut said)));
    text.push_str(stanza.as_deref().unwrap_or_default());
    print(text)?;
    written()?.map_or(Ok(()), |path| print_path("contact sheet: ", path))?;
    unusable.map_or(Ok(ExitCode::Success), Err)
}

/// The sources that a folder is; else those that the folders and files in it are; else any pairs of images in it.
fn known<'a>(registry: &'a Registry, root: &Path) -> Vec<Known<'a>> {
    let by_kinds = |path: &Path| -> Vec<Known<'a>> {
        let kinds = registry.sources().filter(|entry| entry.declaration.kind != ANY_PAIRS);
        kinds.flat_map(|entry| Known::recognise(entry, path)).collect()
    };
    let mut found = by_kinds(root);
    if found.is_empty() {
        found = within(root).iter().flat_map(|path| by_kinds(path)).collect();
    }
    if found.is_empty() {
        found = registry.source_kind(ANY_PAIRS).into_iter().flat_map(|entry| Known::recognise(entry, root)).collect();
    }
    found
}

struct Known<'a> {
    entry: &'a SourceEntry,
    name: String,
    what: String,
    /// As they are pasted: without defaults.
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

/// The folders in a folder, and the files in it that may be a bag or a recording, in order; none of one that holds very
/// many.
fn within(root: &Path) -> Vec<PathBuf> {
    let is_bag = |path: &Path| path.extension().is_some_and(|ending| ending == "mcap" || ending == "db3");
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten().take(200);
    let paths = entries.map(|entry| entry.path());
    // No experiment can name a path that is not UTF-8.
    let paths = paths.filter(|path| path.to_str().is_some());
    let mut found: Vec<PathBuf> = paths.filter(|path| path.is_dir() || is_bag(path) && path.is_file()).collect();
    found.sort_unstable();
    found
}

/// Names them by the end of their kind; where there are several of one, numbered.
fn name(known: &mut [Known<'_>]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for one in known {
        let kind = one.entry.declaration.kind;
        let end = kind.rsplit('/').next().unwrap_or(kind);
        let base: String = end.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let count = counts.entry(base.clone()).or_default();
        *count += 1;
        one.name = if *count == 1 { base } else { format!("{base}_{count}") };
    }
}

impl<'a> Known<'a> {
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

    /// Opens the source and looks at frames from all over it.
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
        let told = WarningCollector::default();
        for position in positions {
            let mut scratch = Scratch::default();
            let read = source.examine(position, &mut Context::new(&told, &mut scratch));
            match read.and_then(|read| read.outputs.in_order_of(&ports).map_err(|fault| vec![fault])) {
                Ok(values) => self.take(&*source, position, &ports, &values, sheet.as_deref_mut()),
                Err(faults) => self.faults.extend(faults.iter().map(Wrong::from)),
            }
        }
        self.warnings.extend(told.into_warnings());
    }

    /// Takes note of a frame's values, and of what they say against each other.
    fn take(
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
        for found in inspect(ports, values) {
            let place = match file_of(found.port, &files) {
                Some(path) => path.display().to_string(),
                None => format!("frame {}", self.frames[position]),
            };
            let remedy = Some(found.remedy.to_owned());
            self.faults.push(Wrong { what: format!("{place}: {}", found.what), remedy });
        }
        if let Some(sheet) = sheet {
            let of = |name: &str| ports.iter().position(|port| port.name == name).and_then(|at| values[at].as_ref());
            let truth = ports.iter().zip(values).find_map(|(port, value)| {
                value.as_ref().filter(|_| matches!(port.value_type, ValueType::Depth | ValueType::TrueDisparity))
            });
            sheet.add(of("left"), of("depth").or(truth));
        }
    }

    /// A line each; a remedy once, where it is said first.
    fn text(&self, said: &mut BTreeSet<String>) -> String {
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
            if let Some(remedy) = remedy.as_ref().filter(|remedy| said.insert((*remedy).clone())) {
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

impl From<&Known<'_>> for DataSet {
    fn from(of: &Known<'_>) -> Self {
        Self {
            what: of.what.clone(),
            kind: of.entry.declaration.kind.to_owned(),
            name: of.name.clone(),
            with: of.params.as_object().cloned().unwrap_or_default(),
            alternatives: of.alternatives.clone().into(),
            frames: of.frames.len() as u64,
            looked_at: of.seen.frames as u64,
            sizes: of.seen.sizes(),
            calibration: of.seen.calibration(),
            truth: of.seen.truth_of_ports(),
            facts: of.facts.iter().map(DataFact::from).collect(),
            faults: of.faults.iter().map(DataSetFault::from).collect(),
            warnings: of.warnings.clone(),
        }
    }
}

/// Tells what lies in a folder that no kind knows.
fn unknown(args: &DataArgs, root: &Path) -> Result<ExitCode, CliError> {
    let found = contents(root);
    let stop = match root.is_dir() {
        true => CliError::usage(
            format!("{} is laid out as no data set that is known", root.display()),
            "pairs of images are the source `images`: two patterns of names, `left: \"cam0/*.png\"` and `right: \"cam1/*.png\"`, or a `list:` (CSV), relative \
             to `root`; its `calibration` in numbers (`focal_px`, `baseline_m`) or files; `truth` where there is some: `depthloom nodes images`. `depthloom nodes` lists \
             the other kinds with their layouts",
        ),
        false => CliError::usage(
            format!("{} is not a bag, a recording or a folder", root.display()),
            "name the folder that a data set was unpacked to, the folder or a file (.mcap, .db3) of a ROS 2 bag, or the folder of a run",
        ),
    };
    if args.output.json {
        output::print(&Data {
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
    replaces_no_run(path)?;
    let failed = |error: std::io::Error| {
        CliError::because(ExitCode::Engine, format!("failed to write {}", path.display()), &error)
            .remedy("name with --sheet a file in a folder that is there and may be written")
    };
    let bytes = sheet.png().ok_or_else(|| {
        CliError::usage(
            "no frame can be shown: none has a left image",
            "`depthloom data ROOT` without --sheet says what there is",
        )
    })?;
    depthloom_durable::write(path, &bytes).map_err(failed)
}
