//! Random edits, as people make them between two runs.

use crate::experiment::{Change, Experiment, Id, Score, set};
use crate::files::{Content, MAPS, MODULE, Network, ROOTS, TEXTS, add_pair};
use crate::generate;
use crate::sequence::{EarlierRun, State};
use depthloom_test_needs::random::Random;

/// An edit: returns a description; `None` if it cannot be applied.
type Edit = fn(&mut State, &mut Random, &[EarlierRun]) -> Option<String>;

/// All edits, each with how often it is made relative to the others.
const EDITS: &[(usize, Edit)] = &[
    (6, exchange_variants),
    (3, rotate_variants),
    (3, rename_variant),
    (3, reorder_variants),
    (4, add_variant),
    (3, remove_variant),
    (4, change_variant),
    (6, exchange_parameters),
    (4, exchange_node_names),
    (3, rename_node),
    (3, reorder_nodes),
    (5, add_node),
    (3, remove_node),
    (3, copy_node),
    (10, change_parameter),
    (5, change_input),
    (5, exchange_estimates),
    (3, rename_estimate),
    (2, reorder_estimates),
    (3, add_estimate),
    (2, remove_estimate),
    (2, change_score),
    (2, rename_stage),
    (3, exchange_stage_names),
    (2, reorder_stages),
    (3, add_stage),
    (2, remove_stage),
    (3, change_stage_source),
    (2, rename_source),
    (3, exchange_source_names),
    (4, add_source),
    (2, remove_source),
    (6, change_source),
    (3, replace_source),
    (3, reorder_join),
    (5, change_record),
    (4, change_labels),
    (6, change_image),
    (4, exchange_images),
    (2, add_or_remove_frame),
    (8, change_text),
    (4, change_prediction),
    (3, exchange_texts),
    (20, change_module),
    (3, change_network),
    (5, change_environment),
    (4, change_selection),
    (3, change_set),
    (2, change_workers),
    (1, change_keep_going),
    (5, change_axis),
    (3, reorder_axis),
];

/// Makes one edit; returns its description.
pub(crate) fn edit(state: &mut State, random: &mut Random, earlier: &[EarlierRun]) -> String {
    let total: usize = EDITS.iter().map(|(share, _)| share).sum();
    for _ in 0..50 {
        let mut place = random.below(total);
        let chosen = EDITS.iter().find(|(share, _)| {
            let is_here = place < *share;
            place = place.saturating_sub(*share);
            is_here
        });
        let Some((_, edit)) = chosen else { continue };
        let mut changed = state.clone();
        if let Some(what) = edit(&mut changed, random, earlier) {
            changed.experiment.prune();
            if !changed.experiment.stages.is_empty() {
                *state = changed;
                return what;
            }
        }
    }
    "nothing".to_owned()
}

/// Two different places below `count`.
fn two(random: &mut Random, count: usize) -> Option<(usize, usize)> {
    let first = random.below(count.max(1));
    let second = (first + 1 + random.below(count.saturating_sub(1).max(1))) % count.max(1);
    (count >= 2).then_some((first, second))
}

/// A place below `count`.
fn one(random: &mut Random, count: usize) -> Option<usize> {
    (count > 0).then(|| random.below(count))
}

/// A node: the places of its stage and of itself.
fn node(experiment: &Experiment, random: &mut Random) -> Option<(usize, usize)> {
    let stages = experiment.stages.iter().enumerate();
    let nodes: Vec<(usize, usize)> =
        stages.flat_map(|(at, stage)| (0..stage.nodes.len()).map(move |node| (at, node))).collect();
    one(random, nodes.len()).map(|place| nodes[place])
}

/// The score of a random stage that has one.
fn score<'a>(experiment: &'a mut Experiment, random: &mut Random) -> Option<(usize, &'a mut Score)> {
    let scored: Vec<usize> =
        (0..experiment.stages.len()).filter(|stage| experiment.stages[*stage].score.is_some()).collect();
    let stage = one(random, scored.len()).map(|place| scored[place])?;
    Some((stage, experiment.stages[stage].score.as_mut()?))
}

fn exchange_variants(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let variants = &mut state.experiment.variants;
    let (first, second) = two(random, variants.len())?;
    let changes = std::mem::take(&mut variants[first].changes);
    variants[first].changes = std::mem::replace(&mut variants[second].changes, changes);
    Some(format!("exchange what variants `{}` and `{}` change", variants[first].name, variants[second].name))
}

