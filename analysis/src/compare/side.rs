//! The sides of a comparison: runs, variants of a run, or estimates.

use depthloom_graphs::language::glob;
use depthloom_graphs::plan::VariantId;
use depthloom_recording::{RecordedPlan, Recording};

use super::{CompareOptions, ComparedRun, no_such};
use crate::error::{AnalysisError, unknown};
use crate::estimates::{Estimate, check_patterns, estimate_names, estimates, matches_estimate};

/// The name that selects the side with the best scores as the baseline.
const BEST: &str = "best";

/// A run, or a variant or estimates of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Side {
    /// Its place among the runs.
    pub run: usize,
    /// A variant, the label of an estimate, or a pattern of either in which `*` matches any characters. `None`: the
    /// whole run.
    pub name: Option<String>,
}

/// The kind of the sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Runs,
    Variants,
    Estimates,
}

/// A side with its estimates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Party {
    pub(super) run: usize,
    /// Its title: the run as named in the command, or a variant or estimate, with its run if there are several.
    pub(super) title: String,
    /// The variant, if the side is a variant.
    pub(super) variant: Option<VariantId>,
    /// The names by which its estimates are paired with those of other sides, and their labels.
    pub(super) entries: Vec<(String, String)>,
}

impl Party {
    pub(super) fn has(&self, label: &str) -> bool {
        self.entries.iter().any(|(_, own)| own == label)
    }
}

/// The names by which parts of a run are compared: its variants, then its estimates.
///
/// # Errors
/// If the recording's plan is of another version or damaged.
pub fn names(recording: &Recording) -> Result<Vec<String>, AnalysisError> {
    let plan = recording.plan();
    let estimates = estimates(plan)?;
    let variants = plan.variants.iter().filter(|name| !name.is_empty()).cloned();
    Ok(variants.chain(estimate_names(&estimates).into_iter().map(str::to_owned)).collect())
}

