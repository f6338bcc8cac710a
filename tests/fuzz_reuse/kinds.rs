//! The node kinds that random experiments are made of: ports, parameters and the values that these may have.
//!
//! [`check_complete`] compares this table with the registry, so that a new kind cannot be forgotten.

use std::collections::BTreeSet;

/// What type a value has, as far as it decides which ports can be connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Type {
    Image,
    Disparity,
    TrueDisparity,
    Depth,
    Weight,
    Mask,
    Calibration,
    Samples,
    /// Samples of `learn/fusion-samples`.
    FusionSamples,
    Model,
    /// A network of `learn/fusion`.
    FusionModel,
    Reliability,
    /// A value of the type `model` that is not a network: what a program returns once per stage.
    Bytes,
    Curve,
}

impl Type {
    /// Whether there is one value per stage and not one per frame.
    pub(crate) const fn is_aggregate(self) -> bool {
        matches!(
            self,
            Self::Samples
                | Self::FusionSamples
                | Self::Model
                | Self::FusionModel
                | Self::Reliability
                | Self::Bytes
                | Self::Curve
        )
    }
}

/// A port's name and type.
pub(crate) type Port = (&'static str, Type);

/// A parameter (a path in `with`, `zones.rows`) and the JSON texts of the values that it may have.
pub(crate) type Parameter = (&'static str, &'static [&'static str]);

/// How a node is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Contract {
    /// For each frame, without memory.
    Pure,
    /// For each frame in order, with memory.
    Ordered,
    /// Once per stage.
    Aggregate,
}

/// A row of the table. Several rows may have the same registry kind.
#[derive(Debug)]
pub(crate) struct Kind {
    /// The name of the row.
    pub label: &'static str,
    /// The kind in the registry.
    pub kind: &'static str,
    pub contract: Contract,
    pub inputs: &'static [Port],
    pub optional_inputs: &'static [Port],
    pub outputs: &'static [Port],
    /// Parameters that are always there, as a JSON object.
    pub fixed: &'static str,
    pub parameters: &'static [Parameter],
    /// Files that the input `model` may be read from.
    pub model_files: &'static [&'static str],
    /// How often it is chosen, relative to the others.
    pub share: usize,
}

const PAIR: &[Port] = &[("left", Type::Image), ("right", Type::Image)];
const IMAGE: &[Port] = &[("image", Type::Image)];
const IMAGE_OF_CAMERA: &[Port] = &[("image", Type::Image), ("calibration", Type::Calibration)];
const DISPARITY: &[Port] = &[("disparity", Type::Disparity)];
const DEPTH: &[Port] = &[("depth", Type::Depth)];
const NONE: &[Port] = &[];

const DEFAULT: Kind = Kind {
    label: "",
    kind: "",
    contract: Contract::Pure,
    inputs: NONE,
    optional_inputs: NONE,
    outputs: NONE,
    fixed: "{}",
    parameters: &[],
    model_files: &[],
    share: 4,
};

const BLOCKS: &[&str] = &["3", "5", "7", "9", "\"${BLOCK:-5}\""];
const CAPS: &[&str] = &["20", "40", "80", "null"];
const ZONES: &[&str] = &["0", "2", "3"];
const GAINS: Parameter = ("params.gain", &["2", "3", "4", "\"low\"", "{\"near\": 1, \"far\": 2}"]);
const FAILS: Parameter = ("params.fail", &["true", "false", "false"]);
const VERSIONS: Parameter = ("version", &["1", "2", "3"]);
const VARIABLES: Parameter = ("env", &["{\"GAIN\": \"2\"}", "{\"GAIN\": \"3\"}", "{\"GAIN\": \"${LEVEL:-1}\"}", "{}"]);
const ARGUMENTS: Parameter = (
    "command",
    &[
        "[\"PROGRAM\", \"--process\"]",
        "[\"PROGRAM\", \"--process\", \"a\", \"b\"]",
        "[\"PROGRAM\", \"--process\", \"ab\"]",
    ],
);

/// The row of nodes in Python, which import a module.
pub(crate) const PYTHON: &str = "process, in Python";

/// All rows.
pub(crate) const KINDS: &[Kind] = &[
    Kind {
        label: "stereo/sgbm",
        kind: "stereo/sgbm",
        inputs: PAIR,
        outputs: DISPARITY,
        fixed: "{\"disparities\": 16}",
        parameters: &[
            ("block", BLOCKS),
            ("disparities", &["16", "32"]),
            ("mode", &["\"sgbm\"", "\"hh\"", "\"3way\"", "\"hh4\""]),
            ("uniqueness", &["0", "5", "15"]),
            ("min_disparity", &["0", "1", "-2"]),
            ("extend_left", &["true", "false"]),
        ],
        share: 10,
        ..DEFAULT
    },
    Kind {
        label: "stereo/sgbm, all outputs",
        kind: "stereo/sgbm",
        inputs: PAIR,
        outputs: &[("disparity", Type::Disparity), ("right", Type::Disparity), ("ambiguity", Type::Weight)],
        fixed: "{\"disparities\": 16, \"right\": true, \"ambiguity\": true}",
        parameters: &[
            ("mode", &["\"sgbm\"", "\"hh\"", "\"3way\"", "\"hh4\""]),
            ("uniqueness", &["0", "5", "15"]),
            ("extend_left", &["true", "false"]),
        ],
        ..DEFAULT
    },
    Kind {
        label: "stereo/bm",
        kind: "stereo/bm",
        inputs: PAIR,
        outputs: DISPARITY,
        fixed: "{\"disparities\": 16, \"block\": 7}",
        parameters: &[
            ("block", &["5", "7", "9"]),
            ("prefilter", &["\"xsobel\"", "\"normalized-response\""]),
            ("texture_threshold", &["0", "10"]),
            ("uniqueness", &["0", "15"]),
        ],
        ..DEFAULT
    },
    Kind {
        label: "stereo/census-sgm",
        kind: "stereo/census-sgm",
        inputs: PAIR,
        outputs: DISPARITY,
        fixed: "{\"disparities\": 16}",
        parameters: &[
            ("census", &["\"symmetric\"", "\"full\"", "\"off-axis\""]),
            ("paths", &["4", "8"]),
            ("subpixel", &["true", "false"]),
            ("p1", &["5", "10"]),
        ],
        ..DEFAULT
    },
    Kind {
        label: "depth/from-disparity",
        kind: "depth/from-disparity",
        inputs: &[("disparity", Type::Disparity), ("calibration", Type::Calibration)],
        outputs: DEPTH,
        parameters: &[("cap", CAPS)],
        share: 10,
        ..DEFAULT
    },
    Kind {
        label: "confidence/edges",
        kind: "confidence/edges",
        inputs: IMAGE,
        outputs: &[("mask", Type::Mask)],
        fixed: "{\"threshold\": 20}",
        parameters: &[("threshold", &["10", "20", "100"])],
        ..DEFAULT
    },
    Kind {
        label: "confidence/sobel",
        kind: "confidence/sobel",
        inputs: IMAGE,
        outputs: &[("weight", Type::Weight)],
        parameters: &[("threshold", &["20", "100"]), ("sigma", &["1", "2", "10"])],
        ..DEFAULT
    },
    Kind {
        label: "depth/files",
        kind: "depth/files",
        inputs: IMAGE,
        outputs: DEPTH,
        fixed: "{\"files\": \"maps.npy\", \"resize\": \"nearest\"}",
        parameters: &[
            ("divide_by", &["1", "2"]),
            ("resize", &["\"nearest\"", "\"bilinear\""]),
            ("quantity", &["\"depth\"", "\"inverse-depth\""]),
            ("cap", CAPS),
        ],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "disparity/files",
        kind: "disparity/files",
        inputs: IMAGE,
        outputs: DISPARITY,
        fixed: "{\"files\": \"maps.npy\", \"resize\": \"nearest\", \"divide_by\": 4}",
        parameters: &[("invalid", &["7", "null"]), ("divide_by", &["4", "5"])],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "disparity/fill",
        kind: "disparity/fill",
        inputs: DISPARITY,
        outputs: DISPARITY,
        parameters: &[("longest", &["1", "3", "null"])],
        ..DEFAULT
    },
    Kind {
        label: "disparity/left-right",
        kind: "disparity/left-right",
        inputs: &[("left", Type::Disparity), ("right", Type::Disparity)],
        outputs: DISPARITY,
        parameters: &[("max_difference", &["1", "2", "4000"])],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "disparity/speckle",
        kind: "disparity/speckle",
        inputs: DISPARITY,
        outputs: DISPARITY,
        parameters: &[("window", &["5", "20", "100"]), ("range", &["1", "2"])],
        ..DEFAULT
    },
    Kind {
        label: "disparity/weighted-least-squares",
        kind: "disparity/weighted-least-squares",
        inputs: &[("image", Type::Image), ("disparity", Type::Disparity)],
        optional_inputs: &[("right", Type::Disparity)],
        outputs: DISPARITY,
        parameters: &[("lambda", &["100", "8000"]), ("iterations", &["1", "3"]), ("fill", &["true", "false"])],
        share: 3,
        ..DEFAULT
    },
    Kind {
        label: "filter/median",
        kind: "filter/median",
        inputs: DEPTH,
        outputs: DEPTH,
        parameters: &[("size", &["3", "5", "\"${SIZE:-5}\""])],
        share: 10,
        ..DEFAULT
    },
    Kind {
        label: "fusion/confidence",
        kind: "fusion/confidence",
        inputs: &[("mono", Type::Depth), ("stereo", Type::Depth), ("weight", Type::Weight)],
        outputs: DEPTH,
        parameters: &[("weighting", &["\"full\"", "\"confidence\"", "\"mean\"", "\"fill\""])],
        share: 8,
        ..DEFAULT
    },
    Kind {
        label: "fusion/learned",
        kind: "fusion/learned",
        inputs: &[
            ("image", Type::Image),
            ("disparity", Type::Disparity),
            ("consistent", Type::Disparity),
            ("mono", Type::Depth),
            ("weight", Type::Weight),
            ("calibration", Type::Calibration),
            ("model", Type::FusionModel),
        ],
        outputs: &[("depth", Type::Depth), ("deviation", Type::Depth)],
        parameters: &[("cap", CAPS)],
        share: 1,
        ..DEFAULT
    },
    Kind {
        label: "fusion/mixture",
        kind: "fusion/mixture",
        inputs: &[("disparity", Type::Disparity), ("mono", Type::Depth), ("calibration", Type::Calibration)],
        optional_inputs: &[
            ("right", Type::Disparity),
            ("unique", Type::Disparity),
            ("ambiguity", Type::Weight),
            ("confidence", Type::Weight),
            ("mono_deviation", Type::Depth),
            ("reliability", Type::Reliability),
        ],
        outputs: &[
            ("depth", Type::Depth),
            ("deviation", Type::Depth),
            ("inlier", Type::Weight),
            ("aligned", Type::Depth),
        ],
        // At least as many as any matcher searches.
        fixed: "{\"disparities\": 64}",
        parameters: &[
            ("alignment", &["\"none\"", "\"local\""]),
            ("disparities", &["64", "128"]),
            ("cap", CAPS),
            ("prior.near", &["0.02", "1"]),
            ("local.sigma", &["3", "18"]),
            ("local.iterations", &["1", "4"]),
        ],
        share: 5,
        ..DEFAULT
    },
    Kind {
        label: "fusion/scale",
        kind: "fusion/scale",
        inputs: &[("mono", Type::Depth), ("stereo", Type::Depth)],
        optional_inputs: &[("weight", Type::Weight)],
        outputs: DEPTH,
        parameters: &[
            (
                "method",
                &[
                    "\"minmax\"",
                    "\"average\"",
                    "\"none\"",
                    "\"least-squares\"",
                    "\"robust\"",
                    "\"median\"",
                    "\"local\"",
                ],
            ),
            ("domain", &["\"inverse-depth\"", "\"depth\""]),
            ("sigma", &["8", "30"]),
            ("cap", &["40", "80"]),
        ],
        share: 6,
        ..DEFAULT
    },
    Kind {
        label: "mono/ground-plane",
        kind: "mono/ground-plane",
        inputs: IMAGE_OF_CAMERA,
        outputs: DEPTH,
        parameters: &[("height_m", &["1.2", "1.65"]), ("horizon", &["0.4", "0.461"]), ("cap", &["40", "80"])],
        share: 8,
        ..DEFAULT
    },
    Kind {
        label: "fusion/facil",
        kind: "fusion/facil",
        inputs: &[("mono", Type::Depth), ("stereo", Type::Depth), ("weight", Type::Weight)],
        outputs: DEPTH,
        parameters: &[("spacing", &["24", "40"]), ("min_confidence", &["0", "0.5"])],
        ..DEFAULT
    },
    Kind {
        label: "fusion/inverse-variance",
        kind: "fusion/inverse-variance",
        inputs: &[("mono", Type::Depth), ("stereo", Type::Depth), ("calibration", Type::Calibration)],
        outputs: &[("depth", Type::Depth), ("deviation", Type::Depth)],
        parameters: &[("disparity_deviation", &["0.5", "1"]), ("mono_deviation", &["0.1", "0.2"])],
        ..DEFAULT
    },
    Kind {
        label: "fusion/median",
        kind: "fusion/median",
        inputs: &[("mono", Type::Depth), ("stereo", Type::Depth)],
        optional_inputs: &[("third", Type::Depth)],
        outputs: DEPTH,
        parameters: &[("of_two", &["\"geometric\"", "\"arithmetic\""])],
        ..DEFAULT
    },
    Kind {
        label: "depth/guided-upsampling",
        kind: "depth/guided-upsampling",
        inputs: &[("image", Type::Image), ("depth", Type::Depth)],
        outputs: DEPTH,
        parameters: &[("radius", &["4", "8"]), ("smooth", &["true", "false"])],
        ..DEFAULT
    },
    Kind {
        label: "score/depth",
        kind: "score/depth",
        inputs: &[("estimate", Type::Depth), ("ground_truth", Type::Depth)],
        optional_inputs: &[("image", Type::Image), ("occluded", Type::Mask), ("deviation", Type::Depth)],
        parameters: &[("zones.rows", ZONES), ("align", &["\"none\"", "\"median\""]), ("max_m", &["30", "80"])],
        share: 3,
        ..DEFAULT
    },
    Kind {
        label: "score/disparity",
        kind: "score/disparity",
        inputs: &[("estimate", Type::Disparity), ("ground_truth", Type::TrueDisparity)],
        optional_inputs: &[("obj_map", Type::Mask), ("calibration", Type::Calibration)],
        parameters: &[("zones.columns", ZONES), ("mean", &["\"frames\"", "\"pixels\""])],
        share: 3,
        ..DEFAULT
    },
    Kind {
        label: "mono/onnx",
        kind: "mono/onnx",
        inputs: &[("image", Type::Image), ("calibration", Type::Calibration), ("model", Type::Model)],
        outputs: DEPTH,
        fixed: "{\"output\": \"disparity-share\"}",
        parameters: &[("cap", CAPS), ("flip", &["\"none\"", "\"mean\""]), ("output_scale", &["0.5", "1"])],
        model_files: &["net-a.onnx", "net-b.onnx"],
        share: 3,
        ..DEFAULT
    },
    Kind {
        label: "onnx",
        kind: "onnx",
        inputs: &[("image", Type::Image), ("model", Type::Model)],
        outputs: &[("weight", Type::Weight)],
        fixed: "{\"ports\": {\"inputs\": {\"image\": {\"type\": \"image\"}}, \"outputs\": {\"weight\": {\"type\": \"weight\"}}}}",
        parameters: &[("fit", &["\"pad\"", "\"resize\""])],
        model_files: &["net-a.onnx", "net-b.onnx"],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "stereo/onnx",
        kind: "stereo/onnx",
        inputs: &[
            ("left", Type::Image),
            ("right", Type::Image),
            ("calibration", Type::Calibration),
            ("model", Type::Model),
        ],
        outputs: &[("disparity", Type::Disparity), ("depth", Type::Depth)],
        fixed: "{\"output_scale\": 16}",
        parameters: &[("cap", CAPS), ("output_scale", &["8", "16"])],
        model_files: &["pair-a.onnx", "pair-b.onnx"],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "learn/fusion",
        kind: "learn/fusion",
        contract: Contract::Aggregate,
        inputs: &[("samples", Type::FusionSamples)],
        optional_inputs: &[("validation", Type::FusionSamples)],
        outputs: &[("model", Type::FusionModel), ("curve", Type::Curve)],
        fixed: "{\"steps\": 1, \"batch\": 1, \"curve_every\": 1, \"window\": [32, 16]}",
        parameters: &[("steps", &["1", "2"]), ("seed", &["1", "2"]), ("hidden", &["0.5", "0.6"])],
        share: 1,
        ..DEFAULT
    },
    Kind {
        label: "learn/fusion-samples",
        kind: "learn/fusion-samples",
        contract: Contract::Ordered,
        inputs: &[
            ("image", Type::Image),
            ("disparity", Type::Disparity),
            ("consistent", Type::Disparity),
            ("mono", Type::Depth),
            ("weight", Type::Weight),
            ("calibration", Type::Calibration),
        ],
        optional_inputs: &[("target", Type::Disparity)],
        outputs: &[("samples", Type::FusionSamples)],
        fixed: "{\"size\": [32, 32], \"coverage\": 0}",
        parameters: &[("size", &["[32, 32]", "[64, 32]"]), ("least_disparity", &["0", "0.5", "2"])],
        share: 2,
        ..DEFAULT
    },
    Kind {
        // Without `model` and `schedule`: networks of other layers, and versions of other runs, are errors.
        label: "learn/online",
        kind: "learn/online",
        contract: Contract::Ordered,
        inputs: &[
            ("image", Type::Image),
            ("target", Type::Disparity),
            ("mask", Type::Mask),
            ("calibration", Type::Calibration),
        ],
        outputs: &[("depth", Type::Depth), ("model", Type::Model), ("curve", Type::Curve)],
        fixed: "{\"network\": \"unet-tiny\", \"size\": [32, 32], \"coverage\": 0, \"first\": 1, \"period\": 1, \
                \"steps\": 1, \"batch\": 1}",
        parameters: &[("memory", &["1", "3"]), ("period", &["1", "2"]), ("seed", &["1", "2"]), ("cap", &["20", "80"])],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "learn/reliability",
        kind: "learn/reliability",
        contract: Contract::Ordered,
        inputs: &[("disparity", Type::Disparity), ("mono", Type::Depth), ("calibration", Type::Calibration)],
        optional_inputs: &[("right", Type::Disparity), ("unique", Type::Disparity), ("ambiguity", Type::Weight)],
        outputs: &[("reliability", Type::Reliability)],
        fixed: "{\"disparities\": 64}",
        parameters: &[("disparities", &["64", "128"]), ("stereo_noise", &["0.5", "1"]), ("cap", CAPS)],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "learn/samples",
        kind: "learn/samples",
        contract: Contract::Ordered,
        inputs: &[("image", Type::Image), ("target", Type::Disparity), ("mask", Type::Mask)],
        optional_inputs: &[("calibration", Type::Calibration), ("right", Type::Image)],
        outputs: &[("samples", Type::Samples)],
        fixed: "{\"size\": [32, 32], \"coverage\": 0}",
        parameters: &[
            ("size", &["[32, 32]", "[64, 32]"]),
            ("least_disparity", &["0", "0.5", "2"]),
            ("coverage", &["0", "0.1"]),
        ],
        share: 8,
        ..DEFAULT
    },
    Kind {
        label: "learn/ssl",
        kind: "learn/ssl",
        contract: Contract::Aggregate,
        inputs: &[("samples", Type::Samples)],
        optional_inputs: &[("validation", Type::Samples)],
        outputs: &[("model", Type::Model), ("curve", Type::Curve)],
        fixed: "{\"steps\": 1, \"batch\": 1, \"curve_every\": 1}",
        parameters: &[
            ("steps", &["1", "2"]),
            ("network", &["\"unet-lite\"", "\"fcn-lite\""]),
            ("penalty", &["\"absolute\"", "\"berhu\""]),
            ("seed", &["1", "2", "\"${SEED:-3}\""]),
            ("flip", &["true", "false"]),
        ],
        share: 1,
        ..DEFAULT
    },
    Kind {
        label: "process, pure, by version",
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"version\": 1, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS, VARIABLES, VERSIONS, ARGUMENTS, FAILS],
        ..DEFAULT
    },
    Kind {
        label: "process, pure, by one file of code",
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"code\": [\"gain-a.txt\"], \"params\": {\"read\": [\"gain-a.txt\"]}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS, VARIABLES],
        ..DEFAULT
    },
    Kind {
        label: "process, pure, by two files of code",
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"code\": [\"gain-a.txt\", \"gain-b.txt\"], \
                \"params\": {\"read\": [\"gain-b.txt\", \"gain-a.txt\"]}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS, ARGUMENTS],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "process, pure, never reused",
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"params\": {\"read\": [\"gain-c.txt\"]}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "process, ordered, by version",
        kind: "process",
        contract: Contract::Ordered,
        inputs: DEPTH,
        outputs: &[("depth", Type::Depth), ("total", Type::Curve)],
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"ordered\", \"version\": 1, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \
                \"outputs\": {\"depth\": \"depth\", \"total\": {\"type\": \"curve\", \"rate\": \"once\"}}}}",
        parameters: &[GAINS, VERSIONS, FAILS],
        ..DEFAULT
    },
    Kind {
        label: "process, ordered, by code",
        kind: "process",
        contract: Contract::Ordered,
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"ordered\", \"code\": [\"gain-b.txt\"], \
                \"params\": {\"read\": [\"gain-b.txt\"]}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS, VARIABLES],
        ..DEFAULT
    },
    Kind {
        label: "process, ordered, never reused",
        kind: "process",
        contract: Contract::Ordered,
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"ordered\", \"params\": {\"read\": [\"gain-c.txt\"]}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "process, pure, with a file per frame",
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"version\": 1, \"reads\": \"predictions/{frame}.txt\", \
                \"params\": {\"reads\": \"predictions/{frame}.txt\"}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS, VERSIONS],
        ..DEFAULT
    },
    Kind {
        label: "process, ordered, with a file per frame",
        kind: "process",
        contract: Contract::Ordered,
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"ordered\", \"code\": [\"gain-a.txt\"], \
                \"reads\": [\"predictions/{frame}.txt\"], \
                \"params\": {\"read\": [\"gain-a.txt\"], \"reads\": \"predictions/{frame}.txt\"}, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "process, once per stage",
        kind: "process",
        contract: Contract::Aggregate,
        outputs: &[("model", Type::Bytes)],
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"once\", \"code\": [\"gain-a.txt\"], \
                \"params\": {\"read\": [\"gain-a.txt\"]}, \
                \"ports\": {\"outputs\": {\"model\": {\"type\": \"model\", \"rate\": \"once\"}}}}",
        parameters: &[GAINS],
        share: 2,
        ..DEFAULT
    },
    Kind {
        label: "process, once per stage, of samples",
        kind: "process",
        contract: Contract::Aggregate,
        inputs: &[("samples", Type::Samples)],
        outputs: &[("model", Type::Bytes)],
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"contract\": \"once\", \"version\": 1, \
                \"ports\": {\"inputs\": {\"samples\": {\"type\": \"samples\", \"rate\": \"once\"}}, \
                \"outputs\": {\"model\": {\"type\": \"model\", \"rate\": \"once\"}}}}",
        parameters: &[GAINS, VERSIONS],
        ..DEFAULT
    },
    Kind {
        label: "process, pure, with a model",
        kind: "process",
        inputs: &[("depth", Type::Depth), ("model", Type::Bytes)],
        outputs: DEPTH,
        fixed: "{\"command\": [\"PROGRAM\", \"--process\"], \"version\": 1, \
                \"ports\": {\"inputs\": {\"depth\": \"depth\", \"model\": {\"type\": \"model\", \"rate\": \"once\"}}, \
                \"outputs\": {\"depth\": \"depth\"}}}",
        parameters: &[GAINS],
        ..DEFAULT
    },
    Kind {
        label: PYTHON,
        kind: "process",
        inputs: DEPTH,
        outputs: DEPTH,
        fixed: "{\"command\": [\"python3\", \"node.py\"], \"code\": [\"node.py\"], \
                \"ports\": {\"inputs\": {\"depth\": \"depth\"}, \"outputs\": {\"depth\": \"depth\"}}}",
        // Starting Python takes longer than all else: few sequences have such a node.
        share: 0,
        ..DEFAULT
    },
];

/// The row of that name.
pub(crate) fn kind(label: &str) -> &'static Kind {
    KINDS.iter().find(|kind| kind.label == label).expect("nodes are made from rows of the table")
}

