//! `scene-flow`: FlyingThings3D, Monkaa and Driving, as unpacked.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, Frame, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::values::{Calibration, TrueDisparity};
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::calibration::possible;
use crate::sources::dataset::{
    Entry, Files, LEFT, Layout, Listing, RIGHT, TRUTH, folders, no_file, no_folder, recognised, stems, survey,
};
use crate::sources::evaluation::Evaluation;
use crate::sources::middlebury::scene::{TruePixels, with_ending, with_truth};

const KIND: &str = "scene-flow";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds frames_finalpass or frames_cleanpass (or with _webp behind) and disparity, as the archives of FlyingThings3D, Monkaa or Driving unpack, \
with the same folders in both, at last left and right";

/// Below frames_finalpass: TRAIN/A/0000/left, 15mm_focallength/scene_forwards/fast/left, or SCENE/left.
const DEEPEST: usize = 5;
/// 35 mm, or 15 mm in half of Driving, at 960 columns.
const FOCAL_PX: f64 = 1050.0;
const WIDE_FOCAL_PX: f64 = 450.0;
const WIDTH: u32 = 960;
const WIDE: &str = "15mm_focallength";
/// Blender's unit, taken as a metre.
const BASELINE_M: f64 = 1.0;

const ENDINGS: [&str; 2] = ["png", "webp"];

/// Which rendering.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SceneFlowPass {
    /// With blur and depth of field: `frames_finalpass`.
    #[default]
    Final,
    /// Without: `frames_cleanpass`.
    Clean,
}

/// Whether there is truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SceneFlowTruth {
    /// All pixels: the data sets tell no occlusions.
    #[default]
    All,
    /// None: truth is not read, even where there is some.
    None,
}

/// Parameters of `scene-flow`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SceneFlowParams {
    /// The folder that holds `frames_finalpass` and `disparity`, of one of the three sets.
    pub root: DataPath,
    /// Which rendering: `final` or `clean`.
    pub pass: SceneFlowPass,
    /// Which folders below it: `TRAIN/A` of FlyingThings3D, `35mm_focallength/scene_forwards/slow` of Driving, `funnyworld_x2` of Monkaa. By default all there are.
    pub folders: Vec<String>,
    /// What is true: `all` or `none` (truth is not read).
    pub truth: SceneFlowTruth,
    /// Which frames, by their count over all folders, from 0. By default all.
    pub frames: FrameSelection,
}

pub(crate) struct SceneFlow;

impl SourceKind for SceneFlow {
    type Params = SceneFlowParams;

    fn declaration() -> SourceDeclaration {
        let [_, occ, _] = Evaluation::always();
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "Scene Flow: FlyingThings3D, Monkaa and Driving, rendered pairs with dense truth.",
            doc: "\
Layout (Mayer et al., *A Large Dataset to Train Convolutional Networks for Disparity, Optical Flow, and Scene Flow Estimation*, 2016; \
lmb.informatik.uni-freiburg.de): `<root>/frames_finalpass/<folders>/left/%04d.png` (or WebP, also in `frames_finalpass_webp`), `right`, and \
`<root>/disparity/<folders>/left/%04d.pfm` (px). `<folders>` are `TRAIN/A/0000` of FlyingThings3D, a scene of Monkaa, \
`15mm_focallength/scene_forwards/fast` of Driving.\n\n\
The camera is the data sets' own: 960x540, focal length 1050 px, 450 px below `15mm_focallength`, principal point (479.5, 269.5), the image's middle; the baseline is 1 unit \
of Blender, which counts as 1 m. Depth is `f * B / d`. A frame's id is its folders and number (`TRAIN_A_0000_0006`), its index the count over all folders, its time 10 Hz. \
Pixel centres have whole coordinates.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left image, RGB, a PNG with its file's bytes."),
                Port::frame("right", ValueType::Image, "Right image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline."),
                Port::frame(
                    "depth",
                    ValueType::Depth,
                    "True depth, units of Blender, NaN = unknown; absent without truth.",
                )
                .optional(),
                occ,
            ],
        }
    }

    fn check(params: &SceneFlowParams) -> Result<(), (&'static str, String)> {
        match params.root.path().as_os_str().is_empty() {
            true => Err(("root", format!("root is missing: {LAYOUT}"))),
            false => Ok(()),
        }
    }

    fn open(params: SceneFlowParams) -> Result<Box<dyn Source>, Fault> {
        list(&params)?.open(Self)
    }

    fn survey(params: SceneFlowParams) -> Survey {
        survey(list(&params).map(|listing| (listing, Self)))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let params = SceneFlowParams { root: DataPath(root.to_owned()), ..SceneFlowParams::default() };
        recognised(list(&params), "Scene Flow", json!({ "root": root }))
    }
}

