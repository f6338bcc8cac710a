//! `score/disparity`: disparities against the truth, by the scores of the stereo benchmarks.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Upstream};
use depthloom_graphs::values::{Calibration, TrueDisparity};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_kernels::fill::fill_background;
use depthloom_scores::{DisparityMaps, DisparityScoreParams, DisparityScores, Family};

use super::{clues, doc};
use crate::shape::same_size;

const BEFORE: &str = "\
The scores of the KITTI and Middlebury stereo benchmarks, one row a zone and pixel set. A pixel counts where the truth is known; it is valid where the \
disparity is above 0. In the set `all` a pixel without an answer is wrong in `bad_x` and `d1`, and has no `epe`; in `valid` it is left out; in `filled` it \
has what `interpolateBackground` of KITTI's devkit gives it (`disparity/fill` is the same as a node): in each row the smaller of the disparities at both ends of the \
gap, at the image's border the one there is, then in each column the first and last answer up and down. The benchmark's own tables are `filled`. Errors are \
compared with the thresholds exactly.\n\n\
With `d` the answer and `t` the truth, px, over the pixels that count:";

const BEHIND: &str = "\
KITTI stereo 2015 publishes `d1` on `filled`, `mean: pixels`, against `disp_noc` and `disp_occ`: D1-all is the whole image's, D1-bg and D1-fg those of the zones \
`background` and `foreground`. Bands of distance want `calibration`: distance is `f * B / (t + doffs)`.\n\n\
`score:` in a stage is sugar for nodes of this kind where the estimate is a disparity.";

static DOC: LazyLock<String> =
    LazyLock::new(|| doc::with_formulas(BEFORE, Family::Disparity, &format!("{}{BEHIND}", doc::ZONES)));

pub(crate) struct ScoreDisparity {
    scores: DisparityScores,
    bands: bool,
}

impl Node for ScoreDisparity {
    type Params = DisparityScoreParams;

    fn declaration() -> NodeDeclaration {
        let calibration =
            "Focal length and baseline: distance of a true disparity. Wanted by `zones.distance_m` alone.";
        let mut inputs = vec![
            Port::frame(
                "estimate",
                ValueType::Disparity,
                "Estimated disparity, in fixed or floating point; scored as it is.",
            ),
            Port::frame("truth", ValueType::TrueDisparity, "True disparity, px, NaN = unknown; of the same size."),
            Port::frame("calibration", ValueType::Calibration, calibration).optional(),
        ];
        inputs.extend(clues::ports());
        NodeDeclaration {
            kind: "score/disparity",
            version: 2,
            contract: Contract::Pure,
            summary: "End-point error, bad-x and D1 of estimated disparity against the truth, per frame.",
            doc: &DOC,
            inputs,
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row a zone and pixel set.")],
        }
    }

    fn check(params: &DisparityScoreParams) -> Result<(), (&'static str, String)> {
        params.check()
    }

    fn check_inputs(params: &DisparityScoreParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        if params.zones.distance_m.is_empty() || upstream.at("calibration").is_some() {
            return Ok(());
        }
        Err(Fault::new("`zones.distance_m` cuts by distance, and a disparity has none without a calibration")
            .remedy("wire `calibration`, e.g. `calibration: source/calibration`"))
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
        let truth = &inputs.get::<TrueDisparity>("truth")?.px;
        let size = truth.dimensions();
        same_size(("estimate", estimate.dimensions()), ("truth", size))?;
        let clues = clues::read(inputs, size)?;
        let calibration = inputs.optional::<Calibration>("calibration")?;
        if self.bands && calibration.is_none() {
            return Err(Fault::new("`zones.distance_m` needs a calibration on every frame"));
        }
        let (width, height) = (size.0 as usize, size.1 as usize);
        let filled = self.scores.asks_for_filled().then(|| {
            // Without an answer is what is not above 0, whatever the smallest disparity searched.
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
