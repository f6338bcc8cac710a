//! Reports what nothing uses, over all variants of the file. What only unselected variants use is not reported.

use std::collections::HashSet;
use std::sync::Arc;

use super::change::apply;
use super::change::path::Scope;
use super::change::variant::Variant;
use super::check::params::Resolver;
use super::check::spec;
use super::plan::link;
use super::plan::linked::Linked;
use super::plan::live;
use super::plan::record::Recorded;
use super::text::diagnostics::{Diagnostic, Report};
use super::text::tree::Node;
use crate::language::ids::StageNode;
use crate::registry::Registry;

/// The most values that all variants of an experiment may hold together.
pub(super) const MOST_VALUES: usize = 20_000_000;

/// An experiment, with the variants that `only` leaves out.
pub(crate) struct Declared<'a> {
    pub(crate) root: &'a Arc<Node>,
    pub(crate) left_out: &'a [Variant],
    pub(crate) recording: &'a Recorded,
    pub(crate) registry: &'a Registry,
}

impl<'r> Declared<'r> {
    /// Reports unused patterns, nodes, sources and stages; returns the useful nodes of each selected variant.
    pub(crate) fn report(&self, taken: &mut Vec<Linked<'r>>, report: &mut Report) -> Vec<HashSet<StageNode>> {
        let count = taken.len();
        let useful = |linked: &[Linked<'r>]| -> Vec<_> {
            linked.iter().map(|linked| live::nodes(linked, self.recording)).collect()
        };
        let mut live = useful(taken);
        let mut found = self.found(taken, &live, report.has_errors());
        // The other variants are checked only if something looks unused.
        if !found.is_empty() && !self.left_out.is_empty() {
            match self.others() {
                Some(others) => {
                    live.extend(useful(&others));
                    taken.extend(others);
                    found = self.found(taken, &live, report.has_errors());
                    taken.truncate(count);
                    live.truncate(count);
                }
                None => found.clear(),
            }
        }
        found.into_iter().for_each(|diagnostic| report.push(diagnostic));
        live
    }

    fn found(&self, linked: &[Linked<'_>], live: &[HashSet<StageNode>], has_errors: bool) -> Vec<Diagnostic> {
        let mut report = Report::default();
        self.recording.check(linked, &mut report);
        live::check(linked, live, &mut report);
        self.sources(linked, &mut report);
        if !has_errors && !report.has_errors() {
            live::check_stages(linked, self.recording, &mut report);
        }
        report.since(0).map(|diagnostic| diagnostic.to_owned()).collect()
    }

    /// The variants that are left out; `None` if one of them is invalid, since it may use anything, or if there are
    /// too many.
    fn others(&self) -> Option<Vec<Linked<'r>>> {
        if self.root.size().saturating_mul(self.left_out.len()) > MOST_VALUES {
            return None;
        }
        let mut wrong = Report::default();
        let mut resolver = Resolver::default();
        let link = |variant: &Variant| {
            let changed = apply::apply(self.root, &variant.changes, Scope::Variant, &mut wrong);
            let spec = spec::read(&changed, self.registry, &mut wrong);
            let linked = link::link(&spec, self.registry, &mut resolver, &mut wrong);
            (!wrong.has_errors()).then_some(linked)
        };
        self.left_out.iter().map(link).collect()
    }

    fn sources(&self, linked: &[Linked<'_>], report: &mut Report) {
        if linked.iter().all(|linked| linked.stages.is_empty()) {
            return;
        }
        let used = |name: &str| {
            let stages = linked.iter().flat_map(|linked| &linked.stages);
            // A stage with a broken source may mean any source.
            stages.into_iter().any(|stage| stage.source.as_ref().is_none_or(|source| source.name == name))
        };
        let sources = self.root.get("sources").into_iter().flat_map(|sources| sources.entries());
        for entry in sources.filter(|entry| !used(&entry.key)) {
            let warning = Diagnostic::warning(&entry.key_place, format!("no stage uses the source `{}`", entry.key));
            report.push(
                warning.label("not used").help(format!("use it in a stage (`source: {}`), or remove it", entry.key)),
            );
        }
    }
}
