//! Kinds without pixels: the ports and parameters of real ones, so that the language can be tested alone.

use depthloom_graphs::contracts::{
    Auto, Contract, DataPath, DeclaredPorts, FrameSelection, InputOrigin, NodeDeclaration, Signature,
    SourceDeclaration, SwitchedOff, Upstream,
};
use depthloom_graphs::{Fault, Instance, Key, Node, Port, Registry, Source, SourceKind, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Every toy.
pub(crate) fn registry() -> Registry {
    Registry::default()
        .source::<Road>()
        .source::<Kitti>()
        .source::<Mono>()
        .node::<Sgbm>()
        .node::<Edges>()
        .node::<Sobel>()
        .node::<Samples>()
        .node::<Ssl>()
        .node::<FromDisparity>()
        .node::<Onnx>()
        .node::<Scale>()
        .node::<Merge>()
        .node::<Median>()
        .node::<Score>()
        .node::<Average>()
        .node::<Offset>()
        .node::<Broken>()
        .node::<Own>()
}

fn not_built<T>() -> Result<T, Fault> {
    Err(Fault::new("a toy is only planned, never run"))
}

macro_rules! source {
    ($name:ident, $kind:literal, $params:ty, [$($port:expr),* $(,)?] $($more:item)*) => {
        pub(crate) struct $name;
        impl SourceKind for $name {
            type Params = $params;
            fn declaration() -> SourceDeclaration {
                SourceDeclaration { kind: $kind, version: 1, summary: "A toy.", doc: "No pixels.", outputs: vec![$($port),*] }
            }
            fn open(_: $params) -> Result<Box<dyn Source>, Fault> {
                not_built()
            }
            $($more)*
        }
    };
}

macro_rules! node {
    ($name:ident, $kind:literal, $contract:ident, $params:ty, [$($input:expr),* $(,)?] => [$($output:expr),* $(,)?] $($more:item)*) => {
        pub(crate) struct $name;
        impl Node for $name {
            type Params = $params;
            fn declaration() -> NodeDeclaration {
                NodeDeclaration {
                    kind: $kind, version: 1, contract: Contract::$contract, summary: "A toy.", doc: "No pixels.",
                    inputs: vec![$($input),*], outputs: vec![$($output),*],
                }
            }
            fn build(_: $params) -> Result<Instance, Fault> {
                not_built()
            }
            $($more)*
        }
    };
}

const fn port(name: &'static str, value_type: ValueType) -> Port {
    Port::frame(name, value_type, "A toy port.")
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RoadParams {
    /// Which frames.
    frames: FrameSelection,
    /// The random seed.
    seed: u64,
}
impl Default for RoadParams {
    fn default() -> Self {
        Self { frames: FrameSelection::All, seed: 1 }
    }
}
source!(
    Road,
    "synthetic/road",
    RoadParams,
    [
        port("left", ValueType::Image),
        port("right", ValueType::Image),
        port("calibration", ValueType::Calibration),
        port("depth", ValueType::Depth).optional(),
    ]
);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct KittiParams {
    /// The folder that holds `image_2`.
    root: DataPath,
    /// Which frames.
    #[serde(default)]
    frames: FrameSelection,
    /// Which ground truth is scored.
    #[serde(default)]
    ground_truth: Truth,
}
/// Which ground truth is scored.
#[derive(Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Truth {
    /// Not occluded.
    #[default]
    Noc,
    /// All.
    Occ,
    /// Not read.
    None,
}
source!(
    Kitti,
    "kitti/stereo2015",
    KittiParams,
    [
        port("left", ValueType::Image),
        port("right", ValueType::Image),
        port("calibration", ValueType::Calibration),
        port("depth", ValueType::Depth),
    ]
    fn switched_off(params: &KittiParams) -> Vec<SwitchedOff> {
        let outputs: &[_] = if params.ground_truth == Truth::None { &["depth"] } else { &[] };
        SwitchedOff::by("ground_truth", "none", "noc", outputs)
    }
);

#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NoParams {}
source!(Mono, "toy/mono", NoParams, [port("left", ValueType::Image)]);

#[derive(Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Mode {
    #[default]
    Sgbm,
    Hh,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SgbmParams {
    /// How many disparities are searched, pixels.
    #[schemars(range(min = 16), extend("multipleOf" = 16))]
    disparities: u32,
    /// The side of a block, pixels.
    #[schemars(range(min = 1, max = 11))]
    block: u32,
    /// The penalty of a small jump: `auto` is `8 block^2`.
    #[schemars(extend("follows" = ["block"]))]
    p1: Auto<u32>,
    /// The penalty of a large jump: `auto` is `32 block^2`.
    #[schemars(extend("follows" = ["block"]))]
    p2: Auto<u32>,
    /// Which paths are summed.
    mode: Mode,
}
impl Default for SgbmParams {
    fn default() -> Self {
        Self { disparities: 64, block: 5, p1: Auto::Auto, p2: Auto::Auto, mode: Mode::Sgbm }
    }
}
impl SgbmParams {
    fn penalties(&self) -> (u32, u32) {
        let area = self.block * self.block;
        (self.p1.or_else(|| 8 * area), self.p2.or_else(|| 32 * area))
    }
}
node!(Sgbm, "stereo/sgbm", Pure, SgbmParams,
    [port("left", ValueType::Image), port("right", ValueType::Image)] => [port("disparity", ValueType::Disparity)]
    fn check(params: &SgbmParams) -> Result<(), (&'static str, String)> {
        let (p1, p2) = params.penalties();
        if p2 > p1 { Ok(()) } else { Err(("p2", format!("must exceed p1 ({p1})"))) }
    }
    fn resolve(params: &mut SgbmParams) {
        let (p1, p2) = params.penalties();
        (params.p1, params.p2) = (Auto::Value(p1), Auto::Value(p2));
    }
);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct EdgesParams {
    /// The smallest gradient that is an edge.
    #[schemars(range(min = 0, max = 1020))]
    threshold: f32,
}
impl Default for EdgesParams {
    fn default() -> Self {
        Self { threshold: 100.0 }
    }
}
node!(Edges, "confidence/edges", Pure, EdgesParams,
    [port("image", ValueType::Image)] => [port("mask", ValueType::Mask)]);
node!(Sobel, "confidence/sobel", Pure, EdgesParams,
    [port("image", ValueType::Image), port("mask", ValueType::Mask).optional()] => [port("weight", ValueType::Weight)]);

node!(Samples, "learn/samples", Ordered, NoParams,
    [port("image", ValueType::Image), port("target", ValueType::Disparity), port("mask", ValueType::Mask)]
    => [Port::once("samples", ValueType::Samples, "All of them.")]);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SslParams {
    /// The network's name.
    network: String,
    /// How many steps.
    #[schemars(range(min = 1))]
    steps: u32,
    /// Samples a step.
    #[schemars(range(min = 1))]
    batch: u32,
    /// Weights to start from.
    weights: Option<DataPath>,
    /// Steps from one checkpoint to the next.
    #[schemars(range(min = 1), extend("operational" = true))]
    checkpoint_every: u32,
}
impl Default for SslParams {
    fn default() -> Self {
        Self { network: "unet-lite".to_owned(), steps: 2000, batch: 8, weights: None, checkpoint_every: 100 }
    }
}
node!(Ssl, "learn/ssl", Once, SslParams,
    [Port::once("samples", ValueType::Samples, "What to learn from.")] => [Port::once("model", ValueType::Model, "ONNX.")]
    fn check_inputs(params: &SslParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        match upstream.at("samples") {
            Some(InputOrigin::Node(node)) if node.kind == "learn/samples" && node.is_wired("mask") && params.network == "deaf" => {
                Err(Fault::new("a deaf network cannot learn").remedy("choose another"))
            }
            _ => Ok(()),
        }
    }
);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct CapParams {
    /// The largest depth, metres.
    #[schemars(extend("exclusiveMinimum" = 0))]
    cap: f64,
}
impl Default for CapParams {
    fn default() -> Self {
        Self { cap: 80.0 }
    }
}
node!(FromDisparity, "depth/from-disparity", Pure, CapParams,
    [port("disparity", ValueType::Disparity), port("calibration", ValueType::Calibration)] => [port("depth", ValueType::Depth)]);
node!(Onnx, "mono/onnx", Pure, CapParams,
    [port("image", ValueType::Image), port("calibration", ValueType::Calibration), Port::once("model", ValueType::Model, "The network.")]
    => [port("depth", ValueType::Depth)]);

#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Method {
    /// Ranges are made equal.
    #[default]
    Minmax,
    /// Means are made equal.
    Average,
    /// Nothing is done.
    None,
}
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ScaleParams {
    /// How mono is scaled.
    method: Method,
}
node!(Scale, "fusion/scale", Pure, ScaleParams,
    [port("mono", ValueType::Depth), port("stereo", ValueType::Depth)] => [port("depth", ValueType::Depth)]);

