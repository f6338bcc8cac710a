//! `variants:` and `matrix:`: the same experiment with something changed; and `only:`, which of them.

use super::matrix;
use super::overrides;
use super::parameter::Parameters;
use super::variant::{MOST, Variant, changes, too_many};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::glob::glob;
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::plan::Factor;

/// The variants that `only` selects (one without a name if none is declared), and the others.
pub(crate) fn read(parameters: &Parameters<'_>, report: &mut Report) -> (Vec<Variant>, Vec<Variant>) {
    let before = report.len();
    let all = all(parameters, report);
    match parameters.root.entry("only").filter(|only| !only.value.is_null()) {
        // Errors in variants may be the reason why one is not found.
        Some(only) if report.len() == before => chosen(all, only, report),
        _ => (all, Vec::new()),
    }
}

fn chosen(all: Vec<Variant>, only: &Entry, report: &mut Report) -> (Vec<Variant>, Vec<Variant>) {
    let before = report.len();
    let items = match &only.value.value {
        Tree::List(items) => items.as_slice(),
        _ => std::slice::from_ref(&only.value),
    };
    if items.is_empty() {
        report.push(
            Diagnostic::error(&only.value.place, "`only` names no variant").help("without `only`, all variants run"),
        );
    }
    let mut is_chosen = vec![false; all.len()];
    for item in items {
        let Some(pattern) = item.scalar_text() else {
            report.push(item.not_a("`only`", "names of variants").help("e.g. `only: [full, \"no_*\"]`"));
            continue;
        };
        let mut found = false;
        for (variant, is_chosen) in all.iter().zip(&mut is_chosen).filter(|(variant, _)| glob(&pattern, &variant.name))
        {
            found |= !variant.name.is_empty();
            *is_chosen |= found;
        }
        if !found {
            let names: Vec<&str> =
                all.iter().map(|variant| variant.name.as_str()).filter(|name| !name.is_empty()).collect();
            let what = match names.is_empty() {
                true => "the experiment has no variants to choose from".to_owned(),
                false => format!("no variant is called `{pattern}`"),
            };
            let help = match names.is_empty() {
                true => Some("remove `--variant`, or add `variants` or a `matrix`".to_owned()),
                false => of_combinations(&pattern, &names, &item.place)
                    .or_else(|| names::suggestion(&pattern, "variants", &names)),
            };
            report.push(Diagnostic::error(&item.place, what).label("matches nothing").maybe_help(help));
        }
    }
    if report.len() > before {
        return (all, Vec::new());
    }
    let mut is_chosen = is_chosen.into_iter();
    all.into_iter().partition(|_| is_chosen.next() == Some(true))
}

/// A pattern for the combinations that contain a name.
fn of_combinations(written: &str, names: &[&str], place: &Place) -> Option<String> {
    let forms = [format!("{written}+*"), format!("*+{written}"), format!("*+{written}+*")];
    let count = |form: &String| names.iter().filter(|name| glob(form, name)).count();
    let pattern = forms.iter().max_by_key(|form| count(form)).filter(|form| count(form) > 0)?;
    let count = count(pattern);
    let several = if count == 1 { "the variant".to_owned() } else { format!("the {count} variants") };
    Some(match place.file.name == overrides::ONLY {
        true => format!("`{} '{pattern}'` selects {several} of that form", overrides::ONLY),
        false => format!("`\"{pattern}\"` selects {several} of that form"),
    })
}

fn all(parameters: &Parameters<'_>, report: &mut Report) -> Vec<Variant> {
    let root = parameters.root;
    let declared = declared(root, report);
    let matrices = matrix::read(parameters, report);
    let place = root.entry("matrix").map_or(&root.place, |entry| &entry.key_place).clone();
    let has_declared = !declared.is_empty();
    let bases = if has_declared { declared } else { vec![Variant { place, ..Variant::unnamed(root) }] };
    let reserved: &[&str] = if has_declared { &[Factor::VARIANT] } else { &[] };
    let combined = matrix::combined(&bases, reserved, &matrices, parameters, report);
    let count = combined.iter().map(Vec::len).sum::<usize>();
    if count > MOST {
        report.push(too_many(root.entry("matrix").map_or(&root.place, |entry| &entry.key_place), count));
    }
    if count == 0 || count > MOST {
        return if has_declared { bases } else { vec![Variant::unnamed(root)] };
    }
    let mut variants = Vec::with_capacity(count);
    for (base, combined) in bases.iter().zip(combined) {
        let own = has_declared.then(|| Factor { axis: Factor::VARIANT.to_owned(), value: base.name.clone() });
        for (name, factors, changes) in combined {
            let parts = [base.name.as_str(), &name];
            variants.push(Variant {
                name: parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("+"),
                place: base.place.clone(),
                changes: base.changes.iter().cloned().chain(changes).collect(),
                factors: own.iter().cloned().chain(factors).collect(),
            });
        }
    }
    variants
}

fn declared(root: &Node, report: &mut Report) -> Vec<Variant> {
    let Some(entry) = root.entry("variants") else { return Vec::new() };
    let entries = match &entry.value.value {
        Tree::Map(entries) => entries.as_slice(),
        Tree::Null => &[],
        _ => {
            let help = "e.g. `variants: { full: {}, plain: { STAGE.NODE.with.X: 3 } }`";
            report.push(entry.not_a("a map from names to changes").help(help));
            return Vec::new();
        }
    };
    if entries.len() > MOST {
        report.push(too_many(&entry.key_place, entries.len()));
        return Vec::new();
    }
    let mut variants = Vec::with_capacity(entries.len());
    for entry in entries {
        names::check(&entry.key, "a variant", &[], &entry.key_place, report);
        let Some(changes) = changes(&entry.value, &format!("variant `{}`", entry.key), report) else { continue };
        let (name, place) = (entry.key.clone(), entry.key_place.clone());
        variants.push(Variant { name, place, changes, factors: Vec::new() });
    }
    variants
}
