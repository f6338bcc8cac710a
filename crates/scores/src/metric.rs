//! The catalogue of scores: the one place that names, formats and explains them.
//!
//! Headers of tables, columns of `scores.csv`, fields of the recorded message and the docs of the kinds `score/*` come
//! from here.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{PixelSet, ScaleInvariant, ScoreRow, Settings, SquaredRelative};

/// A score: what it is called, where it comes from, how it is shown.
#[derive(Clone, Copy, PartialEq)]
pub struct Metric {
    /// Its name in YAML, in CSV files and on the command line; unique over all families.
    pub name: &'static str,
    /// `""` (a share, or a number without a unit), `m`, `px` or `1/km`.
    pub unit: &'static str,
    /// Its name where there is room for it.
    pub plain: &'static str,
    /// The same for LaTeX.
    pub latex: &'static str,
    /// What papers put above a column of it, for LaTeX.
    pub heading: &'static str,
    /// Whether more of it is better.
    pub more_is_better: bool,
    /// The value of a perfect prediction, if that is neither the largest nor the smallest: nearer is better.
    pub nominal: Option<f64>,
    /// How many decimals are worth showing.
    pub decimals: usize,
    /// What it is, over the `N` pixels that count: `y` the estimate and `t` the ground truth in metres, `e = ln y - ln
    /// t`; of disparities `d` the estimate and `t` the ground truth in pixels.
    pub formula: &'static str,
    /// The publication or code that defines it.
    pub source: &'static str,
    /// How a data set's value over pixels follows from those of its frames.
    pub pooling: Pooling,
    /// The number of its field in the recorded message `depthloom.Score`: for good, whatever the order here.
    pub field: u32,
}

/// How a data set's value over pixels follows from its frames' values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pooling {
    /// Of means over the pixels that counted: `sum(n x) / sum(n)`.
    Mean,
    /// As `Mean`, but with the number of valid pixels, also in sets in which invalid pixels count.
    MeanOfValid,
    /// Of roots of means: `sqrt(sum(n x^2) / sum(n))`.
    RootMeanSquare,
    /// Of variances of the log error: with the frames' means of it.
    LogVariance,
    /// It does not follow: a median of all pixels does not follow from the frames' medians.
    None,
}

/// What a data set's value is taken over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(description = "What a data set's value is the mean over.")]
pub enum Mean {
    /// The unweighted mean of the frames' values: monodepth, BTS, AdaBins, the KITTI depth devkit.
    #[default]
    Frames,
    /// All pixels of all frames alike: KITTI stereo 2015.
    Pixels,
}

impl Mean {
    /// Its name in YAML and in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Pixels => "pixels",
        }
    }
}

/// What is scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// Depths, in metres: `score/depth`.
    Depth,
    /// Disparities, in pixels: `score/disparity`.
    Disparity,
}

// No nominal value is NaN.
impl Eq for Metric {}

impl fmt::Debug for Metric {
    /// Its name: the rest follows from it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Family {
    /// Its scores, in the order of every table.
    #[must_use]
    pub const fn metrics(self) -> &'static [Metric] {
        match self {
            Self::Depth => &DEPTH,
            Self::Disparity => &DISPARITY,
        }
    }

    /// The scores taken where none are named: of depths the eight of Table I, of disparities all.
    #[must_use]
    pub fn defaults(self) -> Vec<&'static Metric> {
        let many = match self {
            Self::Depth => TABLE_1,
            Self::Disparity => DISPARITY.len(),
        };
        self.metrics()[..many].iter().collect()
    }
}

impl Metric {
    /// How good a value is, for comparisons of two values: more is better.
    #[must_use]
    pub fn goodness(&self, value: f64) -> f64 {
        match (self.nominal, self.more_is_better) {
            (Some(nominal), _) => -(value - nominal).abs(),
            (None, true) => value,
            (None, false) => -value,
        }
    }