/// The sides with patterns expanded. `only` is a pattern that selects estimates.
pub(super) fn parties(
    runs: &[ComparedRun<'_>],
    estimates: &[Vec<Estimate>],
    sides: &[Side],
    only: Option<&str>,
) -> Result<(Kind, Vec<Party>), AnalysisError> {
    let all = |run: usize| (runs[run].recording.plan(), &estimates[run][..]);
    let mut found: Vec<(Kind, Party)> = Vec::new();
    for side in sides {
        let (plan, own) = all(side.run);
        let prefix = if runs.len() > 1 { format!("{}:", runs[side.run].called) } else { String::new() };
        let some = match &side.name {
            None if sides.len() == 1 && variants(plan, own, "*", side.run, &prefix).len() > 1 => {
                variants(plan, own, "*", side.run, &prefix)
            }
            None if sides.len() == 1 => several(own, "*", side.run, &prefix),
            None => vec![whole(runs[side.run].called, own, side.run)],
            Some(name) => {
                let exact = |party: &(Kind, Party)| party.1.title == format!("{prefix}{name}");
                let mut some = variants(plan, own, name, side.run, &prefix);
                if some.is_empty() {
                    some = several(own, name, side.run, &prefix);
                }
                // An exact title takes precedence over other matches.
                match some.iter().position(exact) {
                    Some(place) => vec![some.swap_remove(place)],
                    None if some.is_empty() => return Err(no_such(name, own, &plan.variants)),
                    None => some,
                }
            }
        };
        for party in some {
            if !found.contains(&party) {
                found.push(party);
            }
        }
    }
    if let Some(pattern) = only {
        for (_, party) in &mut found {
            let run = &estimates[party.run];
            party.entries.retain(|(_, label)| {
                run.iter().any(|estimate| estimate.label == *label && matches_estimate(estimate, pattern))
            });
        }
        check_patterns(pattern, &estimates.concat())?;
        if found.iter().all(|(_, party)| party.entries.is_empty()) {
            let names = estimates.iter().flat_map(|run| estimate_names(run)).collect::<Vec<_>>();
            return Err(unknown("estimate", pattern, names));
        }
    }
    let Some(&(kind, _)) = found.first() else {
        return Err(AnalysisError::request("nothing was named".to_owned(), "name a run".to_owned()));
    };
    if found.iter().any(|(other, _)| *other != kind) {
        return Err(AnalysisError::request(
            "runs, variants and estimates cannot be compared with one another".to_owned(),
            "name only runs, only variants or only estimates: `compare A B`, `compare RUN full no_scaling`, `compare RUN full/fused full/mono`"
                .to_owned(),
        ));
    }
    if found.len() < 2 {
        let title = &found[0].1.title;
        return Err(AnalysisError::request(
            format!("there is nothing to compare {title} with"),
            "name another run, variant or estimate".to_owned(),
        ));
    }
    Ok((kind, found.into_iter().map(|(_, party)| party).collect()))
}

fn whole(called: &str, estimates: &[Estimate], run: usize) -> (Kind, Party) {
    let entries = estimates.iter().map(|estimate| (estimate.label.clone(), estimate.label.clone())).collect();
    (Kind::Runs, Party { run, title: called.to_owned(), variant: None, entries })
}

/// The variants that match the name and have their own estimates.
fn variants(plan: &RecordedPlan, estimates: &[Estimate], name: &str, run: usize, prefix: &str) -> Vec<(Kind, Party)> {
    let named = VariantId::enumerate(&plan.variants).filter(|(_, known)| !known.is_empty() && glob(name, known));
    let party = |(variant, variant_name): (VariantId, &String)| {
        let own = estimates.iter().filter(|estimate| estimate.row_key.variant.as_ref() == Some(variant_name));
        let entries: Vec<_> = own.map(|estimate| (own_name(estimate, estimates), estimate.label.clone())).collect();
        let title = format!("{prefix}{variant_name}");
        (!entries.is_empty()).then_some((Kind::Variants, Party { run, title, variant: Some(variant), entries }))
    };
    named.filter_map(party).collect()
}

/// The name of an estimate, with its stage if another stage has an estimate with this name.
fn own_name(estimate: &Estimate, estimates: &[Estimate]) -> String {
    let stage = &estimate.row_key.stage;
    let is_in_two = estimates.iter().any(|other| other.name == estimate.name && other.row_key.stage != *stage);
    if is_in_two { format!("{stage}.{}", estimate.name) } else { estimate.name.clone() }
}

/// The estimates that match a label or name, one side each.
fn several(estimates: &[Estimate], name: &str, run: usize, prefix: &str) -> Vec<(Kind, Party)> {
    let party = |estimate: &Estimate| {
        let entries = vec![(String::new(), estimate.label.clone())];
        (Kind::Estimates, Party { run, title: format!("{prefix}{}", estimate.label), variant: None, entries })
    };
    estimates.iter().filter(|estimate| matches_estimate(estimate, name)).map(party).collect()
}

/// The place of the baseline. `best_of` returns the best value of a party, and whether higher values are better.
pub(super) fn baseline(
    parties: &[Party],
    options: &CompareOptions,
    best_of: impl Fn(&Party) -> Result<Option<(f64, bool)>, AnalysisError>,
) -> Result<usize, AnalysisError> {
    let Some(name) = &options.baseline else { return Ok(0) };
    if let Some(place) = parties.iter().position(|party| party.title == *name) {
        return Ok(place);
    }
    if name != BEST {
        let titles = parties.iter().map(|party| party.title.as_str()).chain([BEST]);
        return Err(unknown("side", name, titles.collect::<Vec<_>>()));
    }
    let mut best: Option<(usize, f64)> = None;
    for (place, party) in parties.iter().enumerate() {
        if let Some((value, more)) = best_of(party)?
            && best.is_none_or(|(_, so_far)| if more { value > so_far } else { value < so_far })
        {
            best = Some((place, value));
        }
    }
    best.map(|(place, _)| place).ok_or_else(|| {
        AnalysisError::request(
            "`--baseline best` found no side with a value".to_owned(),
            "name a side with `--baseline`".to_owned(),
        )
    })
}
