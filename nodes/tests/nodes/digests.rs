//! A kind's outputs change only with its version.
//!
//! `digests.txt` holds, for every kind and version, the digest of its outputs on small fixed inputs. A test fails when
//! outputs changed and the version did not: values under old keys would be taken for new ones. After raising a version,
//! `DEPTHLOOM_ACCEPT_DIGESTS=1 cargo test -p depthloom-nodes` adds its line; a line that is there is never changed.

use depthloom_graphs::plan::FrameIndex;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use depthloom_graphs::values::{Depth, Disparity, Image, Pixels, Raster, RelativeInverseDepth, TrueDisparity, Weight};
use depthloom_graphs::{Key, Value};
use image::{ImageBuffer, Luma, RgbImage};
use serde_json::{Value as Json, json};

use crate::call::{Values, call, model, open};
use crate::learned_fusion::network as network_of_planes;
use crate::steps::calibration;
use crate::{images, kitti_family, kitti_raw, predictions, ros2_bag, stereo_sets};
use depthloom_test_needs::onnx_file::{self, F32, Tensor};

const WIDTH: u32 = 90;
const HEIGHT: u32 = 40;

/// Collects the parts of a digest, each with its length. Cache keys are not used: their version may change while
/// outputs do not.
struct Digest(Vec<u8>);

impl Digest {
    fn new(kind: &str) -> Self {
        Self(Vec::new()).text(kind)
    }

    fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        self.0.extend_from_slice(bytes);
        self
    }

    fn text(self, text: &str) -> Self {
        self.bytes(text.as_bytes())
    }

    fn key(self, key: &Key) -> Self {
        self.bytes(key.as_bytes())
    }

    fn finish(self) -> Key {
        Key::of_content(&self.0)
    }
}

/// A fixed sequence of numbers (Knuth's MMIX generator), the upper bits.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }
}

/// Blocks of random colour, seen `shift` columns further left.
fn image(shift: u32) -> Value {
    let mut numbers = Numbers(1);
    let blocks: Vec<[u8; 3]> = (0..64 * 16).map(|_| [0; 3].map(|_: u8| numbers.below(256) as u8)).collect();
    let colour = |x: u32, y: u32| image::Rgb(blocks[(((x + shift) / 3) % 64 + (y / 4) % 16 * 64) as usize]);
    Image::new(Pixels::Rgb(RgbImage::from_fn(WIDTH, HEIGHT, colour))).into()
}

fn raster<T: image::Primitive>(mut pixel: impl FnMut() -> T) -> Raster<T> {
    let pixels = (0..WIDTH * HEIGHT).map(|_| pixel()).collect();
    Raster::from_raw(WIDTH, HEIGHT, pixels).unwrap()
}

/// Depths of 1 to 100 m; one in `gaps` is invalid, 0 for no gaps.
fn depth(seed: u64, gaps: u64) -> Value {
    let mut numbers = Numbers(seed);
    let pixel = || match gaps {
        0 => 1.0 + numbers.below(9900) as f32 / 100.0,
        _ if numbers.below(gaps) == 0 => f32::NAN,
        _ => 1.0 + numbers.below(9900) as f32 / 100.0,
    };
    Depth { metres: raster(pixel) }.into()
}

fn weight() -> Value {
    let mut numbers = Numbers(9);
    Weight { share: raster(|| numbers.below(1001) as f32 / 1000.0) }.into()
}

/// Disparities of 64 px from the smallest on; one in 65 is invalid.
fn disparity(seed: u64, min_disparity_px: i32) -> Value {
    let mut numbers = Numbers(seed);
    let sixteenths_px = raster(|| numbers.below(1024) as i16 - 16 + min_disparity_px as i16 * 16);
    Disparity { sixteenths_px, min_disparity_px }.into()
}

/// Disparities of which a third is invalid.
fn gappy() -> Value {
    let mut numbers = Numbers(12);
    let sixteenths_px = raster(|| (numbers.below(1024) as i16 - 340).max(-16));
    Disparity { sixteenths_px, min_disparity_px: 0 }.into()
}

/// True disparities at a third of the pixels.
fn true_disparity() -> Value {
    let mut numbers = Numbers(13);
    let px_256 = raster(|| if numbers.below(3) == 0 { numbers.below(16384) as u16 } else { 0 });
    TrueDisparity::from_px_256(&px_256).into()
}

