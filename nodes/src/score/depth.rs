//! `score/depth`: the eight scores of Table I.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use depthloom_scores::{PixelSet, ScoreParams, Settings, score};

use crate::shape::same_size;

/// The kind `score/depth`.
pub struct ScoreDepth {
    settings: Settings,
    sets: Vec<PixelSet>,
}

impl Node for ScoreDepth {
    type Params = ScoreParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "score/depth",
            version: 2,
            contract: Contract::Pure,
            summary: "The eight scores of Table I of an estimate against the truth, per frame.",
            doc: "\
`a1 a2 a3 abs_rel sq_rel rmse rmse_log silog` over the scored pixels, one row a pixel set, in f64. In this order: the truth is masked by \
`min_m < t < max_m` (both strict) and by the crop; answers are median scaled if asked for; answers are clamped to `[min_m, max_m]` last. In the set \
`all` a missing answer (NaN or infinity) counts as `missing_m`, exactly: it is neither scaled nor clamped, so that the paper's 0.0001 m stays below its \
`min_m` of 0.001 m and `rmse_log` and `silog` are taken of it. In `answered` it is left out.\n\n\
With `y` the answer, `t` the truth and `e = ln y - ln t` (natural logarithm), over N pixels: `a1`, `a2`, `a3` are the shares with \
`max(y/t, t/y)` below 1.25, 1.25^2, 1.25^3; `abs_rel = mean(|y - t| / t)`; `rmse = sqrt(mean((y - t)^2))`; `rmse_log = sqrt(mean(e^2))`; `sq_rel` and \
`silog` as the preset or the parameter says. A data set's value is the unweighted mean over its frames.\n\n\
`score:` in a stage is sugar for nodes of this kind.",
            inputs: vec![
                Port::frame("estimate", ValueType::Depth, "Estimated depth, metres, NaN = no answer."),
                Port::frame("truth", ValueType::Depth, "True depth, metres, NaN = unknown; of the same size."),
            ],
            outputs: vec![Port::frame("rows", ValueType::Scores, "One row a pixel set.")],
        }
    }

    fn check(params: &ScoreParams) -> Result<(), (&'static str, String)> {
        params.check()
    }

    fn build(params: ScoreParams) -> Result<Instance, Fault> {
        Ok(Instance::Pure(Box::new(Self { settings: params.settings(), sets: params.sets })))
    }
}

impl PureNode for ScoreDepth {
    fn process(&self, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let estimate = &inputs.get::<Depth>("estimate")?.metres;
        let truth = &inputs.get::<Depth>("truth")?.metres;
        let (width, height) = truth.dimensions();
        same_size(("estimate", estimate.dimensions()), ("truth", (width, height)))?;
        Ok(Outputs::one("rows", score(estimate, truth, width as usize, height as usize, &self.sets, &self.settings)))
    }
}
