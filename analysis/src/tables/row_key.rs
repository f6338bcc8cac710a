//! Row keys: the columns that every table begins with.
//!
//! `stage` and `variant`; then what the row is of: `estimate` and `set` of scores and errors, `node` of time and
//! learning; then a column an axis of the experiment's matrix. A `variant` is null where all variants share the row.
//! Tables, figures and comparisons take these columns from here, so that programs can join one to another by them.

use depthloom_graphs::Key;
use depthloom_graphs::plan::VariantId;
use depthloom_recording::RecordedPlan;
use depthloom_scores::Metric;
use serde::{Deserialize, Serialize};

use super::{Column, Rows};

/// The columns that a table of estimates begins with.
pub const KEY_COLUMNS: [&str; 4] = ["stage", "variant", "estimate", "set"];

/// The pixels that are valid in all estimates with one ground truth and the same settings, as named in `set`.
pub const COMMON: &str = "common";

/// The other columns of tables besides metrics: an axis of the matrix has another name.
/// [`Table::parquet`](super::Table::parquet) checks in tests that none is missing.
const RESERVED: &str = "axis baseline baseline_m best_overall bias_m bin_from bin_from_m bin_from_px bin_to bin_to_m bin_to_px change count cpu_ns density \
    difference difference_high difference_high_m difference_low difference_low_m difference_m disparity_density disparity_frames \
    disparity_pixels frame frames gross_share learning_rate level loss losses mean median_cpu_ns ms node p p_from p_holm phase pixels \
    position rmse_m rows run score scoring share statistic step ties truth_m unit validation value value_m verdict wall_ns wins x y zone";
/// What names of other columns begin with.
const RESERVED_STARTS: [&str; 5] = ["paper_", "error_", "relative_", "baseline_", "axis."];

/// What a row is of, but for the estimate, the node, ...
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowKey {
    /// The stage's name.
    pub stage: String,
    /// The variant; `None` where all share it. Of what several but not all share, the first.
    pub variant: Option<String>,
    /// By axis of the experiment's matrix: the same axes in every row.
    pub factors: Vec<Level>,
}

/// An axis of the matrix, and what it is in a row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// The axis, as variants' names have it.
    pub axis: String,
    /// Its column: called as the axis, or `axis.<axis>` where tables have another column of that name.
    pub column: String,
    /// The value as the experiment writes it; `None` where the variant does not have the axis, or not all variants that
    /// share the row agree.
    pub value: Option<String>,
    /// Whether all values of the axis are numbers.
    pub is_numeric: bool,
}

/// The axes of an experiment's matrix, to say what rows are of.
pub struct RowKeys<'a> {
    plan: &'a RecordedPlan,
    /// The axes in the order of variants' names, without a value.
    axes: Vec<Level>,
}

impl<'a> RowKeys<'a> {
    /// Of a plan.
    #[must_use]
    pub fn new(plan: &'a RecordedPlan) -> Self {
        let mut axes: Vec<Level> = Vec::new();
        for factor in plan.factors.iter().flatten() {
            let is_numeric = factor.value.parse().is_ok_and(|number: f64| number.is_finite());
            match axes.iter_mut().find(|axis| axis.axis == factor.axis) {
                Some(axis) => axis.is_numeric &= is_numeric,
                None => {
                    let (axis, column) = (factor.axis.clone(), column_of(&factor.axis));
                    axes.push(Level { axis, column, value: None, is_numeric });
                }
            }
        }
        Self { plan, axes }
    }

    /// Of what all variants share.
    pub(crate) fn of_all(&self, stage: &str) -> RowKey {
        RowKey { stage: stage.to_owned(), variant: None, factors: self.axes.clone() }
    }

    /// Of what these variants share; where they are all, of what all share.
    #[must_use]
    pub fn of_those(&self, stage: &str, variants: &[VariantId]) -> RowKey {
        if variants.len() < self.plan.variants.len() { self.of(stage, variants) } else { self.of_all(stage) }
    }

    /// Of what only these variants share.
    pub(crate) fn of(&self, stage: &str, own: &[VariantId]) -> RowKey {
        let value = |axis: &str| -> Option<&str> {
            let of = |variant: VariantId| self.plan.factors_of(variant).iter().find(|factor| factor.axis == axis);
            let first = of(*own.first()?)?.value.as_str();
            own[1..].iter().all(|&other| of(other).is_some_and(|other| other.value == first)).then_some(first)
        };
        let level = |axis: &Level| Level { value: value(&axis.axis).map(str::to_owned), ..axis.clone() };
        let variant = first_of(self.plan, own).map(str::to_owned);
        RowKey { stage: stage.to_owned(), variant, factors: self.axes.iter().map(level).collect() }
    }
}

impl RowKey {
    /// A level by its axis.
    pub(crate) fn level(&self, axis: &str) -> Option<&Level> {
        self.factors.iter().find(|level| level.axis == axis)
    }
}