fn rotate_variants(state: &mut State, _: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let variants = &mut state.experiment.variants;
    let mut changes: Vec<_> = variants.iter_mut().map(|variant| std::mem::take(&mut variant.changes)).collect();
    if changes.len() < 3 {
        return None;
    }
    changes.rotate_left(1);
    variants.iter_mut().zip(changes).for_each(|(variant, changes)| variant.changes = changes);
    Some("give every variant the changes of the next".to_owned())
}

fn rename_variant(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.variants.len())?;
    let name = generate::variant_name(random, &state.experiment)?;
    let before = std::mem::replace(&mut state.experiment.variants[place].name, name.clone());
    Some(format!("rename variant `{before}` to `{name}`"))
}

fn reorder_variants(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (first, second) = two(random, state.experiment.variants.len())?;
    state.experiment.variants.swap(first, second);
    Some("reorder the variants".to_owned())
}

fn add_variant(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.experiment.variants.len() >= 4 {
        return None;
    }
    generate::add_variant(random, &mut state.experiment)?;
    let added = state.experiment.variants.pop()?;
    let place = random.below(state.experiment.variants.len() + 1);
    let what = format!("add variant `{}`", added.name);
    state.experiment.variants.insert(place, added);
    Some(what)
}

fn remove_variant(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.variants.len())?;
    Some(format!("remove variant `{}`", state.experiment.variants.remove(place).name))
}

fn change_variant(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.variants.len())?;
    let change = generate::change(random, &state.experiment)?;
    let variant = &mut state.experiment.variants[place];
    variant.changes = vec![change];
    Some(format!("change variant `{}`", variant.name))
}

fn exchange_parameters(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let nodes: Vec<(Id, &str)> = state.experiment.nodes().map(|(_, node)| (node.id, node.kind.label)).collect();
    let (first, label) = one(random, nodes.len()).map(|place| nodes[place])?;
    let alike: Vec<Id> = nodes.iter().filter(|(id, of)| *of == label && *id != first).map(|(id, _)| *id).collect();
    let second = one(random, alike.len()).map(|place| alike[place])?;
    let with = std::mem::take(&mut state.experiment.node_mut(first)?.with);
    let with = std::mem::replace(&mut state.experiment.node_mut(second)?.with, with);
    state.experiment.node_mut(first)?.with = with;
    let name = |id| Some(state.experiment.node(id)?.1.name.clone());
    Some(format!("exchange the parameters of nodes `{}` and `{}`", name(first)?, name(second)?))
}

fn exchange_node_names(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    let nodes = &mut state.experiment.stages[stage].nodes;
    let (first, second) = two(random, nodes.len())?;
    let name = std::mem::take(&mut nodes[first].name);
    nodes[first].name = std::mem::replace(&mut nodes[second].name, name);
    Some(format!("exchange the names of nodes `{}` and `{}`", nodes[first].name, nodes[second].name))
}

fn rename_node(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (stage, place) = node(&state.experiment, random)?;
    let name = generate::node_name(random, &state.experiment.stages[stage])?;
    let before = std::mem::replace(&mut state.experiment.stages[stage].nodes[place].name, name.clone());
    Some(format!("rename node `{before}` to `{name}`"))
}

fn reorder_nodes(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    let nodes = &mut state.experiment.stages[stage].nodes;
    let (first, second) = two(random, nodes.len())?;
    nodes.swap(first, second);
    Some("reorder the nodes".to_owned())
}

fn add_node(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    let id = generate::add_node(random, &mut state.experiment, stage)?;
    Some(format!("add node `{}`", state.experiment.node(id)?.1.name))
}

fn remove_node(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (stage, place) = node(&state.experiment, random)?;
    let (id, name) = {
        let node = &state.experiment.stages[stage].nodes[place];
        (node.id, node.name.clone())
    };
    state.experiment.remove(id);
    Some(format!("remove node `{name}` and what reads it"))
}

fn copy_node(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (stage, place) = node(&state.experiment, random)?;
    let name = generate::node_name(random, &state.experiment.stages[stage])?;
    let id = state.experiment.new_id();
    let mut copy = state.experiment.stages[stage].nodes[place].clone();
    let what = format!("copy node `{}` as `{name}`", copy.name);
    (copy.id, copy.name) = (id, name);
    state.experiment.stages[stage].nodes.insert(place, copy);
    Some(what)
}