/// Inverse depth of unknown scale and shift: also below 0.
fn relative_inverse_depth(seed: u64) -> Value {
    let mut numbers = Numbers(seed);
    RelativeInverseDepth { values: raster(|| numbers.below(4096) as f32 / 512.0 - 1.0) }.into()
}

/// Calls that stand for a kind, together with others of its name: the name, sets of parameters, inputs.
type Calls = (&'static str, Vec<Json>, Vec<(&'static str, Value)>);

#[expect(clippy::too_many_lines, reason = "one list of cases")]
fn calls(folder: &Path) -> Vec<Calls> {
    let maps = folder.join("maps.npy");
    let numbers: Vec<f32> = (0..24).map(|at| at as f32 * 0.7 - 1.0).collect();
    fs::write(&maps, predictions::npy("(1, 4, 6)", &numbers)).unwrap();
    let network = onnx_file::model(
        "Identity",
        None,
        &[Tensor("image", F32, &[1, 1, 10, 30])],
        &Tensor("share", F32, &[1, 1, 10, 30]),
    );
    // Of its two inputs it gives the first.
    let side = [1, 1, -1, -1];
    let inputs = [Tensor("first", F32, &side), Tensor("second", F32, &side)];
    let two = model(onnx_file::model("Identity", None, &inputs, &Tensor("map", F32, &side)));
    let pair = vec![("left", image(6)), ("right", image(0))];
    let fusion = vec![("mono", depth(2, 0)), ("stereo", depth(3, 5))];
    vec![
        ("confidence/edges", vec![json!({}), json!({ "threshold": 30.5 })], vec![("image", image(0))]),
        ("confidence/sobel", vec![json!({}), json!({ "threshold": 400, "sigma": 2.5 })], vec![("image", image(0))]),
        (
            "depth/files",
            vec![
                json!({ "files": maps, "resize": "nearest", "cap": 10 }),
                json!({ "files": maps, "resize": "bilinear", "quantity": "inverse-depth", "unit": "millimetres" }),
            ],
            vec![("image", image(0))],
        ),
        (
            "disparity/files",
            vec![
                json!({ "files": maps, "resize": "nearest" }),
                json!({ "files": maps, "resize": "bilinear", "unit": "share", "divide_by": 100 }),
            ],
            vec![("image", image(0))],
        ),
        (
            "depth/from-disparity",
            vec![json!({}), json!({ "cap": null })],
            vec![("disparity", disparity(10, 0)), ("calibration", calibration(721.5377, 0.532_725))],
        ),
        (
            "depth/guided-upsampling",
            vec![json!({}), json!({ "radius": 3, "epsilon": 0.1, "smooth": true })],
            vec![("image", image(0)), ("depth", depth(7, 2))],
        ),
        ("disparity/fill", vec![json!({}), json!({ "longest": 1 })], vec![("disparity", gappy())]),
        (
            "disparity/left-right",
            vec![json!({}), json!({ "max_difference": 12.25 })],
            vec![("left", disparity(10, 0)), ("right", disparity(11, -60))],
        ),
        (
            "disparity/speckle",
            vec![json!({ "window": 9, "range": 10.5 }), json!({ "window": 30, "range": 20 })],
            vec![("disparity", gappy())],
        ),
        (
            "disparity/weighted-least-squares",
            vec![json!({}), json!({ "lambda": 300, "sigma": 20, "iterations": 2, "fill": false })],
            vec![("image", image(0)), ("disparity", gappy())],
        ),
        (
            "disparity/weighted-least-squares",
            vec![json!({ "max_difference": 20, "discontinuity_radius": 1 })],
            vec![("image", image(0)), ("disparity", gappy()), ("right", disparity(11, -60))],
        ),
        ("filter/median", vec![json!({}), json!({ "size": 3 })], vec![("depth", depth(1, 4))]),
        (
            "fusion/confidence",
            ["full", "confidence", "mean", "fill"].map(|w| json!({ "weighting": w })).to_vec(),
            [fusion.clone(), vec![("weight", weight())]].concat(),
        ),
        (
            "fusion/facil",
            vec![json!({ "min_confidence": 0.5 }), json!({ "spacing": 7, "min_confidence": 0.2, "sigma_distance": 4 })],
            [fusion.clone(), vec![("weight", weight())]].concat(),
        ),
        (
            "fusion/inverse-variance",
            vec![json!({}), json!({ "disparity_deviation": 0.5, "mono_deviation": 0.3 })],
            [fusion.clone(), vec![("calibration", calibration(721.5377, 0.532_725))]].concat(),
        ),
        ("fusion/median", vec![json!({}), json!({ "of_two": "arithmetic" })], [fusion.clone(), vec![("third", depth(6, 4))]].concat()),
        (
            "fusion/learned",
            vec![json!({}), json!({ "cap": null })],
            vec![
                ("image", image(0)),
                ("disparity", disparity(10, 0)),
                ("consistent", gappy()),
                ("mono", depth(4, 6)),
                ("weight", weight()),
                ("calibration", calibration(72.0, 0.5)),
                ("model", model(network_of_planes(8, 0, (32, 16), "fusion"))),
            ],
        ),
        (
            "fusion/mixture",
            vec![
                json!({ "alignment": "none" }),
                json!({}),
                json!({ "local": { "sigma": 3, "iterations": 2 }, "prior": { "unique_ambiguity": 0.4, "unconfident": 0.5 } }),
            ],
            vec![
                ("disparity", disparity(10, 0)),
                ("mono", depth(4, 6)),
                ("calibration", calibration(72.0, 0.5)),
                ("right", disparity(11, -63)),
                ("unique", gappy()),
                ("ambiguity", weight()),
                ("confidence", weight()),
            ],
        ),
        (
            "fusion/mixture",
            vec![json!({ "local": { "sigma": 12 }, "cap": null })],
            vec![("disparity", gappy()), ("mono", depth(2, 0)), ("calibration", calibration(721.5377, 0.532_725))],
        ),
        (
            "fusion/mixture",
            vec![json!({})],
            vec![
                ("disparity", gappy()),
                ("mono", depth(2, 0)),
                ("calibration", calibration(721.5377, 0.532_725)),
                ("mono_deviation", depth(5, 3)),
            ],
        ),
        (
            "learn/reliability",
            vec![json!({}), json!({ "disparities": 128, "stereo_noise": 0.5, "cap": null })],
            vec![("disparity", disparity(10, 0)), ("mono", depth(4, 6)), ("calibration", calibration(72.0, 0.5))],
        ),
        (
            "fusion/scale",
            ["minmax", "average", "none", "least-squares", "robust", "median", "local"]
                .map(|method| json!({ "method": method, "sigma": 6 }))
                .to_vec(),
            fusion.clone(),
        ),
        (
            "fusion/scale",
            ["least-squares", "robust", "local"]
                .map(|method| json!({ "method": method, "domain": "depth", "cap": 40, "sigma": 20, "prior": 0.5 }))
                .to_vec(),
            [fusion.clone(), vec![("weight", weight())]].concat(),
        ),
        (
            "fusion/scale",
            ["least-squares", "robust", "median", "local"]
                .map(|method| json!({ "method": method, "mono": "relative-inverse-depth" }))
                .to_vec(),
            vec![("mono", relative_inverse_depth(6)), ("stereo", depth(3, 5))],
        ),
        (
            "mono/ground-plane",
            vec![json!({})],
            vec![("image", image(0)), ("calibration", calibration(721.5377, 0.532_725))],
        ),
        (
            "mono/onnx",
            vec![
                json!({}),
                json!({ "resize": "bilinear", "round": false, "mean": [0.5, 0, 0], "output": "inverse-depth" }),
                json!({ "output": "depth", "output_scale": 50 }),
                json!({ "output": "disparity-px" }),
            ],
            vec![("image", image(0)), ("calibration", calibration(72.0, 0.5)), ("model", model(network))],
        ),
        (
            "onnx",
            vec![json!({ "multiple": 16, "ports": {
                "inputs": { "first": { "type": "depth", "form": "inverse", "scale": 3, "missing": 0.5 }, "second": { "type": "weight" } },
                "outputs": {
                    "depth": { "type": "depth", "name": "map", "scale": 7 },
                    "sure": { "type": "weight", "name": "map", "offset": -0.2 },
                },
            } })],
            vec![("first", depth(4, 6)), ("second", weight()), ("model", two.clone())],
        ),
        (
            "onnx",
            vec![json!({ "fit": "resize", "size": [64, 32], "ports": {
                "inputs": { "first": { "type": "disparity" }, "second": { "type": "image", "white": 255 } },
                "outputs": {
                    "disparity": { "type": "disparity", "name": "map" },
                    "mask": { "type": "mask", "name": "map", "form": "inverse", "scale": 0.2 },
                },
            } })],
            vec![("first", gappy()), ("second", image(0)), ("model", two.clone())],
        ),
        (
            "score/depth",
            ["martins2018", "monodepth2", "kitti-depth"].map(|p| json!({ "preset": p, "sets": ["all", "valid"] })).to_vec(),
            vec![("estimate", depth(4, 6)), ("ground_truth", depth(5, 3))],
        ),
        (
            "score/disparity",
            vec![json!({ "sets": ["all", "valid", "filled"], "zones": { "rows": 2, "distance_m": [0, 10, 80] } })],
            vec![
                ("estimate", gappy()),
                ("ground_truth", true_disparity()),
                ("calibration", calibration(72.0, 0.5)),
                ("image", image(0)),
            ],
        ),
        (
            "stereo/bm",
            vec![
                json!({ "disparities": 16, "block": 7, "disp12_max_diff": 1, "speckle_window": 20, "speckle_range": 16 }),
                json!({ "disparities": 16, "block": 5, "prefilter": "normalized-response", "prefilter_size": 7, "min_disparity": 2 }),
            ],
            pair.clone(),
        ),
        (
            "stereo/census-sgm",
            vec![
                json!({ "disparities": 16 }),
                json!({ "disparities": 16, "paths": 4, "census": "full", "min_disparity": -3 }),
                json!({ "disparities": 32, "census": "off-axis", "subpixel": false, "lr_max_diff": -1, "uniqueness": 0 }),
            ],
            pair.clone(),
        ),
        (
            "stereo/onnx",
            vec![
                json!({ "white": 90, "right_view": true, "mean": [20, 0, 0] }),
                json!({ "fit": "resize", "size": [64, 32], "output": "disparity-share", "output_scale": 0.4 }),
                json!({ "multiple": 7, "pad_at": "centre", "pad_with": "zero", "output": "inverse-depth" }),
            ],
            vec![("left", image(6)), ("right", image(0)), ("calibration", calibration(72.0, 0.5)), ("model", two)],
        ),
        (
            "stereo/sgbm",
            ["sgbm", "hh", "3way", "hh4"]
                .map(|mode| json!({ "mode": mode, "disparities": 16, "uniqueness": 5, "speckle_window": 20, "speckle_range": 2 }))
                .to_vec(),
            pair,
        ),
    ]
}

