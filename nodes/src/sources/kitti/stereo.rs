//! What KITTI's stereo benchmarks of 2012 and 2015 share.

use std::path::Path;

use depthloom_graphs::contracts::{Recognised, SwitchedOff};
use depthloom_graphs::values::{Calibration, Image, Mask, TrueDisparity};
use depthloom_graphs::{Fault, Outputs, Port};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use crate::sources::dataset::frame_files::{Files, Part};
use crate::sources::dataset::{calibration_port, depth_port, image_port, truth_off};
use crate::sources::evaluation::Evaluation;
use crate::sources::true_disparity;

/// Part of the benchmark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Split {
    /// Frames with ground truth.
    #[default]
    Training,
    /// Frames without ground truth.
    Testing,
}

impl Split {
    pub(crate) const fn folder(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Testing => "testing",
        }
    }
}

/// Pixels with ground truth of a training frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiTruth {
    /// Pixels that the right camera also sees: `disp_noc_0`.
    #[default]
    Noc,
    /// All pixels with ground truth: `disp_occ_0`.
    Occ,
    /// Ground truth is not read, even if it exists.
    None,
}

impl KittiTruth {
    /// The one of these parts that a half's `depth` is made of.
    pub(crate) fn part(self, split: Split, [noc, occ]: [Part; 2]) -> Option<Part> {
        match (split, self) {
            (Split::Testing, _) | (_, Self::None) => None,
            (Split::Training, Self::Noc) => Some(noc),
            (Split::Training, Self::Occ) => Some(occ),
        }
    }
}

pub(super) fn ports(left: &'static str, right: &'static str) -> Vec<Port> {
    let depth = depth_port("Sparse ground-truth depth, metres, NaN = unknown; absent in `testing`.").optional();
    let ports = [image_port("left", left), image_port("right", right), calibration_port(), depth];
    ports.into_iter().chain(Evaluation::on_request()).collect()
}

/// The outputs that the parameters of a benchmark switch off; `of_disparities` are those that `disparities` switches
/// on.
pub(super) fn switched_off(
    split: Split,
    truth: KittiTruth,
    disparities: bool,
    of_disparities: &[&'static str],
) -> Vec<SwitchedOff> {
    if split == Split::Testing {
        let all = [&["depth"], of_disparities].concat();
        return SwitchedOff::by("split", "testing", "training", &all);
    }
    let mut off = truth_off(truth == KittiTruth::None, "noc", &["depth"]);
    if !disparities {
        off.extend(SwitchedOff::by("disparities", "false", "true", of_disparities));
    }
    off
}

/// `params` returns the parameters of an existing half, except root, split and truth. `root` may be a half.
pub(crate) fn halves(
    root: &Path,
    name: &str,
    [noc, occ]: [Part; 2],
    params: impl Fn(&Path) -> Option<Json>,
) -> Vec<Recognised> {
    let is_half = |split: Split| root.ends_with(split.folder()) && params(root).is_some();
    let root = if is_half(Split::Training) || is_half(Split::Testing) { root.parent().unwrap_or(root) } else { root };
    let one = |split: Split| {
        let half = root.join(split.folder());
        let mut params = params(&half)?;
        let truth = match split {
            Split::Testing => None,
            Split::Training if half.join(noc).is_dir() => Some("noc"),
            Split::Training if half.join(occ).is_dir() => Some("occ"),
            Split::Training => Some("none"),
        };
        params["root"] = json!(root);
        params["split"] = json!(split.folder());
        if let Some(truth) = truth {
            params["ground_truth"] = json!(truth);
        }
        Some(Recognised::new(format!("{name}, {}", split.folder()), params))
    };
    [Split::Training, Split::Testing].into_iter().filter_map(one).collect()
}

/// What a frame's values are made of, besides its files.
pub(super) struct GroundTruth {
    /// Disparities of the pixels that both cameras see, and of all.
    pub parts: [Part; 2],
    /// The part that `depth` is made of.
    pub depth: Option<Part>,
    /// Whether the disparities are outputs too.
    pub disparities: bool,
}

impl GroundTruth {
    pub(super) fn outputs(
        &self,
        files: &Files,
        (left, right): (Image, Image),
        calibration: Calibration,
        objects: Option<Mask>,
    ) -> Result<Outputs, Fault> {
        let size = left.dimensions();
        let map =
            |part| Ok::<_, Fault>(files.map_u16(part, "disparity", size)?.as_ref().map(TrueDisparity::from_px_256));
        let [noc, occ] = self.parts;
        let maps = Evaluation { noc: map(noc)?, occ: map(occ)?, objects };
        let truth = self.depth.and_then(|part| if part == occ { maps.occ.as_ref() } else { maps.noc.as_ref() });
        let mut outputs = Outputs::one("left", left).with("right", right);
        if let Some(truth) = truth {
            outputs = outputs.with("depth", true_disparity::depth(truth, &calibration));
        }
        outputs = outputs.with("calibration", calibration);
        Ok(if self.disparities { maps.outputs(outputs) } else { outputs })
    }
}