fn change_parameter(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (stage, place) = node(&state.experiment, random)?;
    let node = &mut state.experiment.stages[stage].nodes[place];
    let parameter = one(random, node.kind.parameters.len()).map(|place| node.kind.parameters[place])?;
    let (name, value) = generate::choose(random, parameter);
    let what = format!("set `{name}` of node `{}` to {value}", node.name);
    set(&mut node.with, name, value);
    Some(what)
}

fn change_input(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (stage, place) = node(&state.experiment, random)?;
    let id = state.experiment.stages[stage].nodes[place].id;
    let (port, input) = generate::other_input(random, &state.experiment, id)?;
    let node = &mut state.experiment.stages[stage].nodes[place];
    match node.inputs.iter_mut().find(|(name, _)| *name == port) {
        Some((_, current)) => *current = input,
        None => node.inputs.push((port, input)),
    }
    Some(format!("connect the input `{port}` of node `{}` to another value", node.name))
}

fn exchange_estimates(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (_, score) = score(&mut state.experiment, random)?;
    let (first, second) = two(random, score.estimates.len())?;
    let name = std::mem::take(&mut score.estimates[first].name);
    score.estimates[first].name = std::mem::replace(&mut score.estimates[second].name, name);
    Some("exchange the names of two estimates".to_owned())
}

fn rename_estimate(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (_, score) = score(&mut state.experiment, random)?;
    let place = one(random, score.estimates.len())?;
    let name = generate::estimate_name(random, score)?;
    let before = std::mem::replace(&mut score.estimates[place].name, name.clone());
    Some(format!("rename estimate `{before}` to `{name}`"))
}

fn reorder_estimates(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (_, score) = score(&mut state.experiment, random)?;
    let (first, second) = two(random, score.estimates.len())?;
    score.estimates.swap(first, second);
    Some("reorder the estimates".to_owned())
}

fn add_estimate(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    let Some(mut score) = state.experiment.stages[stage].score.take() else {
        state.experiment.stages[stage].score = generate::score(random, &mut state.experiment, stage);
        return state.experiment.stages[stage].score.is_some().then(|| "add a score".to_owned());
    };
    let estimate = generate::estimate(random, &mut state.experiment, stage, &score)?;
    let what = format!("add estimate `{}`", estimate.name);
    score.estimates.push(estimate);
    state.experiment.stages[stage].score = Some(score);
    Some(what)
}

fn remove_estimate(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (_, score) = score(&mut state.experiment, random)?;
    let place = one(random, score.estimates.len())?;
    Some(format!("remove estimate `{}`", score.estimates.remove(place).name))
}

fn change_score(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    state.experiment.stages[stage].score = generate::score(random, &mut state.experiment, stage);
    Some(format!("another score in stage `{}`", state.experiment.stages[stage].name))
}

fn rename_stage(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.stages.len())?;
    let name = generate::stage_name(random, &state.experiment)?;
    let before = std::mem::replace(&mut state.experiment.stages[place].name, name.clone());
    Some(format!("rename stage `{before}` to `{name}`"))
}

fn exchange_stage_names(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stages = &mut state.experiment.stages;
    let (first, second) = two(random, stages.len())?;
    let name = std::mem::take(&mut stages[first].name);
    stages[first].name = std::mem::replace(&mut stages[second].name, name);
    Some("exchange the names of two stages".to_owned())
}

fn reorder_stages(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (first, second) = two(random, state.experiment.stages.len())?;
    state.experiment.stages.swap(first, second);
    Some("reorder the stages".to_owned())
}

fn add_stage(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.experiment.stages.len() >= 3 {
        return None;
    }
    generate::add_stage(random, &mut state.experiment)?;
    Some(format!("add stage `{}`", state.experiment.stages.last()?.name))
}

fn remove_stage(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.experiment.stages.len() < 2 {
        return None;
    }
    let stage = random.below(state.experiment.stages.len());
    Some(format!("remove stage `{}`", state.experiment.stages.remove(stage).name))
}

fn change_stage_source(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let stage = one(random, state.experiment.stages.len())?;
    let (_, source) = two(random, state.experiment.sources.len())?;
    let source = &state.experiment.sources[source];
    let what = format!("run stage `{}` on source `{}`", state.experiment.stages[stage].name, source.name);
    state.experiment.stages[stage].source = source.id;
    Some(what)
}

