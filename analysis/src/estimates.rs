//! The estimates that a recording scored, in the order of all tables and plots.

use std::collections::HashSet;

use depthloom_graphs::language::glob;
use depthloom_graphs::plan::{RunId, VariantId};
use depthloom_recording::RecordedPlan;
use depthloom_scores::{
    DisparityScoreParams, Family, Mean, Metric, PixelSet, Preset, ScoreParams, Settings, Sparsification,
    UncertaintyKind,
};
use serde_json::{Value, json};

use crate::error::{AnalysisError, unknown};
use crate::tables::{Column, RowKey, RowKeys, Rows, key_columns};
use crate::titles::Titles;

/// The kind that scores disparities; all other kinds score depths.
const DISPARITY: &str = "score/disparity";

/// An estimate that was scored against ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Its label: `name` if it is the same in all variants, otherwise `variant/name`.
    pub label: String,
    /// What readers see instead of the label, if the experiment has labels.
    pub title: String,
    /// What readers see instead of the variant.
    pub variant_title: Option<String>,
    /// What readers see instead of the name.
    pub name_title: String,
    /// Its name under `estimates:`, as in tables, which have columns for stage and variant.
    pub name: String,
    /// Its stage, and its variant if it is not the same in all variants.
    pub row_key: RowKey,
    /// Index of the stage run in the recorded plan.
    pub run: RunId,
    /// Whether depths or disparities were scored.
    pub family: Family,
    /// The pixel sets it was scored on.
    pub sets: Vec<PixelSet>,
    /// The metrics, in the order of the catalogue.
    pub metrics: Vec<&'static Metric>,
    /// How the value of a data set is averaged.
    pub mean: Mean,
    /// The settings of depth scores; `None` for disparities, which have no bounds.
    pub settings: Option<Settings>,
    /// Describes the scoring: the preset, and the parameters that differ from it.
    pub preset: String,
    /// The topic of its scores; `None` if they were not recorded.
    pub score_topic: Option<String>,
    /// The topic of the estimated depth; `None` if it was not recorded.
    pub estimate_topic: Option<String>,
    /// The topic of the ground-truth depth; `None` if it was not recorded.
    pub truth_topic: Option<String>,
    /// The topic of the output that is scored, recorded or not; `None` if the recording does not name it.
    pub scored_output: Option<String>,
    /// The topic of the output with the ground truth, recorded or not; `None` if the recording does not name it.
    pub truth_output: Option<String>,
    /// The uncertainty that it predicts, if it was scored.
    pub uncertainty: Option<PredictedUncertainty>,
}

/// The predicted uncertainty of an estimate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PredictedUncertainty {
    /// What it is.
    pub kind: UncertaintyKind,
    /// The topic of its output, recorded or not.
    pub output: String,
    /// How pixels are removed for `ause`.
    pub sparsification: Sparsification,
}

/// The recorded maps that an estimate's error against distance is computed from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Compared<'a> {
    pub(crate) truth_topic: &'a str,
    pub(crate) estimate_topic: &'a str,
    pub(crate) settings: &'a Settings,
}

impl Estimate {
    /// Its maps; `None` for disparities, and if one of the maps was not recorded.
    pub(crate) fn compared(&self) -> Option<Compared<'_>> {
        let (truth_topic, estimate_topic) = (self.truth_topic.as_deref()?, self.estimate_topic.as_deref()?);
        Some(Compared { truth_topic, estimate_topic, settings: self.settings.as_ref()? })
    }
}

