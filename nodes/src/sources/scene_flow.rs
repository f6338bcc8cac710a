//! `scene-flow`: FlyingThings3D, Monkaa and Driving, as unpacked.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::{Calibration, TrueDisparity};
use depthloom_graphs::{Context, Fault, Key, Outputs};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::calibration::rectified_pair::middle;
use crate::sources::dataset::folders::{
    existing_file, existing_folder, existing_with_ending, folders, missing_folder, stems,
};
use crate::sources::dataset::frame_files::{Files, LEFT, RIGHT, TRUTH};
use crate::sources::dataset::{
    DatasetKind, Listing, calibration_port, depth_port, image_port, recognised, required, truth_off,
};
use crate::sources::evaluation::Evaluation;
use crate::sources::middlebury::scene::{TruePixels, with_truth};

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
/// Blender's unit, used as a metre.
const BASELINE_M: f64 = 1.0;

const ENDINGS: [&str; 2] = ["png", "webp"];

/// Rendering pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SceneFlowPass {
    /// With blur and depth of field: `frames_finalpass`.
    #[default]
    Final,
    /// Without blur and depth of field: `frames_cleanpass`.
    Clean,
}

/// Ground truth to read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SceneFlowTruth {
    /// All pixels. The data sets contain no occlusion masks.
    #[default]
    All,
    /// Ground truth is not read, even if it exists.
    None,
}

/// Parameters of `scene-flow`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SceneFlow {
    /// Folder of one of the three data sets, which contains `frames_finalpass` and `disparity`.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Rendering pass: `final` or `clean`.
    pub pass: SceneFlowPass,
    /// Folders to read below the pass: `TRAIN/A` of FlyingThings3D, `35mm_focallength/scene_forwards/slow` of
    /// Driving, `funnyworld_x2` of Monkaa. All by default.
    pub folders: Vec<String>,
    /// Pixels with ground truth: `all` or `none` (not read).
    pub ground_truth: SceneFlowTruth,
    /// Selected frames, by their count over all folders, from 0. All by default.
    pub frames: FrameSelection,
}

impl DatasetKind for SceneFlow {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let [_, occ, _] = Evaluation::always();
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "Scene Flow: FlyingThings3D, Monkaa and Driving, rendered pairs with dense ground truth.",
            doc: "\
Published by Mayer et al., *A Large Dataset to Train Convolutional Networks for Disparity, Optical Flow, and Scene \
Flow Estimation*, 2016; see lmb.informatik.uni-freiburg.de. The files are `<root>/frames_finalpass/<folders>/left/%04d.png` (or WebP, also \
in `frames_finalpass_webp`), `right`, and `<root>/disparity/<folders>/left/%04d.pfm` (px). `<folders>` is \
`TRAIN/A/0000` for FlyingThings3D, the name of a scene for Monkaa, and `15mm_focallength/scene_forwards/fast` for \
Driving.\n\n\
All data sets have the same camera: 960x540 px, principal point (479.5, 269.5), the centre of the image. The focal \
length is 1050 px, and 450 px below `15mm_focallength`. The baseline is 1 unit of Blender, which counts as 1 m. \
Depth is `f * B / d`.\n\n\
The id of a frame is its folders and number (`TRAIN_A_0000_0006`). Its index counts over all folders. Its time is at \
10 Hz. Pixel centres have integer coordinates.",
            outputs: vec![
                image_port("left", "Left image, RGB; a PNG keeps the bytes of its file."),
                image_port("right", "Right image, RGB; a PNG keeps the bytes of its file."),
                calibration_port(),
                depth_port("Ground-truth depth, units of Blender (counted as metres), NaN = unknown; absent without ground truth.").optional(),
                occ,
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == SceneFlowTruth::None, "all", &["depth", "disp_occ"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let params = Self { root: DataPath(root.to_owned()), ..Self::default() };
        recognised::<Self>(&params, "Scene Flow", root)
    }

    /// The lens follows from a folder's name, not from a file.
    fn key(&self, files: &Files) -> Key {
        files.key(Self::KIND, &format!("{} px", focal_px(files)))
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let (width, height) = left.dimensions();
        // The focal length scales with images that were resized.
        let focal_px = focal_px(files) * f64::from(width) / f64::from(WIDTH);
        let (cx_px, cy_px) = middle((width, height));
        let calibration = Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: BASELINE_M, doffs_px: 0.0 };
        let occ = files.map_f32(TRUTH, (width, height))?.map(|px| TrueDisparity { px });
        let outputs = Outputs::one("left", left).with("right", right);
        Ok(with_truth(outputs, TruePixels::All, Evaluation { occ, ..Evaluation::default() }, Some(calibration)))
    }
}