/// The columns that a table of these rows begins with: stage, variant, `own`, and the axes.
pub(crate) fn key_columns<'r, R>(rows: &'r [R], key: impl Fn(&'r R) -> &'r RowKey, own: Vec<Column>) -> Vec<Column> {
    let cells = Rows(rows);
    let mut columns =
        vec![cells.key("stage", |row| &key(row).stage), cells.key("variant", |row| key(row).variant.as_ref())];
    columns.extend(own);
    for (place, axis) in rows.first().into_iter().flat_map(|row| key(row).factors.iter().enumerate()) {
        let level = |row: &'r R| key(row).factors[place].value.clone();
        columns.push(match axis.is_numeric {
            true => Column::levels(&axis.column, rows.iter().map(level), |_| true).axis(),
            false => cells.key(&axis.column, level).axis(),
        });
    }
    columns
}

/// The key of a run's plan: that of equal experiments, whatever machine ran them. Parquet files have it in their
/// metadata.
#[must_use]
#[expect(clippy::missing_panics_doc, reason = "whatever a plan holds is JSON")]
pub fn plan_key(plan: &RecordedPlan) -> Key {
    let json = serde_json::to_vec(plan).expect("a plan was read from JSON");
    Key::digest("depthloom run").bytes(&json).finish()
}

/// The variant that stands for some that share something: the first; `None` where they are all.
#[must_use]
pub fn variant_of<'p>(plan: &'p RecordedPlan, variants: &[VariantId]) -> Option<&'p str> {
    (variants.len() < plan.variants.len()).then(|| first_of(plan, variants)).flatten()
}

fn first_of<'p>(plan: &'p RecordedPlan, variants: &[VariantId]) -> Option<&'p str> {
    let first = plan.variants.get(variants.first()?.0)?;
    (!first.is_empty()).then_some(first.as_str())
}

/// The column of an axis.
fn column_of(axis: &str) -> String {
    if is_reserved(axis) { format!("axis.{axis}") } else { axis.to_owned() }
}

/// Whether tables have a column of that name which is not one of an axis.
pub(super) fn is_reserved(name: &str) -> bool {
    KEY_COLUMNS.contains(&name)
        || RESERVED.split_whitespace().any(|column| column == name)
        || Metric::named(name).is_some()
        || RESERVED_STARTS.iter().any(|start| name.starts_with(start))
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::{Factor, VariantId};
    use serde::Deserialize as _;
    use serde_json::json;

    use super::super::Table;
    use super::*;

    fn plan() -> RecordedPlan {
        let factor = |axis: &str, value: &str| Factor { axis: axis.to_owned(), value: value.to_owned() };
        let plan = json!({ "experiment": "x", "about": "", "variants": [], "every": 1, "view": false, "runs": [] });
        let mut plan = RecordedPlan::deserialize(plan).unwrap();
        let variants = [("full", "3", "hh"), ("full", "9", "hh"), ("bare", "3", "sgbm")];
        for (variant, block, mode) in variants {
            plan.variants.push(format!("{variant}+block={block}"));
            plan.factors.push(vec![factor("variant", variant), factor("block", block), factor("mode", mode)]);
        }
        plan
    }

    #[test]
    fn an_axis_is_null_where_all_share_a_row_or_those_that_do_differ_on_it() {
        let plan = plan();
        let values = |variants: &[VariantId]| {
            let lead = RowKeys::new(&plan).of_those("s", variants);
            (lead.variant, lead.factors.into_iter().map(|level| level.value).collect::<Vec<_>>())
        };
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(values(&[VariantId(2)]), (some("bare+block=3"), vec![some("bare"), some("3"), some("sgbm")]));
        assert_eq!(values(&[0, 1].map(VariantId)), (some("full+block=3"), vec![some("full"), None, some("hh")]));
        assert_eq!(values(&[0, 1, 2].map(VariantId)), (None, vec![None, None, None]));
    }

    #[test]
    fn an_axis_that_is_called_as_a_column_has_a_name_of_its_own_and_numbers_are_numbers() {
        let plan = plan();
        let keys = RowKeys::new(&plan);
        let all = [VariantId(0), VariantId(1), VariantId(2)];
        let leads = [keys.of("s", &[VariantId(1)]), keys.of_those("s", &all)];
        let columns = key_columns(&leads, |key| key, vec![Rows(&["a", "b"]).key("node", |node| *node)]);
        let table = Table::new(columns);
        let expected = "stage,variant,node,axis.variant,block,mode\ns,full+block=9,a,full,9,hh\ns,,b,,,\n";
        assert_eq!(String::from_utf8(table.csv()).unwrap(), expected);
        assert_eq!(serde_json::to_value(table.json_rows()).unwrap()[0]["block"], json!(9));
        assert_eq!(["abs_rel", "error_p50_m", "blocks"].map(column_of), ["axis.abs_rel", "axis.error_p50_m", "blocks"]);
    }

    #[test]
    fn the_key_is_that_of_the_plan_alone() {
        let other = RecordedPlan { every: 2, ..plan() };
        assert_eq!(plan_key(&plan()), plan_key(&plan()));
        assert_ne!(plan_key(&plan()), plan_key(&other));
    }
}
