//! `depthloom runs show`: a run at length.

use depthloom_analysis::variant_of;
use depthloom_recording::{RecordedSource, Recording};
use serde_json::{Value as Json, json};

use crate::args::{RunsArgs, ShowArgs};
use crate::columns::aligned;
use crate::commands::report::RECORDING;
use crate::counted::counted;
use crate::environment;
use crate::exit::{Exit, Stop};
use crate::models;
use crate::outputs::Output;
use crate::runs::{FoundRun, Glance, State, files_in, named};
use crate::sizes::size;
use crate::streams::{print, print_output};

/// How many variants are named.
const NAMED: usize = 12;

/// Prints what a run is of, what became of it, and what lies in its folder.
pub fn show(args: &RunsArgs, asked: &ShowArgs) -> Result<Exit, Stop> {
    let path = named(&asked.run, &args.folder)?;
    let run = FoundRun::at(&path, &args.folder)?;
    let glance = Glance::at(&run);
    // What another process writes at this moment is not read, and of what cannot be read the glance says why.
    let recording = (glance.state != State::Running).then(|| Recording::open(path.join(RECORDING)).ok()).flatten();
    let environment = environment::of(&path);
    let files = files_in(&path);
    if args.json {
        let mut told = glance.json(&run);
        let plan = recording.as_ref().map(Recording::plan);
        told["about"] = plan.map(|plan| plan.about.trim()).into();
        told["variants"] = plan.map(|plan| &plan.variants).into_iter().flatten().cloned().collect();
        told["stages"] = recording.iter().flat_map(stages).map(|stage| stage.json()).collect();
        told["environment"] = environment;
        told["files"] = files.iter().map(|(name, bytes)| json!({ "name": name, "bytes": bytes })).collect();
        print_output(Output::RunsShow, told)?;
        return Ok(Exit::Whole);
    }
    let mut rows = vec![["run".to_owned(), format!("{} ({})", run.path.display(), glance.state_text())]];
    let mut row = |what: &str, text: String| rows.push([what.to_owned(), text]);
    row("time", time(&run, &environment));
    if let Some(command) = command(&environment) {
        row("command", command);
    }
    if let Some(recording) = &recording {
        let plan = recording.plan();
        row("experiment", [plan.experiment.as_str(), plan.about.trim()].join(": ").trim_end_matches(": ").to_owned());
        if plan.variants != [""] {
            row("variants", variants(&plan.variants));
        }
        for stage in stages(recording) {
            row("stage", stage.text());
        }
    }
    if let Some(best) = &glance.best {
        row("best score", format!("{} {:.4}  {}", best.metric, best.value, best.label));
    }
    if let Some(trouble) = &glance.trouble {
        row("trouble", trouble.clone());
    }
    if let Some(warning) = &glance.warning {
        row("warning", warning.clone());
    }
    row("files", format!("{}, {}", counted(files.len() as u64, "file"), size(glance.bytes)));
    let mut text = aligned(&rows, &[]);
    let files = files.into_iter().map(|(name, bytes)| [format!("  {name}"), size(bytes)]);
    text += &aligned(&files.collect::<Vec<_>>(), &[1]);
    print(text)?;
    Ok(Exit::Whole)
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

/// A stage run of the recording.
struct Stage<'a> {
    name: &'a str,
    stage: &'a str,
    variant: Option<&'a str>,
    frames: usize,
    source: &'a RecordedSource,
    nodes: usize,
    models: Vec<String>,
}

fn stages(recording: &Recording) -> impl Iterator<Item = Stage<'_>> {
    recording.plan().runs.iter().enumerate().map(|(run, planned)| Stage {
        name: planned.name(),
        stage: &planned.stage,
        variant: variant_of(recording.plan(), &planned.variants),
        frames: recording.frames(run).len(),
        source: &planned.source,
        nodes: planned.nodes.len(),
        models: models::names(recording)
            .into_iter()
            .filter(|(value, _)| value.run == run)
            .map(|(_, name)| name)
            .collect(),
    })
}

impl Stage<'_> {
    fn kinds(&self) -> Vec<&str> {
        self.source.parts.iter().map(|part| part.kind.as_str()).collect()
    }

    fn text(&self) -> String {
        let (frames, nodes) = (counted(self.frames as u64, "frame"), counted(self.nodes as u64, "node"));
        let (source, kinds) = (&self.source.name, self.kinds().join(", then "));
        let learnt = match self.models.as_slice() {
            [] => String::new(),
            models => format!("; learnt {}", models.join(", ")),
        };
        format!("{}: {frames} of {source} ({kinds}), {nodes}{learnt}", self.name)
    }

    fn json(&self) -> Json {
        json!({
            "stage": self.stage,
            "variant": self.variant,
            "frames": self.frames,
            "source": self.source.name,
            "source_kinds": self.kinds(),
            "nodes": self.nodes,
            "models": self.models,
        })
    }
}
