//! `eth3d/two-view`: ETH3D's low-resolution pairs, as unpacked.

use std::path::Path;

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::{Context, Fault, Outputs};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::dataset::folders::{existing_folder, missing_folder};
use crate::sources::dataset::frame_files::Files;
use crate::sources::dataset::{
    DatasetKind, Listing, calibration_port, depth_port, image_port, recognised, required, truth_off,
};
use crate::sources::evaluation::Evaluation;
use crate::sources::middlebury::scene::{self, TruePixels};
use crate::sources::middlebury::scenes;

const KIND: &str = "eth3d/two-view";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds two_view_training and two_view_training_gt, as the archives are named; or a folder a scene, each with im0.png, im1.png and \
calib.txt, and in training disp0GT.pfm and mask0nocc.png, unless `ground_truth: none`";

/// Parameters of `eth3d/two-view`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Eth3dTwoView {
    /// Folder that contains `two_view_training` and `two_view_training_gt`, or one folder per scene.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Scenes to read, in this order. By default all, sorted by name.
    pub scenes: Vec<String>,
    /// Pixels of `depth`: `all` (all with ground truth), `noc` (seen by both cameras) or `none` (ground truth is not
    /// read).
    pub ground_truth: TruePixels,
    /// Selected frames, by the position of the scene among the selected scenes, from 0. All by default.
    pub frames: FrameSelection,
}

impl DatasetKind for Eth3dTwoView {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let ports = [
            image_port("left", "Left image, 8 bit, with the bytes of its file."),
            image_port("right", "Right image, 8 bit, with the bytes of its file."),
            calibration_port(),
            depth_port("Ground-truth depth, metres, NaN = unknown; absent without ground truth.").optional(),
        ];
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "ETH3D two-view: rectified grey pairs of a small rig, indoors and outdoors, with laser ground truth.",
            doc: "\
Published by Schöps et al., *A Multi-View Stereo Benchmark with High-Resolution Images and Multi-Camera Videos*, \
2017; see eth3d.net/documentation. `two_view_training/<scene>` has `im0.png` (left), `im1.png` and `calib.txt`. \
`two_view_training_gt/<scene>` has `disp0GT.pfm` (px, infinite = unknown) and `mask0nocc.png` (255 where both \
cameras see a pixel). All files of a scene may also be in one folder. The baseline in `calib.txt` is in millimetres.\n\n\
The id of a frame is the name of its scene (`delivery_area_1l`), its index the position of the scene. Depth is `f * \
B / (d + doffs)`. Pixel centres have integer coordinates.",
            outputs: ports.into_iter().chain(Evaluation::always()).collect(),
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == TruePixels::None, "all", &["depth", "disp_noc", "disp_occ", "occluded"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let is_one = root.join("two_view_training").is_dir()
            || scenes(root, &[], |folder| folder.join("disp0GT.pfm").is_file()).is_ok_and(|of| !of.is_empty());
        if !is_one {
            return Vec::new();
        }
        let params = Self { root: DataPath(root.to_owned()), ..Self::default() };
        recognised::<Self>(&params, "ETH3D two-view", root)
    }

    fn meaning(&self) -> String {
        format!("{:?}", self.ground_truth)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        scene::values(files, self.ground_truth, ctx)
    }
}

fn list(params: &Eth3dTwoView) -> Result<Listing, Fault> {
    let root = params.root.path();
    existing_folder(root, LAYOUT)?;
    let separate = root.join("two_view_training");
    let (images, truths) =
        if separate.is_dir() { (separate, Some(root.join("two_view_training_gt"))) } else { (root.to_owned(), None) };
    if let Some(truths) = truths.as_ref().filter(|truths| params.ground_truth != TruePixels::None && !truths.is_dir()) {
        return Err(missing_folder(
            truths,
            "unpack two_view_training_gt.7z there; without ground truth, set `ground_truth: none`",
        ));
    }
    let is_scene = |folder: &Path| ["im0.png", "im1.png", "calib.txt"].iter().any(|file| folder.join(file).is_file());
    let scenes = scenes(&images, &params.scenes, is_scene)?;
    if scenes.is_empty() {
        return Err(Fault::new(format!("no scene found in {}", images.display())).remedy(LAYOUT));
    }
    let known: Vec<(u64, &str)> = (0..).zip(&scenes).map(|(index, (name, _))| (index, name.as_str())).collect();
    let mut listing = Listing::default();
    listing.add_selected(&params.frames, &known, |at| {
        let (name, folder) = &scenes[at];
        let truths = truths.as_ref().map_or_else(|| folder.clone(), |truths| truths.join(name));
        scene::files(folder, &truths, params.ground_truth)
    })?;
    Ok(listing)
}
