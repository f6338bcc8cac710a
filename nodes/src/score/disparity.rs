//! `score/disparity`: metrics of estimated disparity, those of the stereo benchmarks.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Upstream};
use depthloom_graphs::values::{Calibration, TrueDisparity};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::fill::fill_background;
use depthloom_scores::{DisparityMaps, DisparityScoreParams, DisparityScores, Family};

use super::{clues, doc};
use crate::geometry::of_pair;
use crate::shape::same_size;

const BEFORE: &str = "\
The metrics of the KITTI and Middlebury stereo benchmarks, one row per zone and pixel set. A pixel is scored where \
ground truth is known. It is valid where the disparity is above 0. Errors are compared with the thresholds exactly. \
The pixel sets treat invalid pixels differently:\n\n\
- `all`: an invalid pixel is wrong in `bad_x` and `d1`, and has no `epe`.\n\
- `valid`: invalid pixels are left out.\n\
- `filled`: an invalid pixel is filled first, by `interpolateBackground` of KITTI's development kit \
(`disparity/fill` is the same as a node). In each row, a gap takes the smaller disparity of its two ends; at the \
image border, that of its only end. Then the first and last valid disparity of each column are repeated up and down. \
The tables of the benchmark are `filled`.\n\n\
`d` is the estimate and `t` the ground truth, px, over the pixels that count:";

const BEHIND: &str = "\
KITTI stereo 2015 publishes `d1` with `filled` and `mean: pixels`, against `disp_noc` and `disp_occ`. D1-all is the \
value of the whole image, D1-bg and D1-fg those of the zones `background` and `foreground`. Bands of distance \
require `calibration`: distance is `f * B / (t + doffs)`.\n\n\
`score:` in a stage is a short form for nodes of this kind if the estimate is a disparity.";

static DOC: LazyLock<String> =
    LazyLock::new(|| doc::with_formulas(BEFORE, Family::Disparity, &format!("{}{BEHIND}", doc::ZONES)));

pub(crate) struct ScoreDisparity {
    scores: DisparityScores,
    bands: bool,
}

impl Node for ScoreDisparity {
    type Params = DisparityScoreParams;

    fn declaration() -> NodeDeclaration {
        let calibration = "Focal length and baseline, for distances of `zones.distance_m`; required only there.";
        let mut inputs = vec![
            Port::frame("estimate", ValueType::Disparity, "Estimated disparity, fixed or floating point, not rounded."),
            Port::frame(
                "ground_truth",
                ValueType::TrueDisparity,
                "Ground-truth disparity, px, NaN = unknown; same size as `estimate`.",
            ),
            Port::frame("calibration", ValueType::Calibration, calibration).optional(),
        ];
        inputs.extend(clues::ports());
        NodeDeclaration {
            kind: "score/disparity",
            version: 2,
            contract: Contract::Pure,
            summary: "Metrics of estimated disparity against ground truth, per frame: end-point error, bad-x and D1.",
            doc: &DOC,
            inputs,
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row per zone and pixel set.")],
        }
    }

    fn check(params: &DisparityScoreParams) -> Result<(), (&'static str, String)> {
        params.check()
    }

    fn check_inputs(params: &DisparityScoreParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        if params.zones.distance_m.is_empty() || upstream.at("calibration").is_some() {
            return Ok(());
        }
        Err(Fault::new("`zones.distance_m` needs the input `calibration` to convert disparity to distance")
            .remedy("connect `calibration`, e.g. `calibration: source/calibration`"))
    }

    fn build(params: DisparityScoreParams) -> Result<Instance, Fault> {
        let bands = !params.zones.distance_m.is_empty();
        let scores = params.scores().map_err(|(_, what)| Fault::new(what))?;
        Ok(Instance::Pure(Box::new(Self { scores, bands })))
    }
}

impl PureNode for ScoreDisparity {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let estimate = inputs.value("estimate").and_then(Value::disparity_px);
        let estimate = estimate.ok_or_else(|| Fault::new("no value at input `estimate`"))?;
        let truth = &inputs.get::<TrueDisparity>("ground_truth")?.px;
        let size = truth.dimensions();
        same_size(("estimate", estimate.dimensions()), ("ground_truth", size))?;
        let clues = clues::read(inputs, size)?;
        let calibration = inputs.optional::<Calibration>("calibration")?;
        if self.bands {
            of_pair(calibration.ok_or_else(|| Fault::new("`zones.distance_m` needs a calibration on every frame"))?)?;
        }
        let (width, height) = (size.0 as usize, size.1 as usize);
        let filled = self.scores.asks_for_filled().then(|| {
            // A disparity is invalid if it is not above 0, whatever the smallest disparity searched.
            let mut filled: Vec<f32> = estimate.iter().map(|&px| if px > 0.0 { px } else { 0.0 }).collect();
            fill_background(&mut filled, width, 0.0, usize::MAX);
            filled
        });
        let maps = DisparityMaps {
            size: (width, height),
            estimate: &estimate,
            filled: filled.as_deref(),
            truth,
            focal_baseline_px_m: calibration.map(|calibration| calibration.focal_baseline_px_m()),
            doffs_px: calibration.map_or(0.0, |calibration| calibration.doffs_px),
        };
        Ok(Outputs::one("rows", self.scores.rows(&maps, &clues)))
    }
}
