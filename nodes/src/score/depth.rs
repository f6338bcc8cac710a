//! `score/depth`: depths against the truth, by the scores of Table I and others.

use std::sync::LazyLock;

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, Value, ValueType};
use depthloom_scores::{DepthScores, Family, ScoreParams};

use super::{clues, doc};
use crate::shape::same_size;

const BEFORE: &str = "\
The eight scores of Table I, or those of `metrics`, over the scored pixels, one row a zone and pixel set, in f64. In this order: the truth is masked by \
`min_m < t < max_m` (both strict) and by the crop; answers are aligned if asked for; answers are clamped to `[min_m, max_m]` last. In the set \
`all` a missing answer (NaN or infinity) counts as `missing_m`, exactly: it is neither aligned nor clamped, so that the paper's 0.0001 m stays below its \
`min_m` of 0.001 m and `rmse_log`, `silog`, `imae` and `irmse` are taken of it. In `valid` it is left out.\n\n\
With `y` the answer, `t` the truth and `e = ln y - ln t` (natural logarithm), metres, over the N pixels that count:";

const BEHIND: &str = "\
`align` is for estimates that know no scale, fitted frame by frame over the scored pixels of the whole image with an answer: `median` multiplies by `median(t) / median(y)` (Zhou et \
al. 2017); `scale-and-shift` makes `s/y + b` of `1/y`, with the `s` and `b` of least squares against `1/t`: in inverse depth, as MiDaS does (Ranftl et al. 2020). Where a network gives inverse depth, that is taken as it is, also of zero and below, and however far a cap or `min_m` would change it.\n\n\
`score:` in a stage is sugar for nodes of this kind.";

static DOC: LazyLock<String> =
    LazyLock::new(|| doc::with_formulas(BEFORE, Family::Depth, &format!("{}{BEHIND}", doc::ZONES)));

pub(crate) struct ScoreDepth {
    scores: DepthScores,
}

impl Node for ScoreDepth {
    type Params = ScoreParams;

    fn declaration() -> NodeDeclaration {
        let mut inputs = vec![
            Port::frame("estimate", ValueType::Depth, "Estimated depth, metres, NaN = no answer."),
            Port::frame("truth", ValueType::Depth, "True depth, metres, NaN = unknown; of the same size."),
        ];
        inputs.extend(clues::ports());
        NodeDeclaration {
            kind: "score/depth",
            version: 4,
            contract: Contract::Pure,
            summary: "The scores of Table I, or others, of estimated depth against the truth, per frame.",
            doc: &DOC,
            inputs,
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row a zone and pixel set.")],
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
        let truth = &inputs.get::<Depth>("truth")?.metres;
        let (width, height) = truth.dimensions();
        same_size(("estimate", size), ("truth", (width, height)))?;
        let clues = clues::read(inputs, (width, height))?;
        Ok(Outputs::one("rows", self.scores.rows(estimate, truth, (width as usize, height as usize), &clues)))
    }
}