/// The estimates of a recording: first those that all variants share, then variant by variant. Variants and estimates
/// with labels come first, in the order of the labels, then the others in the order of the file.
///
/// # Errors
/// If this version does not know the parameters of a score node, or the plan is damaged.
pub(crate) fn estimates(plan: &RecordedPlan) -> Result<Vec<Estimate>, AnalysisError> {
    let all = || {
        RunId::enumerate(&plan.runs).flat_map(|(r, run)| run.estimates.iter().map(move |estimate| (r, run, estimate)))
    };
    let mut labels = HashSet::new();
    let repeated: HashSet<&str> =
        all().map(|(.., e)| e.label.as_str()).filter(|label| !labels.insert(*label)).collect();
    let (row_keys, titles) = (RowKeys::new(plan), Titles::new([plan]));
    let mut ordered = Vec::new();
    for (run, planned, estimate) in all() {
        let scoring = planned.nodes.get(estimate.score_node.0);
        let from =
            |port: &str| scoring.and_then(|node| node.inputs.iter().find(|input| input.port == port)?.from.clone());
        let (uncertainty, uncertainty_output) = match (from("deviation"), from("confidence")) {
            (Some(output), _) => (UncertaintyKind::Deviation, Some(output)),
            (None, Some(output)) => (UncertaintyKind::Confidence, Some(output)),
            (None, None) => (UncertaintyKind::None, None),
        };
        let kind = scoring.map_or("", |node| node.kind.as_str());
        let parameters = score_parameters(kind, &estimate.score_params, uncertainty).map_err(|error| {
            AnalysisError::content(format!("invalid score parameters of `{}`: {error}", estimate.label))
        })?;
        let preset = parameters.described();
        let ScoreParameters { family, sets, metrics, mean, settings, sparsification, .. } = parameters;
        // Two stages may score estimates of one name.
        let label = match repeated.contains(estimate.label.as_str()) {
            true => format!("{}.{}", planned.stage, estimate.label),
            false => estimate.label.clone(),
        };
        let named = |v: VariantId| {
            let what = || {
                format!(
                    "the recording's plan is damaged: `{label}` belongs to variant {v}, but there are {} variants",
                    plan.variants.len()
                )
            };
            plan.variants.get(v.0).cloned().ok_or_else(|| AnalysisError::content(what()))
        };
        estimate.variant.map(named).transpose()?;
        let row_key = match estimate.variant {
            Some(variant) => row_keys.for_some(&planned.stage, &[variant]),
            None => row_keys.shared_by_all(&planned.stage),
        };
        let variant_place =
            estimate.variant.map(|v| (plan.labels.variant_place(&plan.variants[v.0], plan.factors_of(v)), v));
        let place = (variant_place, plan.labels.estimate_place(&estimate.name));
        let variant = row_key.variant.as_deref();
        let estimate = Estimate {
            title: titles.full(&label, variant, &estimate.name),
            variant_title: variant.map(|variant| titles.variant(variant).to_owned()),
            name_title: titles.estimate(&estimate.name).to_owned(),
            label,
            name: estimate.name.clone(),
            row_key,
            run,
            family,
            sets,
            metrics,
            mean,
            settings,
            preset,
            score_topic: estimate.score_topic.clone(),
            estimate_topic: estimate.estimate_topic.clone(),
            truth_topic: estimate.truth_topic.clone(),
            scored_output: from("estimate"),
            truth_output: from("ground_truth"),
            uncertainty: uncertainty_output.map(|output| PredictedUncertainty {
                kind: uncertainty,
                output,
                sparsification,
            }),
        };
        ordered.push((place, estimate));
    }
    ordered.sort_by(|(one, _), (other, _)| one.cmp(other));
    Ok(ordered.into_iter().map(|(_, estimate)| estimate).collect())
}

/// The key columns of tables with one row per estimate and pixel set; `more` is placed before the axes.
pub(crate) fn estimate_columns<'r, R>(
    rows: &'r [R],
    key: impl Fn(&'r R) -> (&'r Estimate, &'r str),
    more: Option<Column>,
) -> Vec<Column> {
    let cells = Rows(rows);
    let mut own = vec![cells.key("estimate", |row| &key(row).0.name), cells.key("set", |row| key(row).1)];
    own.extend(more);
    key_columns(rows, |row| &key(row).0.row_key, own)
}

/// The distinct names of estimates: those under `estimates:`, then labels.
pub(crate) fn estimate_names(estimates: &[Estimate]) -> Vec<&str> {
    let names = estimates.iter().map(|estimate| estimate.name.as_str());
    let mut seen = HashSet::new();
    names.chain(estimates.iter().map(|estimate| estimate.label.as_str())).filter(|name| seen.insert(*name)).collect()
}

