//! From the costs of parts to the cost of a run: sums, wall-clock time, and the file system.

use schemars::JsonSchema;
use serde::Serialize;

/// A class of parts of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PartClass {
    /// Reading frames.
    Read,
    /// Pure and ordered nodes.
    Nodes,
    /// Encoding and compressing values.
    Encode,
    /// Writing the recording.
    Write,
    /// CPU time during frames that no timing contains, e.g. of programs.
    Other,
    /// Aggregate nodes, such as trainings.
    Aggregate,
    /// The start: reading the experiment, opening sources.
    Start,
    /// The analysis, with tables and figures.
    Report,
    /// The page.
    Page,
}

impl PartClass {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Nodes => "nodes",
            Self::Encode => "encode",
            Self::Write => "write",
            Self::Other => "other",
            Self::Aggregate => "aggregate",
            Self::Start => "start",
            Self::Report => "report",
            Self::Page => "page",
        }
    }
}

/// A part of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) class: PartClass,
    /// Whether the numbers below are those of one frame; otherwise they count once.
    pub(super) is_per_frame: bool,
    /// Whether all variants share it. Otherwise it grows with the number of variants.
    pub(super) is_shared: bool,
    /// CPU seconds.
    pub(super) cpu_s: f64,
    /// The most threads that work on it at once; `None` if any number can.
    pub(super) threads: Option<f64>,
    pub(super) read_bytes: f64,
    pub(super) written_bytes: f64,
}

impl Part {
    /// A part without cost.
    pub(super) const fn new(class: PartClass) -> Self {
        Self {
            class,
            is_per_frame: true,
            is_shared: true,
            cpu_s: 0.0,
            threads: None,
            read_bytes: 0.0,
            written_bytes: 0.0,
        }
    }

    /// A part that counts once.
    pub(super) const fn once(class: PartClass) -> Self {
        Self { is_per_frame: false, ..Self::new(class) }
    }
}

/// A stage run, or another step of a run: steps follow each other.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Step {
    /// The stage; empty for other steps.
    pub(super) stage: String,
    /// The number of frames.
    pub(super) frames: u64,
    pub(super) parts: Vec<Part>,
}

/// What the prediction assumes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Assumptions {
    /// Threads that work at once.
    pub(super) workers: u64,
    /// Bytes per second that the file system can read and write, together.
    pub(super) bandwidth: f64,
    /// The number of variants, relative to that of the experiment.
    pub(super) variants: f64,
}

/// The sum of the parts of one class in a step.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct PartCost {
    /// The class of the parts.
    pub(crate) part: PartClass,
    /// CPU seconds.
    pub(crate) cpu_s: f64,
    pub(crate) read_bytes: u64,
    pub(crate) written_bytes: u64,
}

/// A step with its costs.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct StepCost {
    /// The stage, with the variant if its source differs between variants; null for a step outside stages.
    pub(crate) stage: Option<String>,
    /// The number of frames; null for a step outside stages.
    pub(crate) frames: Option<u64>,
    pub(crate) parts: Vec<PartCost>,
    /// Seconds of wall-clock time.
    pub(crate) wall_s: f64,
}

/// What limits the wall-clock time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum WallLimit {
    /// The number of workers.
    Workers,
    /// An ordered node, a single training, writing or the report, which use few threads.
    SerialPart,
    /// The bandwidth of the file system.
    FileSystem,
}

/// The use of the file system in the step that needs most of it.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub(crate) struct FileSystemUse {
    /// The stage.
    pub(crate) stage: String,
    /// MB (1,000,000 bytes) per second that are read.
    pub(crate) read_mb_s: f64,
    /// MB per second that are written.
    pub(crate) written_mb_s: f64,
    /// The number of workers, in all processes together, from which the file system is the limit.
    pub(crate) workers_at_limit: u64,
}

/// The cost of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Prediction {
    pub(super) steps: Vec<StepCost>,
    pub(super) cpu_s: f64,
    pub(super) wall_s: f64,
    /// What limits the longest part of the wall-clock time.
    pub(super) limit: WallLimit,
    pub(super) read_bytes: f64,
    pub(super) written_bytes: f64,
    /// `None` if no stage reads or writes.
    pub(super) file_system: Option<FileSystemUse>,
}

