//! The parameters that request metrics.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use crate::{
    Align, Crop, DepthScores, DisparityScores, Family, Mean, Metric, PixelSet, Pooling, Preset, ScaleInvariant,
    Settings, Sparsification, SparsificationError, SquaredRelative, UncertaintyKind, ZoneParams,
};

/// How depths are scored, in an experiment and in a recording's plan: a preset, and what differs from it. Parameters of
/// `score/depth`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreParams {
    /// Named settings: `martins2018`, `monodepth2` or `kitti-depth`.
    pub preset: Preset,
    /// The pixel sets, one row each: `all` and `valid`.
    #[schemars(length(min = 1), schema_with = "depth_sets")]
    pub sets: Vec<PixelSet>,
    /// The metrics: a list of names, or `all`; `null`: the eight of Table I, and those of a connected `deviation` or
    /// `confidence`.
    #[schemars(schema_with = "depth_metrics")]
    pub metrics: Option<MetricNames>,
    /// What a data set's value is: the mean over `frames` of their values, or taken over all `pixels` of all frames.
    pub mean: Mean,
    /// Parts of the image that are scored separately, in addition to the whole.
    pub zones: ZoneParams,
    /// Ground truth above this is scored, and valid estimates below are raised to it, metres; `null`: the preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub min_m: Option<f64>,
    /// Ground truth below this is scored, and estimates above are lowered to it, metres; `null`: the preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub max_m: Option<f64>,
    /// The value of an invalid pixel in the set `all`, metres. It is not clamped, and can be below `min_m`; `null`: the
    /// preset's.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub missing_m: Option<f64>,
    /// The part of the image that is scored: `none`, `garg` or `eigen`; `null`: the preset's.
    pub crop: Option<Crop>,
    /// How estimates without a scale are aligned, frame by frame: `none`, `median` or `scale-and-shift`; `null`: the
    /// preset's.
    pub align: Option<Align>,
    /// The earlier name of `align`: `true` is `align: median`, `false` is `align: none`.
    pub median_scaling: Option<bool>,
    /// The formula of `sq_rel`: `by-truth` or `by-truth-squared`; `null`: the preset's.
    pub sq_rel: Option<SquaredRelative>,
    /// The formula of `silog`: `half-variance` or `hundred-deviation`; `null`: the preset's.
    pub silog: Option<ScaleInvariant>,
    /// The error of the sparsification curves of `ause`: `abs_rel` or `rmse`; `null`: `abs_rel`.
    pub ause_error: Option<SparsificationError>,
    /// The number of equal steps in which `ause` removes pixels; `null`: 100.
    #[schemars(range(min = 20, max = 100))]
    pub ause_steps: Option<u32>,
}

impl Default for ScoreParams {
    fn default() -> Self {
        Self {
            preset: Preset::Martins2018,
            sets: vec![PixelSet::All],
            metrics: None,
            mean: Mean::Frames,
            zones: ZoneParams::default(),
            min_m: None,
            max_m: None,
            missing_m: None,
            crop: None,
            align: None,
            median_scaling: None,
            sq_rel: None,
            silog: None,
            ause_error: None,
            ause_steps: None,
        }
    }
}

