//! `score/depth`: metrics of estimated depth, those of Table I and others.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_scores::{DepthScores, Family, ScoreParams};

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

    fn build(params: ScoreParams) -> Result<Instance, Fault> {
        let scores = params.scores().map_err(|(_, what)| Fault::new(what))?;
        Ok(Instance::Pure(Box::new(Self { scores })))
    }
}

impl PureNode for ScoreDepth {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let size = inputs.get::<Depth>("estimate")?.metres.dimensions();
        let estimate = inputs.value("estimate").and_then(Value::depth_estimate);
        let estimate = estimate.ok_or_else(|| Fault::new("no value at input `estimate`"))?;
        let truth = &inputs.get::<Depth>("ground_truth")?.metres;
        let (width, height) = truth.dimensions();
        same_size(("estimate", size), ("ground_truth", (width, height)))?;
        let clues = clues::read(inputs, (width, height))?;
        Ok(Outputs::one("rows", self.scores.rows(estimate, truth, (width as usize, height as usize), &clues)))
    }
}
