//! Random parts of experiments: sources, nodes, estimates, variants, record settings.

use std::collections::BTreeSet;

use serde_json::{Map, Value as Json, json};

use crate::experiment::{
    Axis, Change, Estimate, Experiment, Id, Input, Node, Record, Score, Source, SourcePart, Stage, Variant, set,
};
use crate::files::{HEIGHT, ROOTS, WIDTH};
use crate::kinds::{Contract, KINDS, Kind, Parameter, Type};
use crate::sequence::EarlierRun;
use depthloom_test_needs::random::Random;

/// Names of nodes. There are few, so that a name soon belongs to another node.
const NODE_NAMES: &[&str] = &[
    "near", "far", "left_map", "stereo", "mono", "fused", "smooth", "weight", "edges", "rough", "fine", "net", "sum",
    "late",
];
const ESTIMATE_NAMES: &[&str] = &["first", "second", "third", "stereo", "mono", "fused"];
const STAGE_NAMES: &[&str] = &["look", "learn", "compare", "again"];
const SOURCE_NAMES: &[&str] = &["street", "own", "other", "camera"];
const VARIANT_NAMES: &[&str] = &["a", "b", "c", "d", "full"];

/// Parameters of a road that change without changing its ports.
pub(crate) const ROAD: &[Parameter] = &[
    ("frames", &["\"0..2\"", "\"0..3\"", "\"1..4\"", "[2, 0]", "[1]", "[0, 1, 2]", "[1, 0]"]),
    ("seed", &["1", "2", "\"${SEED:-3}\""]),
    ("ground_truth", &["\"noc\"", "\"occ\""]),
];
const IMAGES: &[Parameter] = &[
    ("frames", &["\"0..2\"", "\"0..3 available\"", "[1, 0]", "\"available\""]),
    ("calibration.focal_px", &["40", "45"]),
];
const PROGRAM: &[Parameter] = &[
    ("params.frames", &["2", "3"]),
    ("params.first", &["0", "1"]),
    ("params.interval_ns", &["100000000", "50000000"]),
    ("params.gain", &["1", "2"]),
    ("env", &["{\"GAIN\": \"1\"}", "{\"GAIN\": \"${LEVEL:-1}\"}", "{}"]),
    ("frames", &["null", "[0]", "[1, 0]"]),
];
const RECORDING: &[Parameter] = &[("frames", &["\"available\"", "\"0..2 available\"", "\"1..3 available\""])];

/// One of a parameter's values.
pub(crate) fn choose(random: &mut Random, (name, values): Parameter) -> (&'static str, Json) {
    (name, json_of(random.pick(values)))
}

/// One of several parameters, and one of its values.
pub(crate) fn choose_any(random: &mut Random, parameters: &[Parameter]) -> (&'static str, Json) {
    let parameter = random.pick(parameters);
    choose(random, parameter)
}

fn json_of(text: &str) -> Json {
    serde_json::from_str(text).expect("the tables hold JSON")
}

/// The parameters of a source kind that may change.
pub(crate) fn source_parameters(kind: &str) -> &'static [Parameter] {
    match kind {
        "synthetic/road" => ROAD,
        "images" => IMAGES,
        "process/source" => PROGRAM,
        _ => RECORDING,
    }
}

/// A name that no other part of its kind has.
fn free_name(random: &mut Random, names: &[&str], taken: &BTreeSet<&str>) -> Option<String> {
    let free: Vec<&str> = names.iter().copied().filter(|name| !taken.contains(name)).collect();
    (!free.is_empty()).then(|| random.pick(&free).to_owned())
}

pub(crate) fn node_name(random: &mut Random, stage: &Stage) -> Option<String> {
    free_name(random, NODE_NAMES, &stage.nodes.iter().map(|node| node.name.as_str()).collect())
}

pub(crate) fn estimate_name(random: &mut Random, score: &Score) -> Option<String> {
    free_name(random, ESTIMATE_NAMES, &score.estimates.iter().map(|estimate| estimate.name.as_str()).collect())
}

pub(crate) fn stage_name(random: &mut Random, experiment: &Experiment) -> Option<String> {
    free_name(random, STAGE_NAMES, &experiment.stages.iter().map(|stage| stage.name.as_str()).collect())
}