#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Weighting {
    #[default]
    Full,
    Confidence,
    Mean,
}
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct MergeParams {
    weighting: Weighting,
}
node!(Merge, "fusion/confidence", Pure, MergeParams,
    [port("mono", ValueType::Depth), port("stereo", ValueType::Depth), port("weight", ValueType::Weight)]
    => [port("depth", ValueType::Depth)]);

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct MedianParams {
    /// The side of the window, pixels.
    #[schemars(range(min = 1, max = 9), extend("not" = { "multipleOf": 2 }))]
    size: u32,
    /// Windows tried in turn.
    sizes: Vec<u32>,
}
impl Default for MedianParams {
    fn default() -> Self {
        Self { size: 5, sizes: Vec::new() }
    }
}
node!(Median, "filter/median", Pure, MedianParams, [port("depth", ValueType::Depth)] => [port("depth", ValueType::Depth)]);

#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Sets {
    #[default]
    All,
    Valid,
}
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ScoreParams {
    /// The named convention.
    preset: Option<String>,
    /// The pixel sets scored.
    sets: Vec<Sets>,
    /// The largest ground truth depth that is scored, metres.
    #[schemars(extend("exclusiveMinimum" = 0))]
    cap: Option<f64>,
}
node!(Score, "score/depth", Pure, ScoreParams,
    [port("estimate", ValueType::Depth), port("ground_truth", ValueType::Depth)] => [port("scores", ValueType::Scores)]);

