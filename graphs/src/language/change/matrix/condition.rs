//! `when:` of an axis: whether it holds in a combination, and what is wrong with one that cannot.

use std::sync::Arc;

use serde_json::json;

use super::axis::{Axis, Combination, Condition, Part, value_text};
use super::{Base, Matrix};
use crate::language::change::apply::{self, Change};
use crate::language::change::parameter::Parameters;
use crate::language::change::path::{self, Scope};
use crate::language::check::schema_check::violations;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::tree::Node;

impl Matrix {
    pub(super) fn is_there(
        &self,
        axis: &Axis,
        combination: &Combination,
        base: &Base<'_>,
        report: &mut Report,
    ) -> bool {
        axis.when.iter().all(|condition| self.is_met(condition, combination, base, report))
    }

    fn is_met(&self, condition: &Condition, combination: &Combination, base: &Base<'_>, report: &mut Report) -> bool {
        let axis_name = &condition.of;
        if self.axes.iter().any(|axis| axis.key == *axis_name && !axis_name.contains('.')) {
            let is_among = |level: &Part| condition.among.iter().any(|wanted| value_text(wanted) == level.text);
            return combination.iter().any(|level| level.axis == *axis_name && is_among(level));
        }
        let is_among = |value: &serde_json::Value| condition.among.iter().any(|wanted| wanted.to_json() == *value);
        let changes = || base.changes.iter().chain(combination.iter().flat_map(|level| &level.changes));
        if let Some(change) = changes().rfind(|change| change.path == *axis_name) {
            return is_among(&change.value.to_json());
        }
        let touches = |change: &Change| {
            let within = |outer: &str, inner: &str| inner.strip_prefix(outer).is_some_and(|rest| rest.starts_with('.'));
            let instance = change.path.strip_suffix(".kind");
            within(&change.path, axis_name)
                || within(axis_name, &change.path)
                || instance.is_some_and(|outer| within(outer, axis_name))
        };
        let document = if changes().any(touches) {
            let changes: Vec<Change> = changes().cloned().collect();
            // Invalid changes are reported elsewhere.
            apply::apply(base.parameters.root, &changes, Scope::Variant, &mut Report::default())
        } else {
            Arc::clone(base.parameters.root)
        };
        let Some(value) = base.parameters.value(axis_name, &document) else {
            let what = format!("nothing sets `{axis_name}`: no axis above, no variant, not the experiment itself");
            report.push(
                Diagnostic::error(&condition.place, what).label("has no value").help("write it where it is defined"),
            );
            return false;
        };
        is_among(&value)
    }

    /// Reports and removes conditions that can never hold.
    pub(super) fn check_conditions(&mut self, parameters: &Parameters<'_>, report: &mut Report) {
        for index in 0..self.axes.len() {
            let mut conditions = std::mem::take(&mut self.axes[index].when);
            conditions.retain(|condition| {
                let wrong = self.wrong_with(condition, index, parameters);
                let is_sound = wrong.is_none();
                wrong.into_iter().for_each(|error| report.push(error));
                is_sound
            });
            self.axes[index].when = conditions;
        }
    }

    fn wrong_with(&self, condition: &Condition, index: usize, parameters: &Parameters<'_>) -> Option<Diagnostic> {
        let axis_name = &condition.of;
        let (above, below) = self.axes.split_at(index);
        let sets = |axes: &[Axis]| axes.iter().any(|axis| axis.key == *axis_name || axis.sets(axis_name));
        if sets(below) && !sets(above) {
            let what =
                format!("`when` of the axis `{}` looks at `{axis_name}`, which is not above it", self.axes[index].key);
            let error = Diagnostic::error(&condition.place, what).label("comes later");
            return Some(error.help("move that axis above this one"));
        }
        let axis = above.iter().find(|axis| axis.key == *axis_name && !axis_name.contains('.'));
        if axis.is_none() && !axis_name.contains('.') {
            let known: Vec<&str> = above.iter().map(|axis| axis.key.as_str()).collect();
            let error = Diagnostic::error(&condition.place, format!("there is no axis `{axis_name}` above"));
            return Some(error.label("unknown name").maybe_help(names::suggestion(axis_name, "axes above", &known)));
        }
        if axis.is_none()
            && let Err(unknown) = path::located(parameters.root, axis_name, Scope::Variant)
        {
            let place = condition.place.part(axis_name, unknown.range);
            return Some(Diagnostic::error(&place, unknown.what).label("unknown name").maybe_help(unknown.help));
        }
        if condition.among.is_empty() {
            let error = Diagnostic::error(&condition.place, format!("`when` names no value of `{axis_name}`"));
            return Some(error.label("never holds").help("name one, or several: `[sgbm, hh]`"));
        }
        condition.among.iter().find_map(|wanted| match axis {
            Some(axis) => axis.never_has(wanted),
            None => self.never_has(axis_name, wanted, parameters),
        })
    }

    fn never_has(&self, path: &str, wanted: &Node, parameters: &Parameters<'_>) -> Option<Diagnostic> {
        let (instance, name) = path.rsplit_once('.')?;
        let (instance, _) = instance.split_once(".with").unwrap_or((instance, ""));
        // With another kind, it may be another parameter.
        let kind = format!("{instance}.kind");
        let variants = parameters.root.get("variants").map_or(&[][..], |variants| variants.entries());
        let mut changed = variants.iter().flat_map(|variant| variant.value.entries()).map(|entry| &entry.key);
        let is_other = |path: &str| path == kind || path == instance;
        if changed.any(|path| is_other(path)) || self.axes.iter().any(|axis| axis.sets(&kind) || axis.sets(instance)) {
            return None;
        }
        let (value, schema) =
            (json!({ name: wanted.to_json() }), json!({ "properties": { name: parameters.schema(path)? } }));
        let violation = violations(&value, &schema).into_iter().next()?;
        Some(Diagnostic::error(&wanted.place, violation.what).label(violation.label).maybe_help(violation.help))
    }
}