impl ScoreParams {
    /// The preset's settings with what differs from it.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let preset = self.preset.settings();
        let median_scaling = |on| if on { Align::Median } else { Align::None };
        Settings {
            min_m: self.min_m.unwrap_or(preset.min_m),
            max_m: self.max_m.unwrap_or(preset.max_m),
            missing_m: self.missing_m.unwrap_or(preset.missing_m),
            crop: self.crop.unwrap_or(preset.crop),
            align: self.align.or(self.median_scaling.map(median_scaling)).unwrap_or(preset.align),
            sq_rel: self.sq_rel.unwrap_or(preset.sq_rel),
            silog: self.silog.unwrap_or(preset.silog),
        }
    }

    /// How `ause` removes pixels.
    #[must_use]
    pub fn sparsification(&self) -> Sparsification {
        let default = Sparsification::default();
        Sparsification {
            error: self.ause_error.unwrap_or(default.error),
            steps: self.ause_steps.unwrap_or(default.steps),
        }
    }

    /// Whether these parameters can be scored with.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        self.scores().map(drop)
    }

    /// Whether all requested metrics can have a value. An experiment that requests others is refused; a recording of
    /// one can be read.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn check_values(&self) -> Result<(), (&'static str, String)> {
        if let (Mean::Pixels, Some(MetricNames::Listed(_))) = (self.mean, &self.metrics)
            && let Some(metric) =
                self.metrics(UncertaintyKind::None)?.into_iter().find(|metric| metric.pooling == Pooling::None)
        {
            let what = format!("metrics names {}, which has no value over all pixels of all frames", metric.name);
            return Err(("metrics", format!("{what}: leave it out, or take `mean: frames`")));
        }
        let Settings { min_m, max_m, .. } = self.settings();
        match self.zones.distance_m.windows(2).find(|band| band[0] >= max_m || band[1] <= min_m) {
            None => Ok(()),
            Some(band) => {
                let what = format!("zones: the band {}..{} holds nothing", band[0], band[1]);
                let what = format!("{what}: ground truth is scored from {min_m} to {max_m} m (min_m, max_m)");
                Err(("zones", format!("{what}: leave it out, or let them reach farther")))
            }
        }
    }

    /// What takes these scores. Of an estimate without an uncertainty, its rows leave out the metrics of one.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn scores(&self) -> Result<DepthScores, (&'static str, String)> {
        check_sets(&self.sets)?;
        if self.sets.contains(&PixelSet::Filled) {
            let what = "sets names `filled`, which is for disparities: depths have `all` and `valid`";
            return Err(("sets", what.to_owned()));
        }
        if self.align.is_some() && self.median_scaling.is_some() {
            return Err(("median_scaling", "median_scaling is what align says: leave it out".to_owned()));
        }
        self.zones.check().map_err(|what| ("zones", format!("zones: {what}")))?;
        self.settings().check().map_err(|(name, what)| (name, format!("{name} {what}")))?;
        let metrics = self.metrics(UncertaintyKind::Deviation)?;
        let sparsification = self.sparsification();
        if !(20..=100).contains(&sparsification.steps) {
            return Err(("ause_steps", format!("ause_steps must be from 20 to 100, not {}", sparsification.steps)));
        }
        let (settings, sets, zones) = (self.settings(), self.sets.clone(), self.zones.clone());
        Ok(DepthScores { settings, sets, metrics, zones, sparsification })
    }

    /// The scores that are taken of an estimate with this uncertainty, in the catalogue's order.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn metrics(&self, uncertainty: UncertaintyKind) -> Result<Vec<&'static Metric>, (&'static str, String)> {
        let mut metrics = metrics_of(self.metrics.as_ref(), Family::Depth)?;
        match &self.metrics {
            Some(MetricNames::Listed(_)) => {}
            Some(MetricNames::Word(_)) => metrics.retain(|metric| uncertainty.allows(metric)),
            None => metrics.extend(Family::Depth.metrics().iter().filter(|metric| {
                let has_value = self.mean == Mean::Frames || metric.pooling != Pooling::None;
                !UncertaintyKind::None.allows(metric) && uncertainty.allows(metric) && has_value
            })),
        }
        Ok(metrics)
    }
}

/// How disparities are scored, in an experiment and in a recording's plan. Parameters of `score/disparity`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DisparityScoreParams {
    /// The pixel sets, one row each: `all` (an invalid pixel is wrong), `valid`, and `filled` (every pixel with ground
    /// truth, after the KITTI devkit's interpolation of invalid pixels).
    #[schemars(length(min = 1))]
    pub sets: Vec<PixelSet>,
    /// The metrics: a list of names, or `all`; `null`: all.
    #[schemars(schema_with = "disparity_metrics")]
    pub metrics: Option<MetricNames>,
    /// What a data set's value is: the mean over `frames` of their values, or taken over all `pixels` of all frames, as
    /// KITTI stereo 2015 does for D1.
    pub mean: Mean,
    /// Parts of the image that are scored separately, in addition to the whole.
    pub zones: ZoneParams,
}

impl Default for DisparityScoreParams {
    fn default() -> Self {
        Self { sets: vec![PixelSet::All], metrics: None, mean: Mean::Frames, zones: ZoneParams::default() }
    }
}

impl DisparityScoreParams {
    /// Whether these parameters can be scored with.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        self.scores().map(drop)
    }

    /// What takes these scores.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn scores(&self) -> Result<DisparityScores, (&'static str, String)> {
        check_sets(&self.sets)?;
        self.zones.check().map_err(|what| ("zones", format!("zones: {what}")))?;
        Ok(DisparityScores { sets: self.sets.clone(), metrics: self.metrics()?, zones: self.zones.clone() })
    }

    /// The scores that are taken, in the catalogue's order.
    ///
    /// # Errors
    /// The parameter at fault, by its name, and why.
    pub fn metrics(&self) -> Result<Vec<&'static Metric>, (&'static str, String)> {
        metrics_of(self.metrics.as_ref(), Family::Disparity)
    }
}