    /// Which of two values is better, in words.
    #[must_use]
    pub fn better(&self) -> String {
        match (self.nominal, self.more_is_better) {
            (Some(nominal), _) => format!("nearer to {nominal:.3} is better"),
            (None, true) => "more is better".to_owned(),
            (None, false) => "less is better".to_owned(),
        }
    }

    /// The score of that name, of any family.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        all().find(|metric| metric.name == name)
    }

    /// The score of that field of the recorded message.
    #[must_use]
    pub fn of_field(field: u32) -> Option<&'static Self> {
        all().find(|metric| metric.field == field)
    }

    /// The name of its field in the recorded message: as [`name`](Self::name), with `_` for what protobuf's names
    /// cannot have.
    #[must_use]
    pub fn field_name(&self) -> String {
        self.name.replace('.', "_")
    }

    /// Its place in the order of every table, over all families.
    #[must_use]
    pub fn place(&self) -> usize {
        all().position(|metric| metric.name == self.name).unwrap_or(usize::MAX)
    }

    /// The definition with these settings: [`formula`](Self::formula), except for the two names with two formulas.
    #[must_use]
    pub fn formula_with(&self, settings: &Settings) -> &'static str {
        match (self.name, settings.sq_rel, settings.silog) {
            ("sq_rel", SquaredRelative::ByTruthSquared, _) => "mean((y - t)^2 / t^2)",
            ("silog", _, ScaleInvariant::HundredDeviation) => "100 sqrt(mean((e - mean e)^2)), e = ln y - ln t",
            _ => self.formula,
        }
    }

    /// The number of pixels of a row that it averages over: the valid pixels, if an invalid pixel has no error to add.
    #[must_use]
    pub fn pixels(&self, row: &ScoreRow) -> u64 {
        match (self.pooling, row.set) {
            (Pooling::MeanOfValid, PixelSet::All) => row.valid,
            _ => row.pixels,
        }
    }

    /// A data set's value over the pixels of all frames: `None` if no pixel counted, or if it does not follow from the
    /// frames' values.
    #[must_use]
    pub fn pooled<'a>(&self, rows: impl IntoIterator<Item = &'a ScoreRow>, settings: &Settings) -> Option<f64> {
        let (mut count, mut sum, mut log_mean, mut spread) = (0.0, 0.0, 0.0, 0.0);
        for row in rows {
            let Some(value) = row.get(self) else { continue };
            if self.pooling == Pooling::None {
                return None;
            }
            let n = self.pixels(row) as f64;
            match self.pooling {
                Pooling::LogVariance => {
                    let variance = match settings.silog {
                        ScaleInvariant::HalfVariance => 2.0 * value,
                        ScaleInvariant::HundredDeviation => (value / 100.0).powi(2),
                    };
                    // As Chan, Golub, LeVeque 1979.
                    let apart = row.log_mean? - log_mean;
                    spread += n * variance + apart * apart * (count * n / (count + n));
                    log_mean += apart * (n / (count + n));
                }
                Pooling::RootMeanSquare => sum += n * value * value,
                Pooling::Mean | Pooling::MeanOfValid | Pooling::None => sum += n * value,
            }
            count += n;
        }
        (count > 0.0).then(|| match (self.pooling, settings.silog) {
            (Pooling::LogVariance, ScaleInvariant::HalfVariance) => 0.5 * (spread / count),
            (Pooling::LogVariance, ScaleInvariant::HundredDeviation) => 100.0 * (spread / count).sqrt(),
            (Pooling::RootMeanSquare, _) => (sum / count).sqrt(),
            _ => sum / count,
        })
    }
}

/// All scores, family after family.
fn all() -> impl Iterator<Item = &'static Metric> {
    DEPTH.iter().chain(&DISPARITY)
}

/// How many of [`DEPTH`], the first ones, are those of Table I of Martins et al. 2018.
const TABLE_1: usize = 8;

const EIGEN: &str = "Eigen et al. 2014";