pub(crate) fn source_name(random: &mut Random, experiment: &Experiment) -> Option<String> {
    free_name(random, SOURCE_NAMES, &experiment.sources.iter().map(|source| source.name.as_str()).collect())
}

pub(crate) fn variant_name(random: &mut Random, experiment: &Experiment) -> Option<String> {
    free_name(random, VARIANT_NAMES, &experiment.variants.iter().map(|variant| variant.name.as_str()).collect())
}

/// A whole experiment.
pub(crate) fn experiment(random: &mut Random, earlier: &[EarlierRun]) -> Experiment {
    let mut experiment = Experiment {
        sources: Vec::new(),
        stages: Vec::new(),
        variants: Vec::new(),
        axis: None,
        record: Record::default(),
        labels: Vec::new(),
        next_id: 0,
    };
    for _ in 0..1 + random.below(2) {
        add_source(random, &mut experiment, earlier);
    }
    for _ in 0..1 + usize::from(random.chance(3)) {
        add_stage(random, &mut experiment);
    }
    for _ in 0..random.pick(&[0, 0, 1, 2, 2, 3]) {
        add_variant(random, &mut experiment);
    }
    if random.chance(6) {
        experiment.axis = axis(random, &experiment);
    }
    if random.chance(2) {
        experiment.record = record(random, &experiment);
    }
    experiment
}

/// Adds a source; tells its number.
pub(crate) fn add_source(random: &mut Random, experiment: &mut Experiment, earlier: &[EarlierRun]) -> Option<Id> {
    let name = source_name(random, experiment)?;
    let mut parts = vec![source_part(random, earlier)];
    if random.chance(4) {
        // All parts of a source have the same ports.
        let mut candidates = (0..6).map(|_| source_part(random, earlier));
        let ports = parts[0].ports.clone();
        parts.extend(candidates.find(|part| part.ports == ports));
    }
    let id = experiment.new_id();
    experiment.sources.push(Source { id, name, parts });
    Some(id)
}

/// A source of one kind.
pub(crate) fn source_part(random: &mut Random, earlier: &[EarlierRun]) -> SourcePart {
    if !earlier.is_empty() && random.chance(3) {
        return recording(random, earlier);
    }
    let (kind, fixed, ports) = match random.below(8) {
        0..4 => road(random),
        4..6 => {
            let root = random.pick(&ROOTS);
            let fixed = json!({
                "root": root, "left": "left/*.png", "right": "right/*.png",
                "calibration": { "focal_px": 40, "baseline_m": 0.5 },
                "ground_truth": { "files": "truth/*.png", "divide_by": 256 },
            });
            let ports = [
                ("left", Type::Image),
                ("right", Type::Image),
                ("calibration", Type::Calibration),
                ("depth", Type::Depth),
            ];
            ("images", fixed, ports.to_vec())
        }
        _ => program_source(random),
    };
    let Json::Object(mut with) = fixed else { unreachable!("parameters are an object") };
    for parameter in source_parameters(kind) {
        if random.chance(2) {
            let (name, value) = choose(random, *parameter);
            set(&mut with, name, value);
        }
    }
    SourcePart { kind, with, ports: ports.into_iter().map(|(name, of)| (name.to_owned(), of)).collect() }
}

fn road(random: &mut Random) -> (&'static str, Json, Vec<(&'static str, Type)>) {
    let has_disparities = random.chance(3);
    let mut fixed = json!({ "frames": "0..3", "width": WIDTH, "height": HEIGHT });
    let mut ports = vec![
        ("left", Type::Image),
        ("right", Type::Image),
        ("calibration", Type::Calibration),
        ("depth", Type::Depth),
        ("dense", Type::Depth),
        ("occluded", Type::Mask),
    ];
    if has_disparities {
        fixed["disparities"] = json!(true);
        ports.extend([("disp_noc", Type::TrueDisparity), ("disp_occ", Type::TrueDisparity), ("obj_map", Type::Mask)]);
    }
    ("synthetic/road", fixed, ports)
}