fn sequences(from: &Path, way: &str, depth: usize, found: &mut Vec<String>) -> Result<(), Fault> {
    let names = folders(from, LAYOUT)?;
    if names.iter().any(|name| name == "left") {
        found.push(way.to_owned());
        return Ok(());
    }
    for name in names.iter().filter(|_| depth < DEEPEST) {
        let way = if way.is_empty() { name.clone() } else { format!("{way}/{name}") };
        sequences(&from.join(name), &way, depth + 1, found)?;
    }
    Ok(())
}

fn list(params: &SceneFlowParams) -> Result<Listing, Fault> {
    let root = params.root.path();
    if !root.is_dir() {
        return Err(no_folder(root, LAYOUT));
    }
    let pass = match params.pass {
        SceneFlowPass::Final => "frames_finalpass",
        SceneFlowPass::Clean => "frames_cleanpass",
    };
    let images = [root.join(pass), root.join(format!("{pass}_webp"))].into_iter().find(|folder| folder.is_dir());
    let images = images.ok_or_else(|| no_folder(&root.join(pass), LAYOUT))?;
    let mut found = Vec::new();
    if params.folders.is_empty() {
        sequences(&images, "", 0, &mut found)?;
    }
    for folder in &params.folders {
        let folder = folder.trim_matches('/');
        sequences(&images.join(folder), folder, 0, &mut found)?;
    }
    let mut frames: Vec<(&str, String, PathBuf)> = Vec::new();
    for way in &found {
        for (stem, path) in stems(&images.join(way).join("left"), &ENDINGS, LAYOUT)? {
            frames.push((way, stem, path));
        }
    }
    if frames.is_empty() {
        return Err(Fault::new(format!("{} holds no frame", images.display())).remedy(LAYOUT));
    }
    let id = |(way, stem, _): &(&str, String, PathBuf)| format!("{}_{stem}", way.replace('/', "_"));
    let ids: Vec<String> = frames.iter().map(id).collect();
    let known: Vec<(u64, &str)> = (0..).zip(&ids).map(|(index, id)| (index, id.as_str())).collect();
    let mut listing = Listing::default();
    for at in params.frames.select(&known)? {
        let ((index, id), (way, stem, left)) = (known[at], &frames[at]);
        let files = || {
            let right = images.join(way).join("right");
            let missing = || {
                no_file(
                    &right.join(format!("{stem}.png")),
                    "each left image needs its right one: unpack the archive again",
                )
            };
            let right = with_ending(&right, stem, &ENDINGS).ok_or_else(missing)?;
            let mut files = vec![(LEFT, left.clone()), (RIGHT, right)];
            if params.truth == SceneFlowTruth::All {
                let truth = root.join("disparity").join(way).join("left").join(format!("{stem}.pfm"));
                if !truth.is_file() {
                    return Err(no_file(
                        &truth,
                        "each frame needs its disparities, of the archive `disparity`; without truth, say `truth: none`",
                    ));
                }
                files.push((TRUTH, truth));
            }
            Ok(files)
        };
        listing.push(files().map(|files| Entry { frame: Frame::at_10_hz(id, index), files }));
    }
    listing.warnings.extend(params.frames.left_out(&known));
    Ok(listing)
}

impl Layout for SceneFlow {
    const KIND: (&'static str, u32) = (KIND, VERSION);

    /// The lens follows from a folder's name, not from a file.
    fn key(&self, files: &Files) -> Key {
        files.key(Self::KIND, &format!("{} px", focal_px(files)))
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        // Of images that somebody made smaller or larger, so is the focal length.
        let focal_px = focal_px(files) * f64::from(size.0) / f64::from(WIDTH);
        let (cx_px, cy_px) = possible::middle(size);
        let (width, height) = size;
        let calibration = Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: BASELINE_M, doffs_px: 0.0 };
        let occ = files.map_f32(TRUTH, size)?.map(|px| TrueDisparity { px });
        let outputs = Outputs::one("left", left).with("right", right);
        Ok(with_truth(outputs, TruePixels::All, Evaluation { occ, ..Evaluation::default() }, Some(calibration)))
    }
}

/// px at 960 columns.
fn focal_px(files: &Files) -> f64 {
    let is_wide = files.get(LEFT).is_some_and(|left| left.path.components().any(|part| part.as_os_str() == WIDE));
    if is_wide { WIDE_FOCAL_PX } else { FOCAL_PX }
}