/// Names of scores: a list of them, or `all`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MetricNames {
    /// `all`, and nothing else.
    Word(String),
    /// The names, in any order.
    Listed(Vec<String>),
}

fn check_sets(sets: &[PixelSet]) -> Result<(), (&'static str, String)> {
    if sets.is_empty() {
        return Err(("sets", "sets is empty: name `all`, `valid` or both".to_owned()));
    }
    match sets.iter().enumerate().any(|(i, set)| sets[..i].contains(set)) {
        true => Err(("sets", "sets names a pixel set twice".to_owned())),
        false => Ok(()),
    }
}

/// The scores of these names, in the catalogue's order.
fn metrics_of(names: Option<&MetricNames>, family: Family) -> Result<Vec<&'static Metric>, (&'static str, String)> {
    let all = || family.metrics().iter();
    let (names, word) = match names {
        None => return Ok(family.defaults()),
        Some(MetricNames::Word(word)) if word == "all" => return Ok(all().collect()),
        Some(MetricNames::Word(word)) => (std::slice::from_ref(word), true),
        Some(MetricNames::Listed(names)) => (names.as_slice(), false),
    };
    let known = || all().map(|metric| metric.name).collect::<Vec<_>>().join(", ");
    if let Some(name) = names.iter().find(|name| !all().any(|metric| metric.name == **name)) {
        return Err(("metrics", format!("metrics contains the unknown name `{name}`: expected one of {}", known())));
    }
    if word || names.is_empty() {
        return Err(("metrics", format!("metrics must be `all` or a list of {}", known())));
    }
    match names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        Some((_, name)) => Err(("metrics", format!("metrics names `{name}` twice"))),
        None => Ok(all().filter(|metric| names.iter().any(|name| name == metric.name)).collect()),
    }
}

fn depth_sets(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "array", "minItems": 1, "items": { "enum": ["all", "valid"] } })
}

fn depth_metrics(_: &mut SchemaGenerator) -> Schema {
    schema_of(Family::Depth)
}

fn disparity_metrics(_: &mut SchemaGenerator) -> Schema {
    schema_of(Family::Disparity)
}

