//! `score/depth`: metrics of estimated depth, those of Table I and others.

use std::sync::{Arc, LazyLock, Weak};

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Upstream};
use depthloom_graphs::values::{Depth, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_scores::{Crop, DepthScores, Family, ScoreParams, ScoredPixels, Uncertainty};

use super::{clues, doc};
use crate::shape::same_size;

const BEFORE: &str = "\
One row per zone and pixel set, with the eight metrics of Table I (Martins et al. 2018) or those in `metrics`, in \
f64. The steps, in this order:\n\n\
1. Pixels are scored if the ground truth satisfies `min_m < t < max_m` (both strict) and the pixel is inside the \
crop.\n\
2. Estimates are aligned, if `align` is set.\n\
3. Estimates are clamped to `[min_m, max_m]`.\n\n\
In the pixel set `all`, an invalid pixel (NaN or infinity) counts as exactly `missing_m`: it is neither aligned nor \
clamped. So the paper's 0.0001 m stays below its `min_m` of 0.001 m, and enters `rmse_log`, `silog`, `imae` and \
`irmse` unchanged. In the pixel set `valid`, invalid pixels are left out.\n\n\
`y` is the estimate and `t` the ground truth, in metres, `e = ln y - ln t` (natural logarithm), over the N pixels \
that count:";

const BEHIND: &str = "\
`align` is for estimates without a metric scale. It is fitted per frame over the scored valid pixels of the whole \
image. `median` multiplies by `median(t) / median(y)` (Zhou et al. 2017). `scale-and-shift` replaces `1/y` by `s/y + \
b`, with `s` and `b` from a least-squares fit to `1/t`: in inverse depth, as in MiDaS (Ranftl et al. 2020). For a \
network that outputs inverse depth, the fit uses its own numbers, including zero and negative ones, unaffected by \
`cap` and `min_m`.\n\n\
Connect `deviation`, the standard deviation that an estimate predicts for itself, or `confidence`, any map that is \
higher where the estimate is surer. `deviation` adds `coverage`, `coverage_2` and `ause`, `confidence` adds `ause`. They \
use the valid pixels, also in the pixel set `all`. `coverage` of a well calibrated deviation is .683, `coverage_2` \
.954: nearer is better. `ause` states how well the uncertainty ranks pixels (Ilg et al. 2018, *Uncertainty estimates \
and multi-hypotheses networks for optical flow*). Pixels are removed in `ause_steps` steps, the least sure first, and \
`ause_error` of the remaining pixels is computed after each step. The same curve of an oracle, which removes pixels by \
their true error, is subtracted. The area between both, over the removed share from 0 to 1, is divided by the error of \
all pixels. 0 is the best; a constant uncertainty is as good as a random order. Pixels with equal uncertainty are \
removed as in the mean over all their orders. Where an uncertainty is invalid (NaN, infinite or a negative deviation), \
the pixel is not covered, and is removed first. `align` also scales deviations.\n\n\
`score:` in a stage is a short form for nodes of this kind.";

static DOC: LazyLock<String> =
    LazyLock::new(|| doc::with_formulas(BEFORE, Family::Depth, &format!("{}{BEHIND}", doc::ZONES)));

pub(crate) struct ScoreDepth {
    scores: DepthScores,
}

impl Node for ScoreDepth {
    type Params = ScoreParams;

    fn declaration() -> NodeDeclaration {
        let mut inputs = vec![
            Port::frame("estimate", ValueType::Depth, "Estimated depth, metres, NaN = invalid."),
            Port::frame(
                "ground_truth",
                ValueType::Depth,
                "Ground-truth depth, metres, NaN = unknown; same size as `estimate`.",
            ),
        ];
        let deviation =
            "The standard deviation that the estimate predicts, metres; adds `coverage`, `coverage_2`, `ause`.";
        let confidence = "Where the estimate is surer, higher; adds `ause`. Not together with `deviation`.";
        inputs.extend([
            Port::frame("deviation", ValueType::Depth, deviation).optional(),
            Port::frame("confidence", ValueType::Weight, confidence).optional(),
        ]);
        inputs.extend(clues::ports());
        NodeDeclaration {
            kind: "score/depth",
            version: 4,
            contract: Contract::Pure,
            summary: "Metrics of estimated depth against ground truth, per frame: the eight of Table I, or others.",
            doc: &DOC,
            inputs,
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row per zone and pixel set.")],
        }
    }

    fn check(params: &ScoreParams) -> Result<(), (&'static str, String)> {
        params.check()?;
        params.check_values()
    }

    fn check_inputs(_: &ScoreParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        match (upstream.at("deviation"), upstream.at("confidence")) {
            (Some(_), Some(_)) => Err(Fault::new("both `deviation` and `confidence` are connected")
                .remedy("connect one of them: score an estimate under two names to compare two uncertainties")),
            _ => Ok(()),
        }
    }

    fn build(params: ScoreParams) -> Result<Instance, Fault> {
        let scores = params.scores().map_err(|(_, what)| Fault::new(what))?;
        Ok(Instance::Pure(Box::new(Self { scores })))
    }
}

impl PureNode for ScoreDepth {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let size = inputs.get::<Depth>("estimate")?.metres.dimensions();
        let estimate = inputs.value("estimate").and_then(Value::depth_estimate);
        let estimate = estimate.ok_or_else(|| Fault::new("no value at input `estimate`"))?;
        let truth = inputs.get::<Depth>("ground_truth")?;
        let (width, height) = truth.metres.dimensions();
        same_size(("estimate", size), ("ground_truth", (width, height)))?;
        let mut uncertainty = None;
        if let Some(deviation) = inputs.optional::<Depth>("deviation")? {
            same_size(("deviation", deviation.metres.dimensions()), ("ground_truth", (width, height)))?;
            uncertainty = Some(Uncertainty::Deviation(deviation.metres.as_raw()));
        }
        if let Some(confidence) = inputs.optional::<Weight>("confidence")? {
            same_size(("confidence", confidence.share.dimensions()), ("ground_truth", (width, height)))?;
            uncertainty = Some(Uncertainty::Confidence(confidence.share.as_raw()));
        }
        let estimate = estimate.with_uncertainty(uncertainty);
        let clues = clues::read(inputs, (width, height))?;
        let mut latest = ctx.scratch.take::<LatestPixels>();
        let rows =
            self.scores.rows_on(estimate, latest.find(truth, &self.scores), (width as usize, height as usize), &clues);
        ctx.scratch.put(latest);
        Ok(Outputs::one("rows", rows))
    }
}

/// The scored pixels of the ground truth that a worker used last. Many estimates of a frame are scored against one
/// ground truth, and finding its pixels costs as much as scoring one of them.
#[derive(Default)]
struct LatestPixels {
    /// Keeps the address of the ground truth from being used again.
    truth: Weak<Depth>,
    bounds: Option<(f64, f64, Crop)>,
    pixels: ScoredPixels,
}

impl LatestPixels {
    fn find(&mut self, truth: &Arc<Depth>, scores: &DepthScores) -> &ScoredPixels {
        let bounds = Some(scores.bounds());
        if self.truth.as_ptr() != Arc::as_ptr(truth) || self.bounds != bounds {
            let (width, height) = truth.metres.dimensions();
            let pixels = scores.pixels(truth.metres.as_raw(), (width as usize, height as usize));
            *self = Self { truth: Arc::downgrade(truth), bounds, pixels };
        }
        &self.pixels
    }
}
