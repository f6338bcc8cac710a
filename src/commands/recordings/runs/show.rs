//! `depthloom runs show`: the details of a run.

use depthloom_analysis::variant_of;
use depthloom_graphs::plan::RunId;
use depthloom_recording::Recording;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value as Json;

use crate::args::{RunsArgs, ShowArgs};
use crate::output;
use depthloom_graphs::counted;
use depthloom_runs::{Best, File, FoundRun, Glance, Notes, RECORDING, State, environment, files_in, models, named};
use depthloom_terminal::{CliError, ExitCode, aligned, print, size};

const NAMED: usize = 12;

/// Output of `runs show`: a run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct RunsShow {
    name: String,
    path: String,
    time_utc: String,
    state: State,
    experiment: Option<String>,
    /// Their names.
    variants: Vec<String>,
    frames: u64,
    failed_frames: u64,
    bytes: u64,
    best: Option<Best>,
    trouble: Option<String>,
    #[serde(flatten)]
    notes: Notes,
    description: Option<String>,
    stages: Vec<Stage>,
    /// The content of `environment.json`; null if the file is missing.
    environment: Json,
    files: Vec<File>,
}

/// A stage of a run.
#[derive(JsonSchema, Serialize)]
pub(super) struct Stage {
    // Of the stage run.
    #[serde(skip)]
    name: String,
    stage: String,
    /// If variants have their own sources, the first variant of this one.
    variant: Option<String>,
    frames: u64,
    source: String,
    source_kinds: Vec<String>,
    nodes: u64,
    /// The nodes that trained a model.
    models: Vec<String>,
}

/// Prints the experiment of a run, its state and its files.
pub(super) fn show(args: &RunsArgs, show: &ShowArgs) -> Result<ExitCode, CliError> {
    let folder = args.folder.path();
    let path = named(&show.run, &folder)?;
    let run = FoundRun::at(&path, &folder)?;
    let glance = Glance::at(&run);
    // A recording that another process is writing is not read. If one cannot be read, the glance has the reason.
    let recording = (glance.state != State::Running).then(|| Recording::open(path.join(RECORDING)).ok()).flatten();
    let environment = environment::read(&path);
    let files = files_in(&path);
    if args.json {
        let plan = recording.as_ref().map(Recording::plan);
        output::print(&RunsShow {
            name: glance.name,
            path: glance.path,
            time_utc: glance.time_utc,
            state: glance.state,
            experiment: glance.experiment,
            variants: plan.map(|plan| plan.variants.clone()).unwrap_or_default(),
            frames: glance.frames,
            failed_frames: glance.failed_frames,
            bytes: glance.bytes,
            best: glance.best,
            trouble: glance.trouble,
            notes: glance.notes,
            description: plan.map(|plan| plan.description.trim().to_owned()),
            stages: recording.iter().flat_map(stages).collect(),
            environment,
            files,
        })?;
        return Ok(ExitCode::Success);
    }
    let mut rows = vec![["run".to_owned(), format!("{} ({})", run.path.display(), glance.state_text())]];
    let mut row = |what: &str, text: String| rows.push([what.to_owned(), text]);
    row("time", time(&run, &environment));
    if let Some(command) = command(&environment) {
        row("command", command);
    }
    if let Some(recording) = &recording {
        let plan = recording.plan();
        row(
            "experiment",
            [plan.experiment.as_str(), plan.description.trim()].join(": ").trim_end_matches(": ").to_owned(),
        );
        if plan.variants != [""] {
            row("variants", variants(&plan.variants));
        }
        for stage in stages(recording) {
            row("stage", stage.text());
        }
    }
    if let Some(best) = &glance.best {
        row("best score", best.text());
    }
    if !glance.notes.tags.is_empty() {
        row("tags", glance.notes.tags.iter().map(String::as_str).collect::<Vec<_>>().join(", "));
    }
    if let Some(note) = &glance.notes.note {
        row("note", note.replace('\n', " "));
    }
    if let Some(trouble) = &glance.trouble {
        row("trouble", trouble.clone());
    }
    row("files", format!("{}, {}", counted(files.len(), "file"), size(glance.bytes)));
    let mut text = aligned(&rows, &[]);
    let files = files.into_iter().map(|File { name, bytes }| [format!("  {name}"), size(bytes)]);
    text += &aligned(&files.collect::<Vec<_>>(), &[1]);
    print(text)?;
    Ok(ExitCode::Success)
}

fn time(run: &FoundRun, environment: &Json) -> String {
    let mut text = run.time.format("%Y-%m-%d %H:%M:%S UTC").to_string();
    if let Some(seconds) = environment["wall_s"].as_f64() {
        text += &format!(", after {seconds:.1} s");
    }
    if let (Some(workers), Some(version)) = (environment["workers"].as_u64(), environment["depthloom"].as_str()) {
        text += &format!(", {}, depthloom {version}", counted(workers, "worker"));
    }
    text
}

/// The command line, as a shell takes it.
fn command(environment: &Json) -> Option<String> {
    let arguments = environment["arguments"].as_array()?.iter().filter_map(Json::as_str);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
    let quoted = arguments.map(|argument| match argument.chars().all(is_plain) && !argument.is_empty() {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', r"'\''")),
    });
    Some(quoted.collect::<Vec<_>>().join(" "))
}

fn variants(names: &[String]) -> String {
    let more = if names.len() > NAMED { ", ..." } else { "" };
    format!("{}: {}{more}", names.len(), names[..names.len().min(NAMED)].join(", "))
}

fn stages(recording: &Recording) -> impl Iterator<Item = Stage> {
    RunId::enumerate(&recording.plan().runs).map(|(run, planned)| Stage {
        name: planned.name().to_owned(),
        stage: planned.stage.clone(),
        variant: variant_of(recording.plan(), &planned.variants).map(str::to_owned),
        frames: recording.frames(run).len() as u64,
        source: planned.source.name.clone(),
        source_kinds: planned.source.parts.iter().map(|part| part.kind.clone()).collect(),
        nodes: planned.nodes.len() as u64,
        models: models::names(recording)
            .into_iter()
            .filter(|(value, _)| value.run == run)
            .map(|(_, name)| name)
            .collect(),
    })
}

impl Stage {
    fn text(&self) -> String {
        let (frames, nodes) = (counted(self.frames, "frame"), counted(self.nodes, "node"));
        let (source, kinds) = (&self.source, self.source_kinds.join(", then "));
        let trained = match self.models.as_slice() {
            [] => String::new(),
            models => format!("; trained {}", models.join(", ")),
        };
        format!("{}: {frames} of {source} ({kinds}), {nodes}{trained}", self.name)
    }
}