fn schema_of(family: Family) -> Schema {
    let names: Vec<&str> = family.metrics().iter().map(|metric| metric.name).collect();
    json_schema!({ "anyOf": [
        { "enum": ["all"] },
        { "type": "array", "minItems": 1, "items": { "enum": names } },
        { "type": "null" },
    ] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clues, DEPTH};

    fn requested(metrics: MetricNames) -> Result<Vec<&'static str>, String> {
        let params = ScoreParams { metrics: Some(metrics), ..ScoreParams::default() };
        let names = |metrics: Vec<&'static Metric>| metrics.into_iter().map(|metric| metric.name).collect();
        params.metrics(UncertaintyKind::Deviation).map(names).map_err(|(_, what)| what)
    }

    fn listed(names: &[&str]) -> MetricNames {
        MetricNames::Listed(names.iter().map(|name| (*name).to_owned()).collect())
    }

    #[test]
    fn scores_come_in_the_catalogues_order_and_unknown_ones_are_refused() {
        assert_eq!(requested(listed(&["mae", "a1"])), Ok(vec!["a1", "mae"]));
        assert_eq!(requested(MetricNames::Word("all".to_owned())).unwrap().len(), DEPTH.len());
        assert!(
            requested(listed(&["d1"]))
                .unwrap_err()
                .starts_with("metrics contains the unknown name `d1`: expected one of a1, a2")
        );
        assert!(requested(listed(&[])).unwrap_err().starts_with("metrics must be `all` or a list of"));
        assert!(requested(MetricNames::Word("a1".to_owned())).unwrap_err().starts_with("metrics must be"));
        assert_eq!(requested(listed(&["a1", "a1"])), Err("metrics names `a1` twice".to_owned()));
    }

    #[test]
    fn an_uncertainty_adds_its_metrics_unless_metrics_are_listed() {
        let names = |params: &ScoreParams, kind| {
            let metrics = params.metrics(kind).unwrap();
            metrics.into_iter().skip(8).map(|metric| metric.name).collect::<Vec<_>>()
        };
        let params = ScoreParams::default();
        assert_eq!(names(&params, UncertaintyKind::Deviation), ["coverage", "coverage_2", "ause"]);
        assert_eq!(names(&params, UncertaintyKind::Confidence), ["ause"]);
        assert!(names(&params, UncertaintyKind::None).is_empty());
        let pooled = ScoreParams { mean: Mean::Pixels, ..ScoreParams::default() };
        assert_eq!(names(&pooled, UncertaintyKind::Deviation), ["coverage", "coverage_2"], "areas cannot be pooled");
        let few = ScoreParams { ause_steps: Some(10), ..ScoreParams::default() };
        assert_eq!(few.check().unwrap_err(), ("ause_steps", "ause_steps must be from 20 to 100, not 10".to_owned()));
    }

    #[test]
    fn the_older_word_for_alignment_is_understood_and_not_beside_the_newer_one() {
        let older = |on| ScoreParams { median_scaling: Some(on), preset: Preset::Monodepth2, ..ScoreParams::default() };
        assert_eq!((older(true).settings().align, older(false).settings().align), (Align::Median, Align::None));
        let both = ScoreParams { align: Some(Align::None), ..older(true) };
        assert_eq!(both.check().unwrap_err().0, "median_scaling");
    }

    #[test]
    fn what_can_have_no_value_is_refused() {
        let pixels = |metrics| ScoreParams { mean: Mean::Pixels, metrics: Some(metrics), ..ScoreParams::default() };
        let (name, what) = pixels(listed(&["mae", "median_error"])).check_values().unwrap_err();
        assert!(name == "metrics" && what.contains("median_error, which has no value over all pixels"), "{what}");
        assert_eq!(pixels(listed(&["mae"])).check_values(), Ok(()));
        assert_eq!(pixels(MetricNames::Word("all".to_owned())).check_values(), Ok(()), "all that there are");
        let bands = |distance_m: &[f64], max_m| {
            let zones = ZoneParams { distance_m: distance_m.to_vec(), ..ZoneParams::default() };
            ScoreParams { zones, max_m, ..ScoreParams::default() }.check_values()
        };
        let (name, what) = bands(&[0.0, 50.0, 80.0, 120.0], None).unwrap_err();
        assert!(name == "zones" && what.starts_with("zones: the band 80..120 holds nothing"), "{what}");
        assert_eq!((bands(&[0.0, 50.0, 120.0], None), bands(&[80.0, 120.0], Some(120.0))), (Ok(()), Ok(())));
    }

    /// Against the formulas written out, on valid pixels and one invalid pixel: 1e-4 m.
    #[test]
    fn scores_beyond_table_1_are_their_formulas() {
        let params = ScoreParams {
            metrics: Some(MetricNames::Word("all".to_owned())),
            sets: vec![PixelSet::Valid, PixelSet::All],
            ..ScoreParams::default()
        };
        let (truth, estimate) = ([10.0, 20.0, 40.0, 5.0], [10.4, 21.5, 20.0, f32::NAN]);
        let rows = params.scores().unwrap().rows(&estimate, &truth, (4, 1), &Clues::default());
        let close = |row: usize, name: &str, expected: f64| {
            let ours = rows[row].score(name).unwrap();
            assert!((ours - expected).abs() <= 1e-6 * expected, "{name}: {ours}, not {expected}");
        };
        let (ln10, y) = (std::f64::consts::LN_10, [10.4_f64, 21.5, 20.0]);
        let logs = [(y[0] / 10.0).ln(), (y[1] / 20.0).ln(), 2_f64.ln()];
        close(0, "log10", logs.iter().sum::<f64>() / 3.0 / ln10);
        close(0, "mae", (0.4 + 1.5 + 20.0) / 3.0);
        close(0, "median_error", 1.5);
        let inverse = [100.0 - 1000.0 / y[0], 50.0 - 1000.0 / y[1], 25.0];
        close(0, "imae", inverse.iter().sum::<f64>() / 3.0);
        close(0, "irmse", (inverse.iter().map(|e| e * e).sum::<f64>() / 3.0).sqrt());
        close(0, "delta_1.05", 1.0 / 3.0);
        close(0, "delta_1.10", 2.0 / 3.0);
        close(1, "mae", (0.4 + 1.5 + 20.0 + 4.9999) / 4.0);
        close(1, "median_error", f64::midpoint(1.5, 4.9999));
        close(1, "imae", (inverse.iter().sum::<f64>() + 1e7 - 200.0) / 4.0);
        close(1, "delta_1.10", 0.5);
        let names: Vec<&str> = rows[0].scores.iter().map(|(metric, _)| metric.name).collect();
        let without_uncertainty: Vec<&str> =
            DEPTH.iter().filter(|metric| UncertaintyKind::None.allows(metric)).map(|metric| metric.name).collect();
        assert_eq!((names, without_uncertainty.len()), (without_uncertainty.clone(), DEPTH.len() - 3));
    }
}
