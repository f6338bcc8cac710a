//! Declarations of all kinds.

use std::collections::BTreeSet;

use depthloom_graphs::Port;
use serde_json::{Value as Json, json};

/// The kinds the language's documentation names, with their ports.
const PORTS: [(&str, &[&str], &[&str]); 30] = [
    ("confidence/edges", &["image"], &["mask"]),
    ("confidence/sobel", &["image"], &["weight"]),
    ("depth/files", &["image"], &["depth"]),
    ("depth/from-disparity", &["disparity", "calibration"], &["depth"]),
    ("depth/guided-upsampling", &["image", "depth"], &["depth"]),
    ("disparity/files", &["image"], &["disparity"]),
    ("disparity/fill", &["disparity"], &["disparity"]),
    ("disparity/left-right", &["left", "right"], &["disparity"]),
    ("disparity/speckle", &["disparity"], &["disparity"]),
    ("disparity/weighted-least-squares", &["image", "disparity", "right"], &["disparity"]),
    ("dora", &[], &[]),
    ("filter/median", &["depth"], &["depth"]),
    ("fusion/confidence", &["mono", "stereo", "weight"], &["depth"]),
    ("fusion/facil", &["mono", "stereo", "weight"], &["depth"]),
    ("fusion/inverse-variance", &["mono", "stereo", "calibration"], &["depth", "deviation"]),
    (
        "fusion/learned",
        &["image", "disparity", "consistent", "mono", "weight", "calibration", "model"],
        &["depth", "deviation"],
    ),
    ("fusion/median", &["mono", "stereo", "third"], &["depth"]),
    (
        "fusion/mixture",
        &[
            "disparity",
            "mono",
            "calibration",
            "right",
            "unique",
            "ambiguity",
            "mono_deviation",
            "confidence",
            "reliability",
        ],
        &["depth", "deviation", "inlier", "aligned"],
    ),
    ("fusion/scale", &["mono", "stereo", "weight"], &["depth"]),
    ("learn/reliability", &["disparity", "mono", "calibration", "right", "unique", "ambiguity"], &["reliability"]),
    ("mono/ground-plane", &["image", "calibration"], &["depth"]),
    ("mono/onnx", &["image", "calibration", "model"], &["depth", "deviation", "inverse"]),
    ("onnx", &["model"], &[]),
    // Its ports are declared in an experiment.
    ("process", &[], &[]),
    (
        "score/depth",
        &["estimate", "ground_truth", "deviation", "confidence", "image", "occluded", "obj_map"],
        &["rows"],
    ),
    ("score/disparity", &["estimate", "ground_truth", "calibration", "image", "occluded", "obj_map"], &["rows"]),
    ("stereo/bm", &["left", "right"], &["disparity"]),
    ("stereo/census-sgm", &["left", "right"], &["disparity"]),
    ("stereo/onnx", &["left", "right", "model", "calibration"], &["disparity", "depth", "disparity_right"]),
    ("stereo/sgbm", &["left", "right"], &["disparity", "right", "ambiguity"]),
];

fn names(ports: &[Port]) -> Vec<&str> {
    ports.iter().map(|port| port.name).collect()
}