/// Whether one of the patterns, separated by commas, matches the label or the name of an estimate.
pub(crate) fn matches_estimate(estimate: &Estimate, patterns: &str) -> bool {
    pattern_matches(patterns, &estimate.label) || pattern_matches(patterns, &estimate.name)
}

pub(crate) fn pattern_matches(patterns: &str, name: &str) -> bool {
    // A name may contain a comma.
    glob(patterns, name) || patterns.split(',').any(|pattern| glob(pattern.trim(), name))
}

/// Checks that each pattern matches an estimate.
pub(crate) fn check_patterns(patterns: &str, estimates: &[Estimate]) -> Result<(), AnalysisError> {
    let names = estimate_names(estimates);
    let is_one = |pattern: &str| names.iter().any(|name| glob(pattern, name));
    match patterns.split(',').map(str::trim).find(|pattern| !is_one(pattern)) {
        Some(pattern) if !is_one(patterns) => Err(unknown("estimate", pattern, names.iter().copied())),
        _ => Ok(()),
    }
}

/// The patterns that match an estimate, separated by commas; `None` if none does.
pub(crate) fn matching_patterns(patterns: &str, estimates: &[Estimate]) -> Option<String> {
    let names = estimate_names(estimates);
    let is_one = |pattern: &&str| names.iter().any(|name| glob(pattern, name));
    if is_one(&patterns) {
        return Some(patterns.to_owned());
    }
    let found: Vec<&str> = patterns.split(',').map(str::trim).filter(is_one).collect();
    (!found.is_empty()).then(|| found.join(","))
}

/// The recorded parameters of a score node.
struct ScoreParameters {
    family: Family,
    sets: Vec<PixelSet>,
    metrics: Vec<&'static Metric>,
    mean: Mean,
    /// Of depths.
    preset: Option<Preset>,
    settings: Option<Settings>,
    sparsification: Sparsification,
}

impl ScoreParameters {
    /// Describes the scoring: `preset martins2018`, `preset martins2018 with crop garg and max_m 50`. Only settings
    /// that differ from the preset's are named, however they are written: equal scorings have equal descriptions.
    fn described(&self) -> String {
        let (Some(preset), Some(settings)) = (self.preset, self.settings) else { return "disparities".to_owned() };
        let own = named(settings, self.sparsification);
        let of_preset = named(preset.settings(), Sparsification::default());
        let differing = own.into_iter().zip(of_preset).filter(|(own, preset)| own != preset);
        let differing: Vec<String> = differing.map(|((name, value), _)| format!("{name} {}", text(&value))).collect();
        let with = if differing.is_empty() { String::new() } else { format!(" with {}", differing.join(" and ")) };
        format!("preset {}{with}", text(&json!(preset)))
    }
}

