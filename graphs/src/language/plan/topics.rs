//! Topics: `/<stage>/<node>/<port>`, and `/<stage>/<variant>/<node>/<port>` where variants differ.

use std::collections::HashMap;

use super::linked::Linked;
use super::record::Recording;
use super::share::Shared;

/// The names under which a planned node goes, with the variants that call it so.
type Uses<'a> = HashMap<(usize, usize), Vec<(&'a str, Vec<usize>)>>;

/// Names every output of every stage run and decides whether it is recorded.
pub(crate) fn name(shared: &mut Shared, names: &[String], variants: &[Linked<'_>], recording: &Recording) {
    let mut uses: Uses<'_> = HashMap::new();
    let mut scores: Vec<(usize, usize)> = Vec::new();
    for (v, linked) in variants.iter().enumerate() {
        for (stage, placed) in linked.stages.iter().zip(&shared.placed[v]) {
            for (node, planned) in stage.nodes.iter().zip(&placed.nodes) {
                let Some(planned) = planned else { continue };
                if node.is_score {
                    scores.push((placed.run, *planned));
                }
                let names = uses.entry((placed.run, *planned)).or_default();
                match names.iter_mut().find(|(name, _)| *name == node.name.text) {
                    Some((_, variants)) => variants.push(v),
                    None => names.push((&node.name.text, vec![v])),
                }
            }
        }
    }
    for (r, run) in shared.runs.iter_mut().enumerate() {
        let everywhere = run.variants.len() == names.len();
        run.prefix = match run.variants.first() {
            Some(&first) if !everywhere => format!("/{}/{}", run.stage, names[first]),
            _ => format!("/{}", run.stage),
        };
        let topics = |node: &str, of: &[usize]| -> Vec<String> {
            if of.len() == names.len() {
                return vec![format!("/{}/{node}", run.stage)];
            }
            of.iter().map(|&v| format!("/{}/{}/{node}", run.stage, names[v])).collect()
        };
        let source = topics("source", &run.variants);
        for output in &mut run.source.outputs {
            let mut topics = source.iter().map(|topic| format!("{topic}/{}", output.port.name));
            output.topic = topics.next().unwrap_or_default();
            output.aliases = topics.collect();
            output.recorded = recording.keeps(&run.stage, "source", output.port.name);
        }
        for (n, node) in run.nodes.iter_mut().enumerate() {
            let uses = uses.get(&(r, n)).map_or(&[][..], Vec::as_slice);
            let topics: Vec<String> = uses.iter().flat_map(|(name, variants)| topics(name, variants)).collect();
            let is_score = scores.contains(&(r, n));
            for output in &mut node.outputs {
                let mut topics = topics.iter().map(|topic| format!("{topic}/{}", output.port.name));
                output.topic = topics.next().unwrap_or_default();
                output.aliases = topics.collect();
                let kept = |(name, _): &(&str, Vec<usize>)| recording.keeps(&run.stage, name, output.port.name);
                output.recorded = is_score || uses.iter().any(kept);
            }
        }
    }
}