#[test]
fn kinds_and_ports_are_those_of_the_language() {
    let registry = depthloom_nodes::registry();
    let kinds: Vec<&str> = registry.nodes().map(|node| node.declaration.kind).collect();
    assert_eq!(kinds, PORTS.map(|(kind, ..)| kind));
    for (node, (_, inputs, outputs)) in registry.nodes().zip(PORTS) {
        assert_eq!(names(&node.declaration.inputs), inputs);
        assert_eq!(names(&node.declaration.outputs), outputs);
    }
    let sources: Vec<(&str, Vec<&str>)> =
        registry.sources().map(|source| (source.declaration.kind, names(&source.declaration.outputs))).collect();
    let pair = ["left", "right", "calibration"];
    let with = |more: &[&'static str]| [&pair[..], more].concat();
    let scene = ["depth", "disp_noc", "disp_occ", "occluded"];
    let expected = [
        ("drivingstereo", with(&["depth", "disp_occ"])),
        ("eth3d/two-view", with(&scene)),
        ("images", with(&["depth", "disparity"])),
        ("kitti/depth", with(&["depth"])),
        ("kitti/odometry", with(&[])),
        ("kitti/raw", with(&["depth"])),
        ("kitti/stereo2012", with(&scene)),
        ("kitti/stereo2015", with(&["depth", "disp_noc", "disp_occ", "occluded", "obj_map"])),
        ("middlebury", with(&scene)),
        ("process/source", Vec::new()),
        ("ros2/bag", with(&["depth"])),
        ("scene-flow", with(&["depth", "disp_occ"])),
        ("sintel-stereo", with(&scene)),
        ("synthetic/road", with(&["depth", "dense", "occluded", "disp_noc", "disp_occ", "obj_map"])),
    ];
    assert_eq!(sources, expected);
}

#[test]
fn every_kind_port_and_parameter_is_documented() {
    let registry = depthloom_nodes::registry();
    let nodes = registry.nodes().map(|node| {
        let declaration = &node.declaration;
        let ports: Vec<Port> = [&declaration.inputs[..], &declaration.outputs].concat();
        (declaration.kind, declaration.summary, declaration.doc, ports, &node.schema)
    });
    let sources = registry.sources().map(|source| {
        let declaration = &source.declaration;
        (declaration.kind, declaration.summary, declaration.doc, declaration.outputs.clone(), &source.schema)
    });
    for (kind, summary, doc, ports, schema) in nodes.chain(sources) {
        assert!(summary.ends_with('.') && doc.ends_with('.'), "{kind}: summary and docs are sentences");
        assert!(!doc.contains("  "), "{kind}: a broken line in the docs");
        let unique: BTreeSet<&str> = ports.iter().map(|port| port.name).collect();
        assert!(!unique.is_empty() || kind.starts_with("process") || kind == "dora");
        assert!(ports.iter().all(|port| port.doc.ends_with('.')), "{kind}: a port without a sentence");
        let properties = schema["properties"].as_object().unwrap();
        for (name, property) in properties {
            assert!(property["description"].as_str().is_some_and(|text| text.ends_with('.')), "{kind}: {name}");
            assert!(property.get("default").is_some(), "{kind}: {name} has no default");
        }
        assert_eq!(schema["additionalProperties"], Json::Bool(false), "{kind}: unknown keys must be refused");
    }
}

#[test]
fn defaults_are_the_golden_settings() {
    let registry = depthloom_nodes::registry();
    let defaults = |kind: &str| registry.node_kind(kind).unwrap().resolve(&json!({})).unwrap();
    assert_eq!(
        defaults("stereo/sgbm"),
        json!({
            "disparities": 64, "min_disparity": 0, "block": 5, "p1": 200, "p2": 800, "disp12_max_diff": -1,
            "prefilter_cap": 63, "uniqueness": 0, "speckle_window": 0, "speckle_range": 0, "mode": "sgbm",
            "extend_left": false, "right": false, "ambiguity": false
        })
    );
    assert_eq!(
        defaults("stereo/census-sgm"),
        json!({
            "disparities": 64, "min_disparity": 0, "p1": 10, "p2": 120, "uniqueness": 5, "subpixel": true, "lr_max_diff": 1,
            "census": "symmetric", "paths": 8
        })
    );
    assert_eq!(
        defaults("stereo/bm"),
        json!({
            "disparities": 64, "min_disparity": 0, "block": 21, "prefilter": "xsobel", "prefilter_size": 9, "prefilter_cap": 31,
            "texture_threshold": 10, "uniqueness": 15, "disp12_max_diff": -1, "speckle_window": 0, "speckle_range": 0
        })
    );
    assert_eq!(defaults("disparity/left-right"), json!({ "max_difference": 1.0 }));
    assert_eq!(defaults("disparity/speckle"), json!({ "window": 100, "range": 1.0 }));
    assert_eq!(defaults("disparity/fill"), json!({ "longest": null }));
    assert_eq!(
        defaults("disparity/weighted-least-squares"),
        json!({
            "lambda": 8000.0, "sigma": 1.0, "lambda_attenuation": 0.25, "iterations": 3, "fill": true,
            "max_difference": 1.5, "discontinuity_radius": 5,
        })
    );
    assert_eq!(defaults("depth/from-disparity"), json!({ "cap": 80.0 }));
    assert_eq!(defaults("confidence/edges"), json!({ "threshold": 100.0 }));
    assert_eq!(defaults("confidence/sobel"), json!({ "threshold": 100.0, "sigma": 10.0 }));
    assert_eq!(
        defaults("mono/ground-plane"),
        json!({ "height_m": 1.65, "horizon": 0.461, "nearest_m": 1.0, "cap": 80.0 })
    );
    assert_eq!(
        defaults("fusion/scale"),
        json!({
            "method": "minmax", "mono": "depth", "domain": "inverse-depth", "cap": 80.0, "sigma": 30.0, "prior": 0.05
        })
    );
    assert_eq!(defaults("fusion/confidence"), json!({ "weighting": "full" }));
    assert_eq!(defaults("fusion/learned"), json!({ "cap": 80.0, "provider": "cpu", "threads": 1 }));
    // `mixture_oracle.py` and `local_mixture_oracle.py`; the first has no near rule. `regulariser` is 0.05 there; 0.02
    // is better in every fold of `experiments/cross-validation.yaml`.
    assert_eq!(
        defaults("fusion/mixture"),
        json!({
            "alignment": "local", "disparities": 64, "stereo_noise": 1.0, "mono_spread": 0.4, "outliers": 128_f64.ln(),
            "cap": 80.0,
            "prior": {
                "consistent": 0.99, "close": 0.8, "inconsistent": 0.35, "keep": 0.97, "not_unique": 0.5,
                "near_factor": 1.5, "near": 0.02, "unique_ambiguity": 0.9, "unconfident": 1.0,
                "support": { "radius": 10, "low": 0.3, "high": 0.8, "floor": 0.05 },
            },
            "local": { "sigma": 18.0, "regulariser": 0.02, "iterations": 4, "least_spread": 0.05 },
        })
    );
    assert_eq!(defaults("filter/median"), json!({ "size": 5 }));
    assert_eq!(defaults("score/depth")["preset"], "martins2018");
    // The metadata of the model, else the share.
    assert_eq!(defaults("mono/onnx")["output"], json!(null));
}

#[test]
fn resolving_twice_changes_nothing() {
    let registry = depthloom_nodes::registry();
    for node in registry.nodes() {
        // What has no ports by itself is given some.
        let least = match node.declaration.kind {
            "process" => json!({ "command": ["true"], "ports": { "inputs": { "a": { "type": "depth" } } } }),
            "depth/files" | "disparity/files" => json!({ "files": "{frame}.npy" }),
            "dora" => json!({ "path": "a.py", "ports": { "inputs": { "a": "depth" }, "outputs": { "b": "depth" } } }),
            "onnx" => {
                json!({ "ports": { "inputs": { "a": { "type": "depth" } }, "outputs": { "b": { "type": "mask" } } } })
            }
            _ => json!({}),
        };
        let once = node.resolve(&least).unwrap();
        assert_eq!(node.resolve(&once).unwrap(), once, "{}", node.declaration.kind);
    }
    let road = registry.source_kind("synthetic/road").unwrap();
    let once = road.resolve(&json!({ "frames": [3, 5], "seed": 7 })).unwrap();
    assert_eq!(road.resolve(&once).unwrap(), once);
}

#[test]
fn parameters_that_no_schema_can_refuse_are_refused_by_name() {
    let registry = depthloom_nodes::registry();
    let refused = [
        ("stereo/sgbm", json!({ "disparities": 40 }), "disparities"),
        ("stereo/sgbm", json!({ "block": 4 }), "block"),
        ("stereo/sgbm", json!({ "p1": 800, "p2": 800 }), "p2"),
        ("stereo/sgbm", json!({ "mode": "sgm" }), "mode"),
        ("stereo/census-sgm", json!({ "disparities": 40 }), "disparities"),
        ("stereo/census-sgm", json!({ "paths": 5 }), "paths"),
        ("stereo/census-sgm", json!({ "census": "full", "p2": 200 }), "p2"),
        ("stereo/census-sgm", json!({ "p1": 121 }), "p1"),
        ("stereo/bm", json!({ "disparities": 40 }), "disparities"),
        ("stereo/bm", json!({ "block": 8 }), "block"),
        ("stereo/bm", json!({ "prefilter_size": 6 }), "prefilter_size"),
        ("stereo/bm", json!({ "prefilter_cap": 64 }), "prefilter_cap"),
        ("stereo/bm", json!({ "uniqueness": -1 }), "uniqueness"),
        ("disparity/left-right", json!({ "max_difference": -1 }), "max_difference"),
        ("disparity/speckle", json!({ "range": -0.5 }), "range"),
        ("disparity/fill", json!({ "longest": -1 }), "longest"),
        ("disparity/weighted-least-squares", json!({ "lambda": 1_000_001 }), "lambda"),
        ("disparity/weighted-least-squares", json!({ "sigma": 0 }), "sigma"),
        ("disparity/weighted-least-squares", json!({ "iterations": 0 }), "iterations"),
        ("depth/from-disparity", json!({ "cap": 0 }), "cap"),
        ("depth/from-disparity", json!({ "capp": 80 }), "capp"),
        ("confidence/sobel", json!({ "sigma": 0.0 }), "sigma"),
        ("learn/reliability", json!({ "stereo_noise": 0 }), "stereo_noise"),
        ("mono/ground-plane", json!({ "height_m": -1.0 }), "height_m"),
        ("mono/ground-plane", json!({ "cap": 0.5 }), "cap"),
        ("mono/onnx", json!({ "std": [1.0, 0.0, 1.0] }), "std"),
        ("mono/onnx", json!({ "round": false }), "round"),
        ("filter/median", json!({ "size": 4 }), "size"),
        ("fusion/learned", json!({ "cap": 0 }), "cap"),
        ("fusion/mixture", json!({ "alignment": "global" }), "alignment"),
        ("fusion/mixture", json!({ "disparities": 0 }), "disparities"),
        ("fusion/mixture", json!({ "cap": 0 }), "cap"),
        ("fusion/mixture", json!({ "stereo_noise": 0 }), "stereo_noise"),
        ("fusion/mixture", json!({ "prior": { "near": 1.5 } }), "prior.near"),
        ("fusion/mixture", json!({ "prior": { "nearer": 1 } }), "nearer"),
        ("fusion/mixture", json!({ "local": { "sigma": 0.5 } }), "local.sigma"),
        ("fusion/mixture", json!({ "local": { "least_spread": 0.5 } }), "local.least_spread"),
        ("dora", json!({}), "path"),
        ("dora", json!({ "path": "a.py" }), "ports"),
        (
            "dora",
            json!({ "path": "a.py", "ports": { "inputs": { "a": "scores" }, "outputs": { "b": "depth" } } }),
            "ports",
        ),
        (
            "dora",
            json!({ "path": "a", "ports": { "inputs": { "a": { "type": "depth", "rate": "once" } }, "outputs": { "b": "depth" } } }),
            "ports",
        ),
        (
            "dora",
            json!({ "path": "a", "ports": { "inputs": { "a": "depth" }, "outputs": { "b": { "type": "depth", "optional": true } } } }),
            "ports",
        ),
        (
            "dora",
            json!({ "path": "a", "values": "flat", "ports": { "inputs": { "a": "calibration" }, "outputs": { "b": "depth" } } }),
            "ports",
        ),
        (
            "dora",
            json!({ "path": "a", "ports": { "inputs": { "a": "depth" }, "outputs": { "b": "depth" } }, "timeout_s": 0 }),
            "timeout_s",
        ),
        ("process", json!({}), "command"),
        ("process", json!({ "command": ["a\0b"] }), "command"),
        ("process", json!({ "command": ["a"] }), "ports"),
        ("process", json!({ "command": ["a"], "ports": { "inputs": { "a": "scores" } } }), "ports"),
        ("process", json!({ "command": ["a"], "ports": { "inputs": { "a": "depth" } }, "timeout_s": 0 }), "timeout_s"),
        ("process", json!({ "command": ["a"], "version": 1, "code": ["a.py"] }), "code"),
        ("process", json!({ "command": ["a"], "env": { "A=B": "c" } }), "env"),
        ("process", json!({ "command": ["a"], "contract": "once", "ports": { "outputs": { "a": "depth" } } }), "ports"),
        ("score/depth", json!({ "sets": [] }), "sets"),
        ("score/depth", json!({ "sets": ["all", "all"] }), "sets"),
        ("score/depth", json!({ "max_m": 0.0001 }), "max_m"),
        ("score/depth", json!({ "preset": "papers" }), "preset"),
    ];
    for (kind, params, name) in refused {
        let error = registry.node_kind(kind).unwrap().resolve(&params).unwrap_err();
        let named = error.path.iter().any(|segment| segment == name) || error.what.contains(&format!("`{name}`"));
        assert!(named, "{kind} {params}: {error:?} does not name {name}");
    }
}