/// The scores of depths: first the eight of Table I in its order, called as there.
pub static DEPTH: [Metric; 18] = [
    Metric {
        name: "a1",
        unit: "",
        plain: "a1 (< 1.25)",
        latex: r"threshold $\delta < 1.25$",
        heading: r"$\delta<1.25$",
        more_is_better: true,
        nominal: None,
        decimals: 3,
        formula: "share with max(y/t, t/y) < 1.25",
        source: EIGEN,
        pooling: Pooling::Mean,
        field: 4,
    },
    Metric {
        name: "a2",
        unit: "",
        plain: "a2 (< 1.25^2)",
        latex: r"threshold $\delta < 1.25^2$",
        heading: r"$\delta<1.25^2$",
        more_is_better: true,
        nominal: None,
        decimals: 3,
        formula: "share with max(y/t, t/y) < 1.25^2",
        source: EIGEN,
        pooling: Pooling::Mean,
        field: 5,
    },
    Metric {
        name: "a3",
        unit: "",
        plain: "a3 (< 1.25^3)",
        latex: r"threshold $\delta < 1.25^3$",
        heading: r"$\delta<1.25^3$",
        more_is_better: true,
        nominal: None,
        decimals: 3,
        formula: "share with max(y/t, t/y) < 1.25^3",
        source: EIGEN,
        pooling: Pooling::Mean,
        field: 6,
    },
    Metric {
        name: "abs_rel",
        unit: "",
        plain: "abs_rel",
        latex: "abs relative difference",
        heading: "Abs Rel",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "mean(|y - t| / t)",
        source: EIGEN,
        pooling: Pooling::Mean,
        field: 7,
    },
    Metric {
        name: "sq_rel",
        unit: "m",
        plain: "sq_rel",
        latex: "sqr relative difference",
        heading: "Sq Rel",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "mean((y - t)^2 / t)",
        source: "Eigen et al. 2014; the KITTI depth devkit (2017) divides by t^2",
        pooling: Pooling::Mean,
        field: 8,
    },
    Metric {
        name: "rmse",
        unit: "m",
        plain: "rmse",
        latex: "RMSE (linear)",
        heading: "RMSE",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "sqrt(mean((y - t)^2))",
        source: EIGEN,
        pooling: Pooling::RootMeanSquare,
        field: 9,
    },
    Metric {
        name: "rmse_log",
        unit: "",
        plain: "rmse_log",
        latex: "RMSE (log)",
        heading: "RMSE log",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "sqrt(mean(e^2)), e = ln y - ln t",
        source: EIGEN,
        pooling: Pooling::RootMeanSquare,
        field: 10,
    },
    Metric {
        name: "silog",
        unit: "",
        plain: "silog",
        latex: "RMSE (log, scale inv.)",
        heading: "SILog",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "mean((e - mean e)^2) / 2, e = ln y - ln t",
        source: "Table I of Martins et al. 2018; the KITTI depth devkit (2017) and BTS have 100 sqrt(mean((e - mean e)^2))",
        pooling: Pooling::LogVariance,
        field: 11,
    },
    Metric {
        name: "log10",
        unit: "",
        plain: "log10",
        latex: r"$\log_{10}$",
        heading: r"$\log_{10}$",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "mean(|log10 y - log10 t|)",
        source: "Saxena et al. 2009, NYU Depth v2",
        pooling: Pooling::Mean,
        field: 16,
    },
    Metric {
        name: "mae",
        unit: "m",
        plain: "mae",
        latex: "MAE",
        heading: "MAE",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "mean(|y - t|)",
        source: "the KITTI depth devkit (2017)",
        pooling: Pooling::Mean,
        field: 17,
    },
    Metric {
        name: "median_error",
        unit: "m",
        plain: "median error",
        latex: "median error",
        heading: "Median",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "median(|y - t|), of an even number the mean of the middle two",
        source: "NumPy's median",
        pooling: Pooling::None,
        field: 18,
    },
    Metric {
        name: "imae",
        unit: "1/km",
        plain: "imae (1/km)",
        latex: "iMAE [1/km]",
        heading: "iMAE",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "mean(|1000/y - 1000/t|)",
        source: "the KITTI depth devkit (2017)",
        pooling: Pooling::Mean,
        field: 19,
    },
    Metric {
        name: "irmse",
        unit: "1/km",
        plain: "irmse (1/km)",
        latex: "iRMSE [1/km]",
        heading: "iRMSE",
        more_is_better: false,
        nominal: None,
        decimals: 2,
        formula: "sqrt(mean((1000/y - 1000/t)^2))",
        source: "the KITTI depth devkit (2017)",
        pooling: Pooling::RootMeanSquare,
        field: 20,
    },
    Metric {
        name: "delta_1.05",
        unit: "",
        plain: "delta < 1.05",
        latex: r"threshold $\delta < 1.05$",
        heading: r"$\delta<1.05$",
        more_is_better: true,
        nominal: None,
        decimals: 3,
        formula: "share with max(y/t, t/y) < 1.05",
        source: "as a1, for estimates where a1 is 1 nearly everywhere",
        pooling: Pooling::Mean,
        field: 21,
    },
    Metric {
        name: "delta_1.10",
        unit: "",
        plain: "delta < 1.10",
        latex: r"threshold $\delta < 1.10$",
        heading: r"$\delta<1.10$",
        more_is_better: true,
        nominal: None,
        decimals: 3,
        formula: "share with max(y/t, t/y) < 1.10",
        source: "as a1, for estimates where a1 is 1 nearly everywhere",
        pooling: Pooling::Mean,
        field: 22,
    },
    Metric {
        name: "coverage",
        unit: "",
        plain: "coverage (1 sd)",
        latex: r"coverage ($1\sigma$)",
        heading: r"Cov. $1\sigma$",
        more_is_better: true,
        nominal: Some(0.682_689_492_137_085_9),
        decimals: 3,
        formula: "share of valid pixels with |y - t| <= s, where s is the predicted standard deviation",
        source: "of a Gaussian error .683, which is best",
        pooling: Pooling::MeanOfValid,
        field: 23,
    },
    Metric {
        name: "coverage_2",
        unit: "",
        plain: "coverage (2 sd)",
        latex: r"coverage ($2\sigma$)",
        heading: r"Cov. $2\sigma$",
        more_is_better: true,
        nominal: Some(0.954_499_736_103_641_6),
        decimals: 3,
        formula: "share of valid pixels with |y - t| <= 2 s",
        source: "of a Gaussian error .954, which is best",
        pooling: Pooling::MeanOfValid,
        field: 24,
    },
    Metric {
        name: "ause",
        unit: "",
        plain: "AUSE",
        latex: "AUSE",
        heading: "AUSE",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "area between the sparsification curves by uncertainty and by true error, over the error of all pixels",
        source: "Ilg et al. 2018",
        pooling: Pooling::None,
        field: 25,
    },
];

