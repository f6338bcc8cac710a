//! Row keys: the first columns of all tables.
//!
//! These are `stage` and `variant`; then `estimate` and `set` for scores and errors, or `node` for timings and
//! training; then one column per axis of the experiment's matrix. `variant` is null if all variants share the row.
//! Tables, figures and comparisons have the same key columns, so that programs can join them.

use depthloom_graphs::Key;
use depthloom_graphs::plan::VariantId;
use depthloom_recording::RecordedPlan;
use depthloom_scores::Metric;
use serde::{Deserialize, Serialize};

use super::{Column, Rows};

/// The first columns of a table of estimates.
pub const KEY_COLUMNS: [&str; 4] = ["stage", "variant", "estimate", "set"];

/// The pixels that are valid in all estimates with one ground truth and the same settings, as named in `set`.
pub const COMMON: &str = "common";

/// All other columns of tables except metrics. An axis with such a name gets a prefix. In tests
/// [`Table::parquet`](super::Table::parquet) checks that the list is complete.
const RESERVED: &str = "axis baseline baseline_m best_overall bias_m bin_from bin_from_m bin_from_px bin_to bin_to_m bin_to_px change count cpu_ns density \
    difference difference_high difference_high_m difference_low difference_low_m difference_m disparity_density disparity_frames \
    disparity_pixels frame frames jitter_ns outlier_share learning_rate level loss losses mean median_cpu_ns ms node p p_from p_holm phase pixels \
    position rmse_m rows run score scoring share statistic step ties ground_truth_m unit validation value value_m verdict wall_ns wins x y zone";
/// Prefixes of further columns.
const RESERVED_STARTS: [&str; 6] = ["paper_", "error_", "relative_", "baseline_", "latency_", "axis."];

/// The stage, variant and levels of a row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowKey {
    /// The stage's name.
    pub stage: String,
    /// The variant; `None` if all variants share the row. If several but not all share it, the first of them.
    pub variant: Option<String>,
    /// The levels on the axes of the experiment's matrix; every row has the same axes.
    pub factors: Vec<Level>,
}

/// An axis of the matrix and its value in a row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// The axis, as in the names of variants.
    pub axis: String,
    /// Its column: the name of the axis, or `axis.<axis>` if tables have another column with this name.
    pub column: String,
    /// The value as written in the experiment. `None` if the variant does not have the axis, or if variants that share
    /// the row have different values.
    pub value: Option<String>,
    /// Whether all values of the axis are numbers.
    pub is_numeric: bool,
}

/// Builds row keys with the axes of an experiment's matrix.
pub struct RowKeys<'a> {
    plan: &'a RecordedPlan,
    /// The axes in the order of variants' names, without a value.
    axes: Vec<Level>,
}

impl<'a> RowKeys<'a> {
    /// Reads the axes of a plan.
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

    /// The key of a row that all variants share.
    pub(crate) fn shared_by_all(&self, stage: &str) -> RowKey {
        RowKey { stage: stage.to_owned(), variant: None, factors: self.axes.clone() }
    }

    /// The key of a row that these variants share.
    #[must_use]
    pub fn for_variants(&self, stage: &str, variants: &[VariantId]) -> RowKey {
        if variants.len() < self.plan.variants.len() {
            self.for_some(stage, variants)
        } else {
            self.shared_by_all(stage)
        }
    }

    /// The key of a row that only these variants share.
    pub(crate) fn for_some(&self, stage: &str, own: &[VariantId]) -> RowKey {
        let value = |axis: &str| -> Option<&str> {
            let factor = |variant: VariantId| self.plan.factors_of(variant).iter().find(|factor| factor.axis == axis);
            let first = factor(*own.first()?)?.value.as_str();
            own[1..].iter().all(|&other| factor(other).is_some_and(|other| other.value == first)).then_some(first)
        };
        let level = |axis: &Level| Level { value: value(&axis.axis).map(str::to_owned), ..axis.clone() };
        let variant = first_variant(self.plan, own).map(str::to_owned);
        RowKey { stage: stage.to_owned(), variant, factors: self.axes.iter().map(level).collect() }
    }
}

