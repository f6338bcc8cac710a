//! `learn/reliability`: how reliable stereo and a monocular estimate are, learned without ground truth.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{
    Context, Fault, Frame, Inputs, Instance, Node, OrderedNode, Outputs, Port, Value, ValueType, counted,
};
use depthloom_kernels::mixture::reliability::{
    AGREEMENTS, CLASSES, KNOTS, NEARNESSES, Reliability, SUPPORTS, Statistics, class, knot,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::evidence;
use crate::bounds::{above_zero, within};

/// Parameters of `learn/reliability`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ReliabilityParams {
    /// Number of disparities that stereo searched, px: `disparities` of the matcher. A disparity beyond is an error.
    #[schemars(range(min = 1, max = 4096))]
    pub disparities: u32,
    /// Standard deviation of the disparity of an inlier, px: that of the mixture.
    #[schemars(range(max = 100), extend("exclusiveMinimum" = 0))]
    pub stereo_noise: f64,
    /// Pixels count whose depth is below this in both estimates, metres: `cap` of both. `null` counts all.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub cap: Option<f64>,
}

impl Default for ReliabilityParams {
    fn default() -> Self {
        Self { disparities: 64, stereo_noise: 1.0, cap: Some(80.0) }
    }
}

pub(crate) struct LearnReliability {
    params: ReliabilityParams,
    statistics: Statistics,
}

impl Node for LearnReliability {
    type Params = ReliabilityParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "learn/reliability",
            version: 1,
            contract: Contract::Ordered,
            summary: "Learns how reliable stereo and a monocular estimate are, without ground truth.",
            doc: "\
The output replaces constants of `fusion/mixture`. It has the prior probability that stereo is an inlier, by class of \
evidence, and the standard deviation of monocular log depth, by depth. Both follow from all pixels of the stage by \
expectation maximisation. The inputs are those of the mixture; no ground truth is read.\n\n\
A class of evidence is a combination of four facts. The views differ by at most 1 px, at most 3 px, or more. The match \
is unique or not. The share of trusted pixels in a window of 21x21 px is below 0.3, 0.55, 0.8, or above. The disparity \
of the monocular depth, as a share of the largest that stereo searched, is between two of the bounds 0.25, 0.4, 0.55, \
0.7, 0.85 and 1. In the last classes of nearness the true disparity may be out of range.\n\n\
Stereo is trusted where the views agree, the match is unique, at least 0.8 of the window is trusted, and monocular \
depth is far from the end of the range. There the prior is 0.99. The standard deviation of monocular log depth is \
learned from these pixels, at quarters between powers of two metres from 0.5 to 128. Where the views disagree and less \
than 0.3 of the window is trusted, the prior is 0.05. These pixels show how outliers are distributed. The prior of \
other classes is the mean probability of an inlier. Classes with less than about 100 pixels, and depths with less than \
10000, are near the mean of all. Of what trusted pixels differ, at least half counts as monocular error.\n\n\
A network errs less on frames that it was trained on. Learn the reliability from other frames, for example from those \
that are fused.\n\n\
The output is a JSON text. A run writes it to `models/STAGE.NODE.json`, and `reliability: { file: PATH }` reads it in \
another experiment.",
            inputs: evidence::ports(),
            outputs: vec![Port::once("reliability", ValueType::Reliability, "Priors and standard deviations, JSON.")],
        }
    }

    fn check(params: &ReliabilityParams) -> Result<(), (&'static str, String)> {
        within("disparities", f64::from(params.disparities), " px", 1.0..=4096.0)?;
        above_zero("stereo_noise", Some(params.stereo_noise), "px")?;
        within("stereo_noise", params.stereo_noise, " px", 0.0..=100.0)?;
        above_zero("cap", params.cap, "m")
    }

    fn build(params: ReliabilityParams) -> Result<Instance, Fault> {
        Ok(Instance::Ordered(Box::new(Self { params, statistics: Statistics::default() })))
    }
}

impl OrderedNode for LearnReliability {
    fn process(&mut self, _frame: &Frame, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let cap = self.params.cap.map_or(f32::INFINITY, |cap| cap as f32);
        self.statistics.add(&evidence::frame(inputs, self.params.disparities)?, cap);
        Ok(Outputs::none())
    }

    fn finish(self: Box<Self>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let Self { params, statistics } = *self;
        let reliability = statistics.reliability(params.stereo_noise).ok_or_else(|| {
            let frames = counted(statistics.frames(), "frame");
            Fault::new(format!("no pixel of {frames} is trusted, so nothing can be learned"))
                .remedy("check that `disparity` and `mono` are valid at the same pixels, and that `disparities` is the matcher's")
        })?;
        let file = File::new(&reliability, params.disparities, statistics.frames(), statistics.trusted());
        let text = serde_json::to_string_pretty(&file)
            .map_err(|error| Fault::new("failed to write the reliability as JSON").because(error))?;
        Ok(Outputs::one("reliability", Value::Reliability(Artifact::reliability(text + "\n").into())))
    }
}

const FORMAT: &str = "depthloom reliability 1";