fn program_source(random: &mut Random) -> (&'static str, Json, Vec<(&'static str, Type)>) {
    let mut fixed = json!({
        "command": ["PROGRAM", "--process"], "params": { "frames": 2 },
        "outputs": { "left": "image", "right": "image", "depth": "depth", "calibration": "calibration" },
    });
    match random.below(5) {
        0 => fixed["version"] = json!(1),
        4 => {
            fixed["version"] = json!(1);
            fixed["reads"] = json!("predictions/{frame}.txt");
            fixed["params"]["reads"] = json!("predictions/{frame}.txt");
        }
        1 => {
            fixed["code"] = json!(["gain-b.txt"]);
            fixed["params"]["read"] = json!(["gain-b.txt"]);
        }
        2 => fixed["params"]["read"] = json!(["gain-c.txt"]),
        _ => {
            fixed["version"] = json!(1);
            fixed["command"] = json!(["PROGRAM", "--process", "GAIN", "fast"]);
        }
    }
    let ports =
        [("left", Type::Image), ("right", Type::Image), ("depth", Type::Depth), ("calibration", Type::Calibration)];
    ("process/source", fixed, ports.to_vec())
}

/// The recording of an earlier run of the sequence as a source.
fn recording(random: &mut Random, earlier: &[EarlierRun]) -> SourcePart {
    let run = &earlier[random.below(earlier.len())];
    let experiment = &run.experiment;
    let stage = &experiment.stages[random.below(experiment.stages.len())];
    let mut with = Map::new();
    with.insert(
        "path".to_owned(),
        json!(if random.chance(2) { run.folder.clone() } else { format!("{}/recording.mcap", run.folder) }),
    );
    with.insert("stage".to_owned(), json!(stage.name));
    let has_all = run.experiment.record.topics.as_ref();
    let source = experiment.source(stage.source).and_then(|source| source.parts.first());
    let mut ports: Vec<(String, Type)> = Vec::new();
    if has_all.is_none_or(|topics| topics.contains(&0)) {
        ports.extend(source.into_iter().flat_map(|part| part.ports.clone()));
    }
    if random.chance(2) {
        for node in &stage.nodes {
            if has_all.is_none_or(|topics| topics.contains(&node.id)) {
                let per_frame = node.kind.outputs.iter().filter(|(_, of)| !of.is_aggregate());
                ports.extend(per_frame.map(|(port, of)| (format!("{}.{port}", node.name), *of)));
            }
        }
        with.insert("outputs".to_owned(), json!(ports.iter().map(|(name, _)| name).collect::<Vec<_>>()));
        if let Some(variant) =
            (!experiment.variants.is_empty()).then(|| &experiment.variants[random.below(experiment.variants.len())])
        {
            with.insert("variant".to_owned(), json!(variant.name));
        }
    }
    if random.chance(3) {
        let (name, value) = choose(random, RECORDING[0]);
        set(&mut with, name, value);
    }
    SourcePart { kind: "mcap", with, ports }
}

/// Adds a stage with nodes and, often, a score; tells its number.
pub(crate) fn add_stage(random: &mut Random, experiment: &mut Experiment) -> Option<Id> {
    let name = stage_name(random, experiment)?;
    let source = experiment.sources[random.below(experiment.sources.len())].id;
    let id = experiment.new_id();
    experiment.stages.push(Stage { id, name, source, nodes: Vec::new(), score: None });
    let stage = experiment.stages.len() - 1;
    let is_trainer = random.chance(10);
    if is_trainer {
        let chain = ["stereo/sgbm", "confidence/edges", "learn/samples", "learn/ssl"];
        for label in chain {
            add_node_of(random, experiment, stage, crate::kinds::kind(label));
        }
    }
    for _ in 0..if is_trainer { 1 } else { 3 + random.below(6) } {
        add_node(random, experiment, stage);
    }
    if !random.chance(6) {
        experiment.stages[stage].score = score(random, experiment, stage);
    }
    let is_empty = experiment.stages[stage].nodes.is_empty();
    if is_empty {
        experiment.stages.pop();
    }
    (!is_empty).then_some(id)
}

/// Adds a node whose inputs are all there; tells its number.
pub(crate) fn add_node(random: &mut Random, experiment: &mut Experiment, stage: usize) -> Option<Id> {
    let total: usize = KINDS.iter().map(|kind| kind.share).sum();
    (0..8).find_map(|_| {
        let mut place = random.below(total);
        let kind = KINDS.iter().find(|kind| {
            let is_here = place < kind.share;
            place = place.saturating_sub(kind.share);
            is_here
        })?;
        add_node_of(random, experiment, stage, kind)
    })
}