impl RowKey {
    /// The level on an axis.
    pub(crate) fn level(&self, axis: &str) -> Option<&Level> {
        self.factors.iter().find(|level| level.axis == axis)
    }
}

/// The key columns of these rows: stage, variant, `own`, and the axes.
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

/// The key of a run's plan. Equal experiments have equal keys on all machines. Parquet files contain it in their
/// metadata.
#[must_use]
#[expect(clippy::missing_panics_doc, reason = "every plan can be written as JSON")]
pub fn plan_key(plan: &RecordedPlan) -> Key {
    let json = serde_json::to_vec(plan).expect("a plan was read from JSON");
    Key::digest("depthloom run").bytes(&json).finish()
}

/// The variant that represents these variants: the first one, or `None` if they are all variants.
#[must_use]
pub fn variant_of<'p>(plan: &'p RecordedPlan, variants: &[VariantId]) -> Option<&'p str> {
    (variants.len() < plan.variants.len()).then(|| first_variant(plan, variants)).flatten()
}

fn first_variant<'p>(plan: &'p RecordedPlan, variants: &[VariantId]) -> Option<&'p str> {
    let first = plan.variants.get(variants.first()?.0)?;
    (!first.is_empty()).then_some(first.as_str())
}

/// The name of an axis column.
fn column_of(axis: &str) -> String {
    if is_reserved(axis) { format!("axis.{axis}") } else { axis.to_owned() }
}

/// Whether tables have a column with this name that is not an axis.
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
        let plan =
            json!({ "experiment": "x", "description": "", "variants": [], "every": 1, "view": false, "runs": [] });
        let mut plan = RecordedPlan::deserialize(plan).unwrap();
        let variants = [("full", "3", "hh"), ("full", "9", "hh"), ("bare", "3", "sgbm")];
        for (variant, block, mode) in variants {
            plan.variants.push(format!("{variant}+block={block}"));
            plan.factors.push(vec![factor("variant", variant), factor("block", block), factor("mode", mode)]);
        }
        plan
    }

    #[test]
    fn an_axis_is_null_if_all_variants_share_a_row_or_differ_on_it() {
        let plan = plan();
        let values = |variants: &[VariantId]| {
            let row_key = RowKeys::new(&plan).for_variants("s", variants);
            (row_key.variant, row_key.factors.into_iter().map(|level| level.value).collect::<Vec<_>>())
        };
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(values(&[VariantId(2)]), (some("bare+block=3"), vec![some("bare"), some("3"), some("sgbm")]));
        assert_eq!(values(&[0, 1].map(VariantId)), (some("full+block=3"), vec![some("full"), None, some("hh")]));
        assert_eq!(values(&[0, 1, 2].map(VariantId)), (None, vec![None, None, None]));
    }

    #[test]
    fn axes_with_the_name_of_a_column_get_a_prefix_and_numbers_stay_numbers() {
        let plan = plan();
        let keys = RowKeys::new(&plan);
        let all = [VariantId(0), VariantId(1), VariantId(2)];
        let row_keys = [keys.for_some("s", &[VariantId(1)]), keys.for_variants("s", &all)];
        let columns = key_columns(&row_keys, |key| key, vec![Rows(&["a", "b"]).key("node", |node| *node)]);
        let table = Table::new(columns);
        let expected = "stage,variant,node,axis.variant,block,mode\ns,full+block=9,a,full,9,hh\ns,,b,,,\n";
        assert_eq!(String::from_utf8(table.csv()).unwrap(), expected);
        assert_eq!(serde_json::to_value(table.json_rows()).unwrap()[0]["block"], json!(9));
        assert_eq!(["abs_rel", "error_p50_m", "blocks"].map(column_of), ["axis.abs_rel", "axis.error_p50_m", "blocks"]);
    }

    #[test]
    fn the_key_depends_only_on_the_plan() {
        let other = RecordedPlan { every: 2, ..plan() };
        assert_eq!(plan_key(&plan()), plan_key(&plan()));
        assert_ne!(plan_key(&plan()), plan_key(&other));
    }
}