/// Adds up steps.
pub(super) fn predict(steps: &[Step], assumptions: Assumptions) -> Prediction {
    let mut by_limit = [(WallLimit::Workers, 0.0), (WallLimit::SerialPart, 0.0), (WallLimit::FileSystem, 0.0)];
    let mut costs = Vec::new();
    let mut uses: Vec<FileSystemUse> = Vec::new();
    for step in steps {
        let mut step_wall = 0.0;
        for is_per_frame in [true, false] {
            let (wall_s, limit) = wall(step, is_per_frame, assumptions);
            step_wall += wall_s;
            by_limit.iter_mut().filter(|(other, _)| *other == limit).for_each(|(_, sum)| *sum += wall_s);
            if is_per_frame {
                uses.extend(file_system_use(step, wall_s, assumptions));
            }
        }
        costs.push(step_cost(step, step_wall, assumptions));
    }
    let sum = |part: fn(&PartCost) -> f64| costs.iter().flat_map(|step| &step.parts).map(part).sum::<f64>();
    let (cpu_s, read_bytes, written_bytes) =
        (sum(|part| part.cpu_s), sum(|part| part.read_bytes as f64), sum(|part| part.written_bytes as f64));
    let limit = by_limit.iter().fold(by_limit[0], |most, next| if next.1 > most.1 { *next } else { most });
    Prediction {
        wall_s: costs.iter().map(|step| step.wall_s).sum(),
        steps: costs,
        cpu_s,
        limit: limit.0,
        read_bytes,
        written_bytes,
        file_system: uses.into_iter().min_by_key(|usage| usage.workers_at_limit),
    }
}

/// How often a part counts.
fn times(part: &Part, step: &Step, assumptions: Assumptions) -> f64 {
    let frames = if part.is_per_frame { step.frames as f64 } else { 1.0 };
    if part.is_shared { frames } else { frames * assumptions.variants }
}

fn step_cost(step: &Step, wall_s: f64, assumptions: Assumptions) -> StepCost {
    let mut classes: Vec<PartClass> = step.parts.iter().map(|part| part.class).collect();
    classes.sort_unstable();
    classes.dedup();
    let part_cost = |class: PartClass| {
        let sum = |of_part: fn(&Part) -> f64| {
            let parts = step.parts.iter().filter(|part| part.class == class);
            parts.map(|part| times(part, step, assumptions) * of_part(part)).sum::<f64>()
        };
        PartCost {
            part: class,
            cpu_s: sum(|part| part.cpu_s),
            read_bytes: sum(|part| part.read_bytes).round() as u64,
            written_bytes: sum(|part| part.written_bytes).round() as u64,
        }
    };
    let parts = classes.into_iter().map(part_cost).collect();
    let is_stage = !step.stage.is_empty();
    StepCost { stage: is_stage.then(|| step.stage.clone()), frames: is_stage.then_some(step.frames), parts, wall_s }
}

/// The wall-clock time of the parts of a step that count per frame, or of those that count once.
fn wall(step: &Step, is_per_frame: bool, assumptions: Assumptions) -> (f64, WallLimit) {
    let parts = || step.parts.iter().filter(|part| part.is_per_frame == is_per_frame);
    let sum =
        |of_part: fn(&Part) -> f64| parts().map(|part| times(part, step, assumptions) * of_part(part)).sum::<f64>();
    let workers = sum(|part| part.cpu_s) / assumptions.workers as f64;
    // Nodes of different variants do not wait for each other.
    let frames = if is_per_frame { step.frames as f64 } else { 1.0 };
    let chain = |part: &Part| part.threads.map(|threads| frames * part.cpu_s / threads.min(assumptions.workers as f64));
    // One thread writes the parts of all variants.
    let is_written = |part: &&Part| part.class == PartClass::Write;
    let written: f64 = parts().filter(is_written).map(|part| times(part, step, assumptions) * part.cpu_s).sum();
    let serial = parts().filter_map(chain).fold(written, f64::max);
    let file_system = sum(|part| part.read_bytes + part.written_bytes) / assumptions.bandwidth;
    if file_system > workers.max(serial) {
        (file_system, WallLimit::FileSystem)
    } else if serial > workers {
        (serial, WallLimit::SerialPart)
    } else {
        (workers, WallLimit::Workers)
    }
}