pub(crate) fn add_node_of(
    random: &mut Random,
    experiment: &mut Experiment,
    stage: usize,
    kind: &'static Kind,
) -> Option<Id> {
    let name = node_name(random, &experiment.stages[stage])?;
    let mut inputs = Vec::new();
    for (port, of) in kind.inputs {
        inputs.push((*port, input(random, experiment, stage, kind, *of, None)?));
    }
    for (port, of) in kind.optional_inputs {
        if random.chance(3) {
            inputs.extend(input(random, experiment, stage, kind, *of, None).map(|input| (*port, input)));
        }
    }
    let Json::Object(mut with) = json_of(kind.fixed) else { unreachable!("parameters are an object") };
    for parameter in kind.parameters {
        if random.chance(3) {
            let (name, value) = choose(random, *parameter);
            set(&mut with, name, value);
        }
    }
    let id = experiment.new_id();
    experiment.stages[stage].nodes.push(Node { id, name, kind, inputs, with });
    Some(id)
}

/// A value that an input may be connected to; late ones more often, so that chains become long.
pub(crate) fn input(
    random: &mut Random,
    experiment: &Experiment,
    stage: usize,
    kind: &'static Kind,
    of: Type,
    reader: Option<Id>,
) -> Option<Input> {
    let mut values = experiment.values(stage, of, kind.contract, reader);
    if of == Type::Model {
        values.extend(kind.model_files.iter().map(|file| Input::File(file)));
    }
    if values.is_empty() {
        return None;
    }
    let place = random.below(values.len()).max(random.below(values.len()));
    Some(values.swap_remove(place))
}

/// A score of some of a stage's values.
pub(crate) fn score(random: &mut Random, experiment: &mut Experiment, stage: usize) -> Option<Score> {
    let of_type = |of: Type| experiment.values(stage, of, Contract::Pure, None);
    let truths: Vec<Input> = of_type(Type::Depth)
        .into_iter()
        .filter(|input| matches!(input, Input::Source(name) if name == "depth" || name == "dense"))
        .collect();
    let has_estimates = of_type(Type::Depth).iter().any(|input| matches!(input, Input::Node(..)));
    if truths.is_empty() || !has_estimates {
        return None;
    }
    let truth = truths[random.below(truths.len())].clone();
    let mut settings = Map::new();
    if random.chance(2) {
        settings.insert("sets".to_owned(), json!(["valid", "all"]));
    }
    if random.chance(4) {
        settings.insert("zones".to_owned(), json!({ "rows": 2, "distance_m": [0, 10, 40] }));
    }
    if random.chance(5) {
        settings.insert("metrics".to_owned(), json!("all"));
    }
    let mut score = Score { truth, settings, estimates: Vec::new() };
    for _ in 0..1 + random.below(3) {
        score.estimates.extend(estimate(random, experiment, stage, &score));
    }
    (!score.estimates.is_empty()).then_some(score)
}

/// A further estimate of a score.
pub(crate) fn estimate(
    random: &mut Random,
    experiment: &mut Experiment,
    stage: usize,
    score: &Score,
) -> Option<Estimate> {
    let mut values = experiment.values(stage, Type::Depth, Contract::Pure, None);
    values.retain(|value| matches!(value, Input::Node(..)));
    let name = estimate_name(random, score)?;
    if values.is_empty() {
        return None;
    }
    let mut settings = Map::new();
    if random.chance(5) {
        settings.insert("align".to_owned(), json!("median"));
    }
    if random.chance(4) {
        let (bound, metres) = [("max_m", 15), ("max_m", 40), ("min_m", 6)][random.below(3)];
        settings.insert(bound.to_owned(), json!(metres));
    }
    if random.chance(8) {
        settings.insert("crop".to_owned(), json!("garg"));
    }
    let from = values.swap_remove(random.below(values.len()));
    Some(Estimate { id: experiment.new_id(), name, from, settings })
}