const MIDDLEBURY: &str = "Scharstein and Szeliski 2002; KITTI stereo 2012";

/// The metrics of disparities. In the set `all` an invalid pixel is wrong, and has no end-point error.
pub static DISPARITY: [Metric; 7] = [
    Metric {
        name: "epe",
        unit: "px",
        plain: "epe (px)",
        latex: "EPE [px]",
        heading: "EPE",
        more_is_better: false,
        nominal: None,
        decimals: 3,
        formula: "mean(|d - t|) over valid pixels, also in sets in which invalid pixels count as wrong",
        source: "end-point error; KITTI stereo 2012 (D-Avg)",
        pooling: Pooling::MeanOfValid,
        field: 30,
    },
    bad("bad_0.5", "bad-0.5", "share with |d - t| > 0.5 px, or invalid", 31),
    bad("bad_1", "bad-1", "share with |d - t| > 1 px, or invalid", 32),
    bad("bad_2", "bad-2", "share with |d - t| > 2 px, or invalid", 33),
    bad("bad_3", "bad-3", "share with |d - t| > 3 px, or invalid", 34),
    bad("bad_4", "bad-4", "share with |d - t| > 4 px, or invalid", 35),
    Metric {
        name: "d1",
        unit: "",
        plain: "d1",
        latex: "D1",
        heading: "D1",
        more_is_better: false,
        nominal: None,
        decimals: 4,
        formula: "share with |d - t| > 3 px and |d - t| > 5 % of t, both strict, or invalid",
        source: "KITTI stereo 2015 (Menze and Geiger 2015), which pools pixels",
        pooling: Pooling::Mean,
        field: 36,
    },
];