/// Paths of the folders that contain `left`, relative to the first `from`.
fn sequences(from: &Path, path: &str, depth: usize, found: &mut Vec<String>) -> Result<(), Fault> {
    let names = folders(from, LAYOUT)?;
    if names.iter().any(|name| name == "left") {
        found.push(path.to_owned());
        return Ok(());
    }
    for name in names.iter().filter(|_| depth < DEEPEST) {
        let path = if path.is_empty() { name.clone() } else { format!("{path}/{name}") };
        sequences(&from.join(name), &path, depth + 1, found)?;
    }
    Ok(())
}

fn list(params: &SceneFlow) -> Result<Listing, Fault> {
    let root = params.root.path();
    existing_folder(root, LAYOUT)?;
    let pass = match params.pass {
        SceneFlowPass::Final => "frames_finalpass",
        SceneFlowPass::Clean => "frames_cleanpass",
    };
    let images = [root.join(pass), root.join(format!("{pass}_webp"))].into_iter().find(|folder| folder.is_dir());
    let images = images.ok_or_else(|| missing_folder(&root.join(pass), LAYOUT))?;
    let mut found = Vec::new();
    if params.folders.is_empty() {
        sequences(&images, "", 0, &mut found)?;
    }
    for folder in &params.folders {
        let folder = folder.trim_matches('/');
        sequences(&images.join(folder), folder, 0, &mut found)?;
    }
    let mut frames: Vec<(&str, String, PathBuf)> = Vec::new();
    for path in &found {
        let lefts = stems(&images.join(path).join("left"), &ENDINGS, LAYOUT)?;
        frames.extend(lefts.into_iter().map(|(stem, left)| (path.as_str(), stem, left)));
    }
    if frames.is_empty() {
        return Err(Fault::new(format!("no frame found in {}", images.display())).remedy(LAYOUT));
    }
    let ids: Vec<String> = frames.iter().map(|(path, stem, _)| format!("{}_{stem}", path.replace('/', "_"))).collect();
    let known: Vec<(u64, &str)> = (0..).zip(&ids).map(|(index, id)| (index, id.as_str())).collect();
    let mut listing = Listing::default();
    listing.add_selected(&params.frames, &known, |at| {
        let (path, stem, left) = &frames[at];
        let remedy = "each left image needs a right image: unpack the archive again";
        let right = existing_with_ending(&images.join(path).join("right"), stem, &ENDINGS, remedy)?;
        let mut files = vec![(LEFT, left.clone()), (RIGHT, right)];
        if params.ground_truth == SceneFlowTruth::All {
            let truth = root.join("disparity").join(path).join("left").join(format!("{stem}.pfm"));
            let remedy =
                "each frame needs its disparities, of the archive `disparity`; without ground truth, set `ground_truth: none`";
            files.push((TRUTH, existing_file(truth, remedy)?));
        }
        Ok(files)
    })?;
    Ok(listing)
}

/// px at 960 columns.
fn focal_px(files: &Files) -> f64 {
    let is_wide = files.get(LEFT).is_some_and(|left| left.path.components().any(|part| part.as_os_str() == WIDE));
    if is_wide { WIDE_FOCAL_PX } else { FOCAL_PX }
}