fn rename_source(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.sources.len())?;
    let name = generate::source_name(random, &state.experiment)?;
    let before = std::mem::replace(&mut state.experiment.sources[place].name, name.clone());
    Some(format!("rename source `{before}` to `{name}`"))
}

fn exchange_source_names(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let sources = &mut state.experiment.sources;
    let (first, second) = two(random, sources.len())?;
    let name = std::mem::take(&mut sources[first].name);
    sources[first].name = std::mem::replace(&mut sources[second].name, name);
    Some("exchange the names of two sources".to_owned())
}

fn add_source(state: &mut State, random: &mut Random, earlier: &[EarlierRun]) -> Option<String> {
    if state.experiment.sources.len() >= 3 {
        return None;
    }
    let id = generate::add_source(random, &mut state.experiment, earlier)?;
    let stage = one(random, state.experiment.stages.len())?;
    state.experiment.stages[stage].source = id;
    let name = &state.experiment.source(id)?.name;
    Some(format!("add source `{name}`, and run stage `{}` on it", state.experiment.stages[stage].name))
}

fn remove_source(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.sources.len())?;
    let removed = state.experiment.sources.remove(place);
    let other = state.experiment.sources.first()?.id;
    let stages = state.experiment.stages.iter_mut().filter(|stage| stage.source == removed.id);
    stages.for_each(|stage| stage.source = other);
    Some(format!("remove source `{}`", removed.name))
}

fn change_source(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.sources.len())?;
    let source = &mut state.experiment.sources[place];
    let part = random.below(source.parts.len());
    let part = &mut source.parts[part];
    let (name, value) = generate::choose_any(random, generate::source_parameters(part.kind));
    let what = format!("set `{name}` of source `{}` to {value}", source.name);
    set(&mut part.with, name, value);
    Some(what)
}

fn replace_source(state: &mut State, random: &mut Random, earlier: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.sources.len())?;
    let source = &mut state.experiment.sources[place];
    source.parts = vec![generate::source_part(random, earlier)];
    Some(format!("source `{}` is now of the kind `{}`", source.name, source.parts[0].kind))
}

fn reorder_join(state: &mut State, random: &mut Random, earlier: &[EarlierRun]) -> Option<String> {
    let place = one(random, state.experiment.sources.len())?;
    let source = &mut state.experiment.sources[place];
    if source.parts.len() > 1 {
        source.parts.reverse();
        return Some(format!("reorder the parts of source `{}`", source.name));
    }
    let added =
        (0..8).map(|_| generate::source_part(random, earlier)).find(|part| part.ports == source.parts[0].ports)?;
    source.parts.insert(random.below(2), added);
    Some(format!("join another part to source `{}`", source.name))
}

fn change_record(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    state.experiment.record = generate::record(random, &state.experiment);
    Some("other record settings".to_owned())
}

fn change_labels(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let ids: Vec<Id> = state.experiment.labelled().into_iter().flatten().map(|(id, _)| id).collect();
    let id = ids[one(random, ids.len())?];
    let number = random.below(3);
    let labels = &mut state.experiment.labels;
    let before = labels.len();
    labels.retain(|(known, _)| *known != id);
    let place = random.below(labels.len() + 1);
    if before == labels.len() || random.chance(2) {
        labels.insert(place, (id, number));
    }
    Some("other labels".to_owned())
}

/// The paths of the files of a kind.
fn paths(state: &State, is_wanted: impl Fn(&Content) -> bool) -> Vec<String> {
    state.files.iter().filter(|(_, content)| is_wanted(content)).map(|(path, _)| path.clone()).collect()
}

fn change_image(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let images = paths(state, |content| matches!(content, Content::Image { .. } | Content::Truth { .. }));
    let path = images[one(random, images.len())?].clone();
    match state.files.get_mut(&path)? {
        Content::Image { seed, .. } => *seed += 1000,
        Content::Truth { depth } => *depth += 64,
        _ => return None,
    }
    Some(format!("change the content of {path}"))
}

fn exchange_images(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let images = paths(state, |content| matches!(content, Content::Image { .. }));
    let (first, second) = two(random, images.len())?;
    let (first, second) = (&images[first], &images[second]);
    let content = *state.files.get(first)?;
    let content = state.files.insert(second.clone(), content)?;
    state.files.insert(first.clone(), content);
    Some(format!("exchange the files {first} and {second}"))
}