/// Kinds that need programs or data which this test does not have.
const NOT_COVERED: &[&str] = &["dora"];

/// Source kinds that need a data set in a published layout, or a bag.
const SOURCES_NOT_COVERED: &[&str] = &[
    "drivingstereo",
    "eth3d/two-view",
    "kitti/depth",
    "kitti/odometry",
    "kitti/raw",
    "kitti/stereo2012",
    "kitti/stereo2015",
    "middlebury",
    "ros2/bag",
    "scene-flow",
    "sintel-stereo",
];
const SOURCES_COVERED: &[&str] = &["images", "mcap", "process/source", "synthetic/road"];

/// Checks that the table has every kind of the registry.
///
/// # Panics
/// If it does not.
pub(crate) fn check_complete(nodes: &BTreeSet<String>, sources: &BTreeSet<String>) {
    let known: BTreeSet<String> =
        KINDS.iter().map(|kind| kind.kind).chain(NOT_COVERED.iter().copied()).map(str::to_owned).collect();
    assert_eq!(nodes, &known, "tests/fuzz_reuse/kinds.rs lists other node kinds than the registry");
    let known: BTreeSet<String> =
        SOURCES_COVERED.iter().chain(SOURCES_NOT_COVERED).map(|kind| (*kind).to_owned()).collect();
    assert_eq!(sources, &known, "tests/fuzz_reuse/kinds.rs lists other source kinds than the registry");
}