fn add_values(digest: Digest, values: &Values) -> Digest {
    values.iter().fold(digest, |digest, (port, value)| add(digest.text(port), value))
}

fn add(digest: Digest, value: &Value) -> Digest {
    let floats = |map: &Raster<f32>| {
        let bits = |value: &f32| if value.is_nan() { f32::NAN.to_bits() } else { value.to_bits() };
        map.iter().flat_map(|value| bits(value).to_le_bytes()).collect::<Vec<u8>>()
    };
    match value {
        Value::Image(image) => match image.pixels() {
            Pixels::Grey(grey) => digest.bytes(grey),
            Pixels::Rgb(rgb) => digest.bytes(rgb),
        },
        Value::Disparity(map) => {
            digest.bytes(&map.sixteenths_px.iter().flat_map(|fixed| fixed.to_le_bytes()).collect::<Vec<u8>>())
        }
        Value::FloatDisparity(map) => digest.bytes(&floats(map.px())),
        Value::TrueDisparity(map) => {
            // As before there were truths that these do not hold.
            match map.px_256() {
                Some(px_256) => digest.bytes(&px_256.iter().flat_map(|fixed| fixed.to_le_bytes()).collect::<Vec<u8>>()),
                None => digest.bytes(&floats(&map.px)),
            }
        }
        Value::Depth(depth) => digest.bytes(&floats(&depth.metres)),
        Value::RelativeDepth(map) => digest.bytes(&floats(&map.depth().metres)).bytes(&floats(map.inverse())),
        Value::RelativeInverseDepth(map) => digest.bytes(&floats(&map.values)),
        Value::Weight(weight) => digest.bytes(&floats(&weight.share)),
        Value::Mask(mask) => digest.bytes(&mask.set),
        Value::Calibration(c) =>
        // As before there were pairs of two principal points.
        {
            digest.text(&format!("{c:?}").replace(", doffs_px: 0.0", ""))
        }
        Value::Scores(rows) => digest.text(&format!("{rows:?}")),
        Value::Samples(artifact) | Value::Model(artifact) | Value::Reliability(artifact) => digest.key(&artifact.hash),
        Value::Curve(curve) => digest.text(&format!("{curve:?}")),
        Value::Number(number) => digest.text(&format!("{number:?}")),
    }
}