fn add_or_remove_frame(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let (root, frame) = (random.pick(&ROOTS), random.below(4));
    let names = ["left", "right", "truth"].map(|folder| format!("{root}/{folder}/{frame:03}.png"));
    if state.files.contains_key(&names[0]) {
        names.iter().for_each(|name| {
            state.files.remove(name);
        });
        return Some(format!("remove frame {frame} of {root}"));
    }
    add_pair(&mut state.files, root, frame, random);
    Some(format!("add frame {frame} to {root}"))
}

fn change_text(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if random.chance(3) {
        state.files.insert(MAPS.to_owned(), Content::Maps(random.below(100) as u32));
        return Some(format!("change the content of {MAPS}"));
    }
    let path = random.pick(&TEXTS);
    state.files.insert(path.to_owned(), Content::Text(random.below(100) as u32));
    Some(format!("change the content of {path}"))
}

fn change_prediction(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let frame = random.pick(&["000000_10", "000001_10", "000002_10", "000", "001", "f0", "f1"]);
    let path = format!("predictions/{frame}.txt");
    if random.chance(4) && state.files.remove(&path).is_some() {
        return Some(format!("remove {path}"));
    }
    state.files.insert(path.clone(), Content::Text(random.below(100) as u32));
    Some(format!("change the content of {path}"))
}

fn exchange_texts(state: &mut State, _: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let [first, second, _] = TEXTS;
    let content = *state.files.get(first)?;
    let content = state.files.insert(second.to_owned(), content)?;
    state.files.insert(first.to_owned(), content);
    Some(format!("exchange the files {first} and {second}"))
}

fn change_module(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let module = state.files.get_mut(MODULE)?;
    *module = Content::PythonModule(2 + random.below(3) as u32);
    Some(format!("change the content of {MODULE}"))
}

fn change_network(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let networks = paths(state, |content| matches!(content, Content::Network(_)));
    let path = networks[one(random, networks.len())?].clone();
    let Some(Content::Network(network)) = state.files.get_mut(&path) else { return None };
    *network = match network {
        Network::Mean => Network::Maximum,
        Network::Maximum => Network::Mean,
        Network::MeanOfPair => Network::MaximumOfPair,
        Network::MaximumOfPair => Network::MeanOfPair,
    };
    Some(format!("another network in {path}"))
}

fn change_environment(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let variables: [(&str, &[&str]); 4] =
        [("BLOCK", &["3", "7"]), ("SIZE", &["3", "5"]), ("SEED", &["1", "2"]), ("LEVEL", &["1", "2"])];
    let (name, values) = random.pick(&variables);
    if state.environment.remove(name).is_some() && random.chance(2) {
        return Some(format!("unset ${name}"));
    }
    let value = random.pick(values);
    state.environment.insert(name, value);
    Some(format!("set ${name} to {value}"))
}

fn change_selection(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.selected.take().is_some() {
        return Some("select all variants".to_owned());
    }
    let place = one(random, state.experiment.variants.len())?;
    state.selected = Some(state.experiment.variants[place].id);
    Some(format!("select variant `{}`", state.experiment.variants[place].name))
}

fn change_set(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.set.take().is_some() {
        return Some("no --set".to_owned());
    }
    let change = generate::change(random, &state.experiment).filter(|change| !matches!(change, Change::Input(..)))?;
    state.set = Some(change);
    Some("--set a parameter".to_owned())
}

fn change_workers(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    state.workers = random.pick(&[1, 2, 5]);
    Some(format!("--workers {}", state.workers))
}

fn change_keep_going(state: &mut State, _: &mut Random, _: &[EarlierRun]) -> Option<String> {
    state.keeps_going = !state.keeps_going;
    Some(if state.keeps_going { "--keep-going" } else { "no --keep-going" }.to_owned())
}

fn change_axis(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    if state.experiment.axis.take().is_some() && random.chance(3) {
        return Some("no matrix".to_owned());
    }
    state.experiment.axis = generate::axis(random, &state.experiment);
    state.experiment.axis.is_some().then(|| "another matrix".to_owned())
}

fn reorder_axis(state: &mut State, random: &mut Random, _: &[EarlierRun]) -> Option<String> {
    let axis = state.experiment.axis.as_mut()?;
    let (first, second) = two(random, axis.values.len())?;
    axis.values.swap(first, second);
    Some("reorder the values of the matrix".to_owned())
}