/// Settings with their names in an experiment.
fn named(settings: Settings, removal: Sparsification) -> [(&'static str, Value); 9] {
    let Settings { min_m, max_m, missing_m, crop, align, sq_rel, silog } = settings;
    [
        ("align", json!(align)),
        ("ause_error", json!(removal.error)),
        ("ause_steps", json!(removal.steps)),
        ("crop", json!(crop)),
        ("max_m", json!(max_m)),
        ("min_m", json!(min_m)),
        ("missing_m", json!(missing_m)),
        ("silog", json!(silog)),
        ("sq_rel", json!(sq_rel)),
    ]
}

fn text(value: &Value) -> String {
    match (value.as_str(), value.as_f64()) {
        (Some(text), _) => text.to_owned(),
        // Without the decimal point that JSON has in whole numbers.
        (None, Some(number)) => number.to_string(),
        (None, None) => value.to_string(),
    }
}

/// Reads the recorded parameters of a score node of this kind, with the uncertainty of its estimate. Null parameters
/// have the values of the preset.
fn score_parameters(kind: &str, params: &Value, uncertainty: UncertaintyKind) -> Result<ScoreParameters, String> {
    if kind == DISPARITY {
        let params: DisparityScoreParams =
            serde_path_to_error::deserialize(params).map_err(|error| error.to_string())?;
        params.check().map_err(|(_, what)| what)?;
        let metrics = params.metrics().map_err(|(_, what)| what)?;
        let (sets, mean) = (params.sets, params.mean);
        let sparsification = Sparsification::default();
        let family = Family::Disparity;
        return Ok(ScoreParameters { family, sets, metrics, mean, preset: None, settings: None, sparsification });
    }
    let params: ScoreParams = serde_path_to_error::deserialize(params).map_err(|error| error.to_string())?;
    params.check().map_err(|(_, what)| what)?;
    let (metrics, settings) = (params.metrics(uncertainty).map_err(|(_, what)| what)?, Some(params.settings()));
    let sparsification = params.sparsification();
    let ScoreParams { sets, mean, preset, .. } = params;
    Ok(ScoreParameters { family: Family::Depth, sets, metrics, mean, preset: Some(preset), settings, sparsification })
}

#[cfg(test)]
impl Estimate {
    /// A depth estimate with the default settings.
    pub(crate) fn of_depths(label: &str, variant: Option<&str>, name: &str, sets: &[PixelSet]) -> Self {
        Self {
            label: label.to_owned(),
            title: label.to_owned(),
            variant_title: variant.map(str::to_owned),
            name_title: name.to_owned(),
            name: name.to_owned(),
            row_key: RowKey { stage: "s".to_owned(), variant: variant.map(str::to_owned), factors: Vec::new() },
            run: RunId(0),
            sets: sets.to_vec(),
            family: Family::Depth,
            metrics: Family::Depth.defaults(),
            mean: Mean::Frames,
            settings: Some(Settings::default()),
            preset: "preset martins2018".to_owned(),
            score_topic: None,
            estimate_topic: None,
            truth_topic: None,
            scored_output: None,
            truth_output: None,
            uncertainty: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use depthloom_scores::{Crop, ScaleInvariant};
    use serde::Deserialize;

    use super::*;

    fn settings(params: &Value) -> Result<(Vec<PixelSet>, Settings), String> {
        let read = score_parameters("score/depth", params, UncertaintyKind::None)?;
        Ok((read.sets, read.settings.expect("depths have settings")))
    }

    #[test]
    fn disparities_have_their_own_metrics() {
        let params = json!({ "sets": ["filled"], "metrics": ["d1", "epe"], "mean": "pixels" });
        let read = score_parameters(DISPARITY, &params, UncertaintyKind::None).unwrap();
        let names: Vec<&str> = read.metrics.iter().map(|metric| metric.name).collect();
        assert_eq!((names, read.family, read.mean), (vec!["epe", "d1"], Family::Disparity, Mean::Pixels));
        assert!(settings(&params).is_err(), "a depth has neither");
    }

    #[test]
    fn null_parameters_have_the_values_of_the_preset() {
        let params = json!({
            "preset": "monodepth2", "sets": ["valid", "all"], "min_m": null, "max_m": 50.0, "missing_m": null,
            "crop": "eigen", "median_scaling": null, "sq_rel": null, "silog": "hundred-deviation",
        });
        let (sets, read) = settings(&params).unwrap();
        assert_eq!(sets, [PixelSet::Valid, PixelSet::All]);
        let preset = Preset::Monodepth2.settings();
        let silog = ScaleInvariant::HundredDeviation;
        assert_eq!(read, Settings { max_m: 50.0, crop: Crop::Eigen, silog, ..preset });
    }

    #[test]
    fn equal_scorings_have_equal_descriptions() {
        let of_kind =
            |kind: &str, params: Value| score_parameters(kind, &params, UncertaintyKind::None).unwrap().described();
        let of_depths = |mut params: Value| {
            params["sets"] = json!(["all"]);
            of_kind("score/depth", params)
        };
        let written =
            json!({ "preset": "monodepth2", "crop": "garg", "max_m": 80.0, "align": "median", "silog": null });
        assert_eq!(of_depths(written), "preset monodepth2");
        assert_eq!(of_depths(json!({ "preset": "monodepth2", "median_scaling": true })), "preset monodepth2");
        let aligned = ["median_scaling", "align"].map(|name| {
            let value = if name == "align" { json!("median") } else { json!(true) };
            of_depths(json!({ "preset": "martins2018", "ause_steps": 100, name: value }))
        });
        assert_eq!(aligned, ["preset martins2018 with align median"; 2]);
        let other =
            json!({ "preset": "monodepth2", "max_m": 50.0, "align": "none", "ause_steps": 20, "ause_error": "rmse" });
        let expected = "preset monodepth2 with align none and ause_error rmse and ause_steps 20 and max_m 50";
        assert_eq!(of_depths(other), expected);
        assert_eq!(of_kind(DISPARITY, json!({ "sets": ["valid"], "metrics": ["epe"] })), "disparities");
    }

    #[test]
    fn fault_11_invalid_recorded_settings_are_refused_by_name() {
        let refused = |name: &str, value: Value| {
            let mut params = json!({ "preset": "martins2018", "sets": ["all"] });
            params[name] = value;
            settings(&params).unwrap_err()
        };
        assert!(refused("min_m", json!(90.0)).starts_with("max_m must be above min_m (90 m)"));
        assert!(refused("max_m", json!(-1)).starts_with("max_m "));
        assert!(refused("min_m", json!(0)).starts_with("min_m "));
        assert!(refused("missing_m", json!(1e-320)).starts_with("missing_m "));
    }

    #[test]
    fn fault_11_an_estimate_of_a_missing_variant_is_an_error() {
        let mut plan = json!({
            "experiment": "x", "description": "", "variants": ["a", "b"], "every": 1, "view": false,
            "runs": [{
                "stage": "s", "prefix": "/s", "variants": [0], "nodes": [],
                "source": { "name": "street", "parts": [], "outputs": [] },
                "estimates": [{
                    "label": "b/mono", "name": "mono", "variant": 1, "estimate_topic": null, "truth_topic": null,
                    "score_topic": null, "score_node": 7, "score_params": { "preset": "martins2018", "sets": ["all"] },
                }],
            }],
        });
        let read = |plan: &Value| estimates(&RecordedPlan::deserialize(plan).unwrap());
        assert_eq!(read(&plan).unwrap()[0].row_key.variant.as_deref(), Some("b"));
        plan["runs"][0]["estimates"][0]["variant"] = json!(9);
        let error = read(&plan).unwrap_err().to_string();
        assert_eq!(error, "the recording's plan is damaged: `b/mono` belongs to variant 9, but there are 2 variants");
    }

    #[test]
    fn settings_of_a_later_version_are_refused_by_name() {
        let mut params = json!({ "preset": "martins2018", "sets": ["all"] });
        assert_eq!(settings(&params), Ok((vec![PixelSet::All], Preset::Martins2018.settings())));
        params["crop"] = json!("benchmark");
        assert_eq!(
            settings(&params),
            Err("crop: unknown variant `benchmark`, expected one of `none`, `garg`, `eigen`".to_owned())
        );
    }

    #[test]
    fn fault_11_settings_that_no_experiment_can_have_are_refused() {
        let fine = json!({ "preset": "martins2018", "sets": ["all"] });
        let with = |name: &str, value: Value| {
            let mut params = fine.clone();
            params[name] = value;
            settings(&params).unwrap_err()
        };
        assert!(with("sets", json!([])).starts_with("sets is empty"));
        assert_eq!(with("sets", json!(["all", "all"])), "sets names a pixel set twice");
        assert!(with("min_m", json!(90.0)).starts_with("max_m must be above min_m"));
        assert!(with("max_m", json!(-1.0)).starts_with("max_m"));
        assert!(with("missing_m", json!(0.0)).starts_with("missing_m"));
        assert!(with("cap", json!(80)).contains("unknown field `cap`"));
    }
}