/// The digest of every kind's outputs, by `kind@version`.
fn digests() -> BTreeMap<String, Key> {
    let registry = depthloom_nodes::registry();
    let mut digests = BTreeMap::new();
    let folder = tempfile::tempdir().unwrap();
    let calls = calls(folder.path());
    for node in registry.nodes() {
        let kind = node.declaration.kind;
        if (kind.ends_with("onnx") || kind == "fusion/learned")
            && let Err(fault) = depthloom_nodes::onnx::find()
        {
            depthloom_test_needs::skipped(&format!("the digest of {kind}"), &fault.chain());
            continue;
        }
        if kind == "process" || kind == "dora" {
            // What it gives is up to the program.
            continue;
        }
        assert!(calls.iter().any(|call| call.0 == kind), "add a call of {kind}");
        let digest =
            calls.iter().filter(|call| call.0 == kind).fold(Digest::new(kind), |digest, (_, variants, inputs)| {
                variants.iter().fold(digest, |digest, params| {
                    let values = call(kind, params, inputs).unwrap_or_else(|fault| panic!("{kind}: {}", fault.chain()));
                    add_values(digest, &values)
                })
            });
        digests.insert(format!("{kind}@{}", node.declaration.version), digest.finish());
    }
    for source in registry.sources() {
        let kind = source.declaration.kind;
        if kind == "process/source" {
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        let params = match kind {
            "synthetic/road" => json!({ "frames": [2], "width": 96, "height": 32 }),
            "kitti/stereo2015" => small_kitti(folder.path()),
            "images" => images::small(folder.path()),
            "kitti/raw" => kitti_raw::small(folder.path()),
            "ros2/bag" => ros2_bag::small(folder.path()),
            _ if kind.starts_with("kitti/") => kitti_family::small(kind, folder.path()),
            _ => stereo_sets::small(kind, folder.path()),
        };
        let (values, _) = open(kind, &params).unwrap().read(FrameIndex(0)).unwrap();
        let digest = add_values(Digest::new(kind), &values).finish();
        digests.insert(format!("{kind}@{}", source.declaration.version), digest);
    }
    digests
}

/// One frame in KITTI's layout. Only its decoded values are digested: another release of the PNG encoder writes other
/// bytes.
fn small_kitti(root: &Path) -> Json {
    let save = |folder: &str, image: &Value| {
        let Value::Image(image) = image else { panic!("image") };
        let Pixels::Rgb(rgb) = image.pixels() else { panic!("colour") };
        fs::create_dir_all(root.join("training").join(folder)).unwrap();
        rgb.save(root.join("training").join(folder).join("000001_10.png")).unwrap();
    };
    save("image_2", &image(6));
    save("image_3", &image(0));
    let truth = ImageBuffer::<Luma<u16>, _>::from_fn(WIDTH, HEIGHT, |x, y| Luma([(x * y * 7) as u16]));
    fs::create_dir_all(root.join("training/disp_noc_0")).unwrap();
    truth.save(root.join("training/disp_noc_0/000001_10.png")).unwrap();
    fs::create_dir_all(root.join("training/calib_cam_to_cam")).unwrap();
    let calibration = "P_rect_02: 500 0 45 0 0 500 20 0 0 0 1 0\nP_rect_03: 500 0 45 -250 0 500 20 0 0 0 1 0\n";
    fs::write(root.join("training/calib_cam_to_cam/000001.txt"), calibration).unwrap();
    json!({ "root": root })
}

#[test]
fn outputs_change_only_with_the_version() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nodes/digests.txt");
    let text = fs::read_to_string(&file).unwrap_or_default();
    let mut known: BTreeMap<String, String> = text
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(kind, digest)| (kind.to_owned(), digest.to_owned()))
        .collect();
    let mut missing = Vec::new();
    for (kind, digest) in digests() {
        match known.get(&kind) {
            Some(then) => {
                assert_eq!(*then, digest.to_string(), "{kind} gives other outputs than before: raise its version");
            }
            None => {
                missing.push(kind.clone());
                known.insert(kind, digest.to_string());
            }
        }
    }
    if missing.is_empty() {
        return;
    }
    assert!(
        std::env::var_os("DEPTHLOOM_ACCEPT_DIGESTS").is_some(),
        "digests.txt has no line for {missing:?}: run this test with DEPTHLOOM_ACCEPT_DIGESTS=1"
    );
    let lines = known.iter().fold(String::new(), |mut lines, (kind, digest)| {
        writeln!(lines, "{kind} {digest}").unwrap();
        lines
    });
    fs::write(file, lines).unwrap();
}