/// Adds a variant with one or two changes; tells its number.
pub(crate) fn add_variant(random: &mut Random, experiment: &mut Experiment) -> Option<Id> {
    let name = variant_name(random, experiment)?;
    let id = experiment.new_id();
    experiment.variants.push(Variant { id, name, changes: Vec::new() });
    for _ in 0..random.pick(&[0, 1, 1, 1, 2]) {
        let change = change(random, experiment);
        if let (Some(change), Some(variant)) = (change, experiment.variants.last_mut()) {
            let path = |change: &Change| (change.target(), std::mem::discriminant(change));
            if variant.changes.iter().all(|other| path(other) != path(&change)) {
                variant.changes.push(change);
            }
        }
    }
    Some(id)
}

/// A change of a parameter, an input or a source.
pub(crate) fn change(random: &mut Random, experiment: &Experiment) -> Option<Change> {
    if random.chance(6) {
        let single: Vec<&Source> = experiment.sources.iter().filter(|source| source.parts.len() == 1).collect();
        let source = (!single.is_empty()).then(|| single[random.below(single.len())])?;
        let (name, value) = choose_any(random, source_parameters(source.parts[0].kind));
        return Some(Change::SourceParameter(source.id, name, value));
    }
    let nodes: Vec<Id> = experiment.nodes().map(|(_, node)| node.id).collect();
    let id = nodes[random.below(nodes.len())];
    if random.chance(4) {
        let (port, input) = other_input(random, experiment, id)?;
        return Some(Change::Input(id, port, input));
    }
    let (_, node) = experiment.node(id)?;
    let parameters = node.kind.parameters;
    let (name, value) = (!parameters.is_empty()).then(|| choose_any(random, parameters))?;
    Some(Change::Parameter(id, name, value))
}

/// An input of a node and another value for it.
pub(crate) fn other_input(random: &mut Random, experiment: &Experiment, id: Id) -> Option<(&'static str, Input)> {
    let stage = experiment.stages.iter().position(|stage| stage.nodes.iter().any(|node| node.id == id))?;
    let (_, node) = experiment.node(id)?;
    let ports: Vec<_> = node.kind.inputs.iter().chain(node.kind.optional_inputs).collect();
    let (port, of) = (!ports.is_empty()).then(|| ports[random.below(ports.len())])?;
    let input = input(random, experiment, stage, node.kind, *of, Some(id))?;
    let current = node.inputs.iter().find(|(name, _)| name == port);
    (current.is_none_or(|(_, current)| *current != input)).then_some((*port, input))
}

/// A matrix of one axis: two or three values of a parameter.
pub(crate) fn axis(random: &mut Random, experiment: &Experiment) -> Option<Axis> {
    let nodes: Vec<&Node> = experiment.nodes().map(|(_, node)| node).collect();
    let node = (!nodes.is_empty()).then(|| nodes[random.below(nodes.len())])?;
    let parameters = node.kind.parameters;
    let (parameter, texts) = (!parameters.is_empty()).then(|| random.pick(parameters))?;
    let mut values: Vec<Json> = Vec::new();
    for text in texts {
        let value = json_of(text);
        // Variables of the environment may stand for a value that is there already.
        let is_plain = value.is_number() || value.as_str().is_some_and(|text| !text.contains('$'));
        if is_plain && !values.contains(&value) && values.len() < 3 {
            values.push(value);
        }
    }
    (values.len() > 1).then_some(Axis { node: node.id, parameter, values })
}

/// Record settings.
pub(crate) fn record(random: &mut Random, experiment: &Experiment) -> Record {
    let nodes: Vec<Id> = experiment.nodes().map(|(_, node)| node.id).collect();
    let topics: Option<BTreeSet<Id>> = random.chance(2).then(|| {
        let chosen = nodes.iter().copied().filter(|_| random.chance(2)).collect::<Vec<_>>();
        chosen.into_iter().chain(random.chance(2).then_some(0)).collect()
    });
    let depths = experiment.nodes().filter(|(_, node)| node.kind.outputs.iter().any(|(_, of)| *of == Type::Depth));
    let depths: Vec<Id> = depths.map(|(_, node)| node.id).collect();
    let mut points = BTreeSet::new();
    if !depths.is_empty() && random.chance(4) {
        points.insert(random.pick(&depths));
    }
    let every = random.chance(3).then(|| random.pick(&[1, 2, 3]));
    let is_lean = topics.is_some() && random.chance(3);
    Record { topics, is_lean, every, view: random.chance(3).then(|| random.chance(2)), points }
}