node!(Average, "toy/average", Ordered, NoParams,
    [port("depth", ValueType::Depth)] => [Port::once("depth", ValueType::Depth, "The mean of all.")]);
node!(Offset, "toy/offset", Pure, NoParams,
    [port("depth", ValueType::Depth), Port::once("offset", ValueType::Depth, "Is added.")] => [port("depth", ValueType::Depth)]);
node!(Broken, "toy/no-engine", Pure, NoParams, [port("image", ValueType::Image)] => [port("depth", ValueType::Depth)]
    fn fingerprint(_: &NoParams) -> Result<Option<Key>, Fault> {
        Err(Fault::new("no engine was found").remedy("install one"))
    }
);

#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Called {
    /// Frame by frame.
    #[default]
    Pure,
    /// Frame by frame in order.
    Ordered,
}
impl Called {
    const fn contract(&self) -> Contract {
        match self {
            Self::Pure => Contract::Pure,
            Self::Ordered => Contract::Ordered,
        }
    }
}
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct OwnParams {
    /// How it is called.
    contract: Called,
    /// Its ports.
    ports: DeclaredPorts,
}
node!(Own, "toy/own", Pure, OwnParams, [] => []
    fn check(params: &OwnParams) -> Result<(), (&'static str, String)> {
        params.ports.check(params.contract.contract()).map_err(|what| ("ports", what))
    }
    const OWN_PORTS: bool = true;
    fn signature(params: &OwnParams) -> Option<Signature> {
        Some(params.ports.signature(params.contract.contract()))
    }
);