/// The use of the file system while frames are processed; `None` if there are no bytes.
fn file_system_use(step: &Step, wall_s: f64, assumptions: Assumptions) -> Option<FileSystemUse> {
    let parts = || step.parts.iter().filter(|part| part.is_per_frame);
    let sum =
        |of_part: fn(&Part) -> f64| parts().map(|part| times(part, step, assumptions) * of_part(part)).sum::<f64>();
    let (cpu_s, read, written) = (sum(|part| part.cpu_s), sum(|part| part.read_bytes), sum(|part| part.written_bytes));
    if read + written <= 0.0 || cpu_s <= 0.0 || wall_s <= 0.0 {
        return None;
    }
    Some(FileSystemUse {
        stage: step.stage.clone(),
        read_mb_s: read / wall_s / 1e6,
        written_mb_s: written / wall_s / 1e6,
        workers_at_limit: (assumptions.bandwidth * cpu_s / (read + written)).ceil().max(1.0) as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORKERS: Assumptions = Assumptions { workers: 4, bandwidth: 100e6, variants: 1.0 };

    fn step(parts: &[Part]) -> Step {
        Step { stage: "compare".to_owned(), frames: 10, parts: parts.to_vec() }
    }

    fn node(cpu_s: f64) -> Part {
        Part { cpu_s, ..Part::new(PartClass::Nodes) }
    }

    fn total(parts: &[Part], assumptions: Assumptions) -> Prediction {
        predict(&[step(parts)], assumptions)
    }

    #[test]
    fn frames_multiply_and_workers_divide() {
        let predicted =
            total(&[node(2.0), node(4.0), Part { cpu_s: 8.0, ..Part::once(PartClass::Aggregate) }], WORKERS);
        assert_eq!((predicted.cpu_s, predicted.wall_s, predicted.limit), (68.0, 17.0, WallLimit::Workers));
        let parts: Vec<_> = predicted.steps[0].parts.iter().map(|part| (part.part, part.cpu_s)).collect();
        assert_eq!(parts, [(PartClass::Nodes, 60.0), (PartClass::Aggregate, 8.0)]);
        assert_eq!(predicted.file_system, None);
    }

    #[test]
    fn ordered_nodes_and_trainings_limit_the_wall_time() {
        let ordered = Part { threads: Some(1.0), ..node(5.0) };
        let training = Part { cpu_s: 60.0, threads: Some(2.0), ..Part::once(PartClass::Aggregate) };
        let predicted = total(&[node(1.0), ordered, training], WORKERS);
        assert_eq!((predicted.wall_s, predicted.limit), (50.0 + 30.0, WallLimit::SerialPart));
        // One worker has no use for the second thread.
        let one = total(&[training], Assumptions { workers: 1, ..WORKERS });
        assert_eq!(one.wall_s, 60.0);
    }

    #[test]
    fn parts_of_single_variants_grow_with_their_number() {
        let shared = Part { written_bytes: 10.0, ..node(1.0) };
        let parts = [shared, Part { is_shared: false, ..shared }];
        let predicted = total(&parts, Assumptions { variants: 3.0, ..WORKERS });
        assert_eq!((predicted.cpu_s, predicted.written_bytes), (40.0, 400.0));
        // Ordered nodes of different variants run side by side.
        let ordered = Part { is_shared: false, threads: Some(1.0), ..node(1.0) };
        assert_eq!(total(&[ordered], Assumptions { variants: 3.0, ..WORKERS }).wall_s, 10.0);
    }

    #[test]
    fn the_file_system_is_the_limit_from_some_number_of_workers() {
        // 20 MB per CPU second: 5 workers need 100 MB/s.
        let part = Part { read_bytes: 5e6, written_bytes: 15e6, ..node(1.0) };
        let usage = total(&[part], WORKERS).file_system.unwrap();
        assert_eq!((usage.read_mb_s, usage.written_mb_s, usage.workers_at_limit), (20.0, 60.0, 5));
        let many = total(&[part], Assumptions { workers: 50, ..WORKERS });
        assert_eq!((many.wall_s, many.limit), (2.0, WallLimit::FileSystem));
        assert_eq!(many.file_system.unwrap().workers_at_limit, 5);
    }

    #[test]
    fn steps_follow_each_other() {
        let page = Step {
            stage: String::new(),
            frames: 0,
            parts: vec![Part { cpu_s: 3.0, threads: Some(1.0), ..Part::once(PartClass::Page) }],
        };
        let predicted = predict(&[step(&[node(1.0)]), page], WORKERS);
        assert_eq!((predicted.cpu_s, predicted.wall_s), (13.0, 5.5));
        assert_eq!((predicted.steps[1].stage.as_deref(), predicted.steps[1].frames), (None, None));
    }
}