const fn bad(name: &'static str, label: &'static str, formula: &'static str, field: u32) -> Metric {
    Metric {
        name,
        unit: "",
        plain: label,
        latex: label,
        heading: label,
        more_is_better: false,
        nominal: None,
        decimals: 4,
        formula,
        source: MIDDLEBURY,
        pooling: Pooling::Mean,
        field,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::Preset;

    #[test]
    fn names_and_fields_are_unique_and_no_fields_of_the_message_itself() {
        let names: HashSet<&str> = all().map(|metric| metric.name).collect();
        let fields: HashSet<u32> = all().map(|metric| metric.field).collect();
        assert_eq!((names.len(), fields.len()), (all().count(), all().count()));
        assert!(!fields.iter().any(|field| [1, 2, 3, 12, 13, 14, 15].contains(field)));
        let proto = |name: &String| name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        assert!(all().map(Metric::field_name).all(|name| proto(&name)));
        assert_eq!(Metric::named("bad_0.5").map(Metric::field_name).as_deref(), Some("bad_0_5"));
        assert_eq!(Metric::of_field(11).map(|metric| metric.name), Some("silog"));
    }

    #[test]
    fn the_defaults_are_those_of_the_paper_in_its_order() {
        let names: Vec<&str> = Family::Depth.defaults().into_iter().map(|metric| metric.name).collect();
        assert_eq!(names, ["a1", "a2", "a3", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog"]);
        assert_eq!(Family::Disparity.defaults().len(), 7);
    }

    /// Two frames of 1 and 3 pixels: what is pooled is what one frame of all 4 would have.
    #[test]
    fn pooled_over_pixels_is_as_of_one_large_frame() {
        let (truth, estimate) = ([10.0, 20.0, 30.0, 8.0], [11.0, 12.0, f32::NAN, 9.5]);
        for preset in [Preset::Martins2018, Preset::KittiDepth] {
            let settings = preset.settings();
            let rows = |from: usize, to: usize| {
                let sets = [PixelSet::All, PixelSet::Valid];
                crate::score(&estimate[from..to], &truth[from..to], to - from, 1, &sets, &settings)
            };
            let (whole, first, second) = (rows(0, 4), rows(0, 1), rows(1, 4));
            for (set, whole) in whole.iter().enumerate() {
                for metric in Family::Depth.defaults() {
                    let pooled = metric.pooled([&first[set], &second[set]], &settings).unwrap();
                    let expected = whole.get(metric).unwrap();
                    assert!((pooled - expected).abs() <= 1e-12 * (1.0 + expected), "{}: {pooled}", metric.name);
                }
            }
        }
    }

    #[test]
    fn what_does_not_follow_from_frames_is_not_pooled() {
        let metric = Metric::named("median_error").unwrap();
        let row = ScoreRow { pixels: 3, ..ScoreRow::new(PixelSet::All, "") }.with(metric, 1.0);
        assert_eq!(metric.pooled([&row], &Settings::default()), None);
        assert_eq!(Metric::named("a1").unwrap().pooled([&row], &Settings::default()), None, "no frame has it");
    }
}
