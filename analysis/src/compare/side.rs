//! What is compared with what: runs, variants of a run, or estimates.

use depthloom_graphs::language::glob;
use depthloom_graphs::plan::VariantId;
use depthloom_recording::{RecordedPlan, Recording};

use super::{CompareOptions, ComparedRun, no_such};
use crate::error::{AnalysisError, unknown};
use crate::estimates::{Estimate, each_names_one, estimates, is_of, names_of};

/// The name of the baseline that is chosen by its scores.
const BEST: &str = "best";

/// A run, or a variant or estimates of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Side {
    /// Its place among the runs.
    pub run: usize,
    /// A variant, an estimate's label, or a pattern of either in which `*` stands for any run of characters; `None`:
    /// the whole run.
    pub name: Option<String>,
}

/// What the sides are.
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
    /// What it is called: a run as it was named, a variant or an estimate, with its run where there are several.
    pub(super) title: String,
    /// The variant, of a variant.
    pub(super) variant: Option<VariantId>,
    /// What its estimates have in common with those of others by name, and their labels.
    pub(super) entries: Vec<(String, String)>,
}

impl Party {
    pub(super) fn has(&self, label: &str) -> bool {
        self.entries.iter().any(|(_, of)| of == label)
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
    Ok(variants.chain(names_of(&estimates).into_iter().map(str::to_owned)).collect())
}

/// The sides, patterns taken apart; `only` is a pattern of the estimates that are wanted.
pub(super) fn parties(
    runs: &[ComparedRun<'_>],
    estimates: &[Vec<Estimate>],
    sides: &[Side],
    only: Option<&str>,
) -> Result<(Kind, Vec<Party>), AnalysisError> {
    let all = |run: usize| (runs[run].recording.plan(), &estimates[run][..]);
    let mut found: Vec<(Kind, Party)> = Vec::new();
    for side in sides {
        let (plan, of) = all(side.run);
        let prefix = if runs.len() > 1 { format!("{}:", runs[side.run].called) } else { String::new() };
        let some = match &side.name {
            None if sides.len() == 1 && variants(plan, of, "*", side.run, &prefix).len() > 1 => {
                variants(plan, of, "*", side.run, &prefix)
            }
            None if sides.len() == 1 => several(of, "*", side.run, &prefix),
            None => vec![whole(runs[side.run].called, of, side.run)],
            Some(name) => {
                let exact = |party: &(Kind, Party)| party.1.title == format!("{prefix}{name}");
                let mut some = variants(plan, of, name, side.run, &prefix);
                if some.is_empty() {
                    some = several(of, name, side.run, &prefix);
                }
                // A name as a whole is that one's, whatever else is called so.
                match some.iter().position(exact) {
                    Some(place) => vec![some.swap_remove(place)],
                    None if some.is_empty() => return Err(no_such(name, of, &plan.variants)),
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
            party.entries.retain(|(_, label)| run.iter().any(|of| of.label == *label && is_of(of, pattern)));
        }
        each_names_one(pattern, &estimates.concat())?;
        if found.iter().all(|(_, party)| party.entries.is_empty()) {
            let names = estimates.iter().flat_map(|run| names_of(run)).collect::<Vec<_>>();
            return Err(unknown("estimate", pattern, names));
        }
    }
    let Some(&(kind, _)) = found.first() else {
        return Err(AnalysisError::asked("nothing was named".to_owned(), "name a run".to_owned()));
    };
    if found.iter().any(|(of, _)| *of != kind) {
        return Err(AnalysisError::asked(
            "runs, variants and estimates cannot be held against one another".to_owned(),
            "name sides of one kind: `compare A B`, `compare RUN full no_scaling`, `compare RUN full/fused full/mono`"
                .to_owned(),
        ));
    }
    if found.len() < 2 {
        let title = &found[0].1.title;
        return Err(AnalysisError::asked(
            format!("there is nothing to hold {title} against"),
            "name another run, variant or estimate".to_owned(),
        ));
    }
    Ok((kind, found.into_iter().map(|(_, party)| party).collect()))
}

fn whole(called: &str, estimates: &[Estimate], run: usize) -> (Kind, Party) {
    let entries = estimates.iter().map(|of| (of.label.clone(), of.label.clone())).collect();
    (Kind::Runs, Party { run, title: called.to_owned(), variant: None, entries })
}

/// The variants of that name that have estimates of their own.
fn variants(plan: &RecordedPlan, estimates: &[Estimate], name: &str, run: usize, prefix: &str) -> Vec<(Kind, Party)> {
    let named = VariantId::enumerate(&plan.variants).filter(|(_, of)| !of.is_empty() && glob(name, of));
    let party = |(variant, of): (VariantId, &String)| {
        let own = estimates.iter().filter(|estimate| estimate.lead.variant.as_ref() == Some(of));
        let entries: Vec<_> = own.map(|estimate| (own_name(estimate, estimates), estimate.label.clone())).collect();
        let title = format!("{prefix}{of}");
        (!entries.is_empty()).then_some((Kind::Variants, Party { run, title, variant: Some(variant), entries }))
    };
    named.filter_map(party).collect()
}

/// An estimate's name, with its stage where another stage has an estimate of that name.
fn own_name(of: &Estimate, estimates: &[Estimate]) -> String {
    let is_in_two = estimates.iter().any(|other| other.name == of.name && other.lead.stage != of.lead.stage);
    if is_in_two { format!("{}.{}", of.lead.stage, of.name) } else { of.name.clone() }
}

/// The estimates of that label or name, each a side of its own.
fn several(estimates: &[Estimate], name: &str, run: usize, prefix: &str) -> Vec<(Kind, Party)> {
    let party = |of: &Estimate| {
        let entries = vec![(String::new(), of.label.clone())];
        (Kind::Estimates, Party { run, title: format!("{prefix}{}", of.label), variant: None, entries })
    };
    estimates.iter().filter(|of| is_of(of, name)).map(party).collect()
}

/// The place of what the others are held against; `best_of` gives a party's best value, and whether more is better.
pub(super) fn baseline(
    parties: &[Party],
    options: &CompareOptions,
    best_of: impl Fn(&Party) -> Result<Option<(f64, bool)>, AnalysisError>,
) -> Result<usize, AnalysisError> {
    let Some(wanted) = &options.baseline else { return Ok(0) };
    if let Some(place) = parties.iter().position(|party| party.title == *wanted) {
        return Ok(place);
    }
    if wanted != BEST {
        let titles = parties.iter().map(|party| party.title.as_str()).chain([BEST]);
        return Err(unknown("side", wanted, titles.collect::<Vec<_>>()));
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
        AnalysisError::asked("no side has a value to be the best by".to_owned(), "name one with --baseline".to_owned())
    })
}