/// The JSON text.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    /// Number of disparities that stereo searched, px.
    disparities: u32,
    frames: u64,
    trusted_pixels: u64,
    mono_spread: Vec<Spread>,
    inlier: Vec<Inlier>,
}

/// The standard deviation of monocular log depth at a depth.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Spread {
    metres: f32,
    spread: f32,
}

/// The priors of the classes of nearness, the farthest first, with three facts in common.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Inlier {
    /// 0: at most 1 px apart, 1: at most 3 px, 2: more.
    agreement: usize,
    unique: bool,
    /// The number of bounds of support that are reached.
    support: usize,
    prior: Vec<f32>,
}

impl File {
    fn new(reliability: &Reliability, disparities: u32, frames: u64, trusted_pixels: u64) -> Self {
        let knots = (0..KNOTS).map(|at| Spread { metres: knot(at), spread: reliability.spread[at] });
        let inlier = facts().map(|(agreement, unique, support)| {
            let prior = |nearness| reliability.inlier[class(agreement, unique, support, nearness)];
            Inlier { agreement, unique, support, prior: (0..=NEARNESSES.len()).map(prior).collect() }
        });
        Self {
            format: FORMAT.to_owned(),
            disparities,
            frames,
            trusted_pixels,
            mono_spread: knots.collect(),
            inlier: inlier.collect(),
        }
    }

    fn reliability(&self) -> Result<Reliability, String> {
        if self.format != FORMAT {
            return Err(format!("its format is `{}`, expected `{FORMAT}`", self.format));
        }
        let knots_match = self.mono_spread.len() == KNOTS
            && self.mono_spread.iter().enumerate().all(|(at, spread)| spread.metres == knot(at));
        if !knots_match {
            return Err("`mono_spread` has other depths than quarters between powers of two, 0.5 to 128 m".to_owned());
        }
        let mut reliability = Reliability { inlier: [0.0; CLASSES], spread: [0.0; KNOTS] };
        for (spread, read) in reliability.spread.iter_mut().zip(&self.mono_spread) {
            if !(read.spread > 0.0 && read.spread <= 10.0) {
                return Err(format!(
                    "the spread at {} m is {}, expected above 0 and at most 10",
                    read.metres, read.spread
                ));
            }
            *spread = read.spread;
        }
        if !self.inlier.iter().map(|one| (one.agreement, one.unique, one.support)).eq(facts()) {
            return Err("`inlier` does not have each agreement, uniqueness and support once, in order".to_owned());
        }
        for one in &self.inlier {
            let Inlier { agreement, unique, support, prior } = one;
            if prior.len() != NEARNESSES.len() + 1 || prior.iter().any(|prior| !(*prior > 0.0 && *prior < 1.0)) {
                let classes = NEARNESSES.len() + 1;
                return Err(format!("a list `prior` is {prior:?}, expected {classes} numbers above 0 and below 1"));
            }
            for (nearness, prior) in prior.iter().enumerate() {
                reliability.inlier[class(*agreement, *unique, *support, nearness)] = *prior;
            }
        }
        Ok(reliability)
    }
}

/// All combinations of agreement, uniqueness and support.
fn facts() -> impl Iterator<Item = (usize, bool, usize)> {
    let supports = |agreement, unique| (0..=SUPPORTS.len()).map(move |support| (agreement, unique, support));
    (0..AGREEMENTS)
        .flat_map(move |agreement| [false, true].into_iter().flat_map(move |unique| supports(agreement, unique)))
}

/// Reads the output of `learn/reliability` for a matcher that searched `disparities`.
pub(super) fn read(artifact: &Artifact, disparities: u32) -> Result<Reliability, Fault> {
    let failed = || {
        Fault::new("the input `reliability` cannot be read")
            .remedy("wire the output of `learn/reliability`, or a file that it wrote: `models/STAGE.NODE.json`")
    };
    let file: File = serde_json::from_slice(&artifact.bytes).map_err(|error| failed().because(error))?;
    if file.disparities != disparities {
        return Err(Fault::new(format!(
            "the input `reliability` was learned with {} disparities, and this node has {disparities}",
            file.disparities
        ))
        .remedy("give `learn/reliability` and this node the `disparities` of the matcher"));
    }
    file.reliability().map_err(|what| failed().because(Fault::new(what)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_as_it_was_written() {
        let mut reliability = Reliability { inlier: [0.0; CLASSES], spread: [0.0; KNOTS] };
        reliability.inlier.iter_mut().enumerate().for_each(|(at, prior)| *prior = (at + 1) as f32 / 200.0);
        reliability.spread.iter_mut().enumerate().for_each(|(at, spread)| *spread = (at + 1) as f32 / 30.0);
        let text = serde_json::to_string(&File::new(&reliability, 64, 3, 7)).unwrap();
        assert_eq!(read(&Artifact::reliability(text.clone()), 64).unwrap(), reliability);
        assert!(read(&Artifact::reliability(text.clone()), 128).is_err());
        for (from, to) in
            [("reliability 1", "reliability 2"), ("\"metres\":0.625", "\"metres\":0.6"), ("true", "false")]
        {
            assert!(read(&Artifact::reliability(text.replacen(from, to, 1)), 64).is_err(), "{to}");
        }
    }
}
