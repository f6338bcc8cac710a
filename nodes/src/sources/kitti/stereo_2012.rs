//! `kitti/stereo2012`: the KITTI stereo 2012 benchmark, as unpacked.

use std::path::Path;

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::{Context, Fault, Outputs};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::dataset::folders::{existing_file, existing_folder};
use crate::sources::dataset::frame_files::{CALIBRATION, Files, LEFT, Part, RIGHT};
use crate::sources::dataset::{DatasetKind, FrameFiles, Listing, required};
use crate::sources::kitti::calibration::from_projections;
use crate::sources::kitti::cameras::KittiCameras;
use crate::sources::kitti::stems::Stems;
use crate::sources::kitti::stereo::{GroundTruth, KittiTruth, Split, halves, ports, switched_off};

const KIND: &str = "kitti/stereo2012";
const VERSION: u32 = 2;
const LAYOUT: &str = "root contains `training` (with ground truth) or `testing` (without), each with colored_0 (left) and colored_1 (right), or image_0 and image_1 of the grey \
    cameras, of 000000_10.png ..., and calib; in training also disp_noc or disp_occ, unless `ground_truth: none` (KITTI stereo 2012, data_stereo_flow.zip)";

const NOC: Part = "disp_noc";
const OCC: Part = "disp_occ";

/// Parameters of `kitti/stereo2012`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiStereo2012Params {
    /// Folder that contains `training` and `testing`.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Part of the benchmark: `training` or `testing`.
    pub split: Split,
    /// Camera pair: `color` (`colored_0`, `colored_1`) or `grey` (`image_0`, `image_1`).
    pub cameras: KittiCameras,
    /// Pixels of `depth`: `noc` (seen by both cameras), `occ` (all with ground truth) or `none`. Testing frames have
    /// no ground truth.
    pub ground_truth: KittiTruth,
    /// Whether training frames also have ground-truth disparities (`disp_noc`, `disp_occ`, `occluded`), as far as
    /// their folders exist. `score/disparity` uses them.
    pub disparities: bool,
    /// Selected frames, by KITTI's number. All by default.
    pub frames: FrameSelection,
}

pub(crate) struct KittiStereo2012 {
    cameras: KittiCameras,
    truth: GroundTruth,
}

const fn image_folders(cameras: KittiCameras) -> [&'static str; 2] {
    match cameras {
        KittiCameras::Color => ["colored_0", "colored_1"],
        KittiCameras::Grey => ["image_0", "image_1"],
    }
}

impl DatasetKind for KittiStereo2012 {
    type Params = KittiStereo2012Params;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI stereo 2012: rectified pairs, colour or grey, with sparse laser ground truth.",
            doc: "\
Layout (Geiger, Lenz, Urtasun, *Are we ready for Autonomous Driving?*, 2012): `<root>/training` and `<root>/testing` \
with `colored_0` (left) and `colored_1` (right), or `image_0` and `image_1` for the grey cameras, files \
`%06d_10.png`. `training` also contains `disp_noc` and `disp_occ`. `calib/%06d.txt` contains `P0` to `P3`. The \
second time step, `_11`, is not read.\n\n\
The id of a frame is the stem of its file (`000150_10`), its index the number (150). Ground-truth depth is `f * B / \
(v / 256)` for the 16-bit disparity `v`, NaN where `v` is 0. With `disparities: true` the disparities are outputs, \
too. The ground truth belongs to the left grey camera; KITTI uses it for the left colour camera, too.",
            outputs: ports(
                "Left image, 8 bit, with the bytes of its file.",
                "Right image, 8 bit, with the bytes of its file.",
            ),
        }
    }

    fn check(params: &KittiStereo2012Params) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)
    }

    fn switched_off(params: &KittiStereo2012Params) -> Vec<SwitchedOff> {
        let of_disparities = ["disp_noc", "disp_occ", "occluded"];
        switched_off(params.split, params.ground_truth, params.disparities, &of_disparities)
    }

    fn list(params: &KittiStereo2012Params) -> Result<(Listing, Self), Fault> {
        let parts = [NOC, OCC];
        let depth = params.ground_truth.part(params.split, parts);
        let disparities = params.disparities && params.split == Split::Training;
        let kind = Self { cameras: params.cameras, truth: GroundTruth { parts, depth, disparities } };
        existing_folder(params.root.path(), LAYOUT)?;
        let folder = params.root.path().join(params.split.folder());
        existing_folder(&folder, LAYOUT)?;
        let [left, right] = image_folders(params.cameras);
        let lefts = Stems::list(&folder, left, LAYOUT)?;
        let known = lefts.known(&folder, LAYOUT)?;
        // The selected ground truth must exist; of disparities for `score/disparity` those that exist are given.
        let is_given = |part: &Part| depth == Some(*part) || (disparities && folder.join(part).is_dir());
        let maps: Vec<Part> = parts.into_iter().filter(is_given).collect();
        let mut listing = Listing::default();
        listing.add_selected(&params.frames, &known, |at| files(&folder, [left, right], &maps, known[at]))?;
        Ok((listing, kind))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        halves(root, "KITTI stereo 2012", [NOC, OCC], |half| {
            let is_there = |cameras: &KittiCameras| image_folders(*cameras).iter().all(|side| half.join(side).is_dir());
            let found = [KittiCameras::Color, KittiCameras::Grey].into_iter().find(is_there)?;
            Some(json!({ "cameras": found.name() }))
        })
    }

    fn meaning(&self) -> String {
        format!("{:?} {:?} {}", self.cameras, self.truth.depth, self.truth.disparities)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let pair = files.pair(ctx)?;
        let calibration = from_projections(files.required(CALIBRATION)?, self.cameras, pair.0.dimensions())?;
        self.truth.outputs(files, pair, calibration, None)
    }
}

fn files(folder: &Path, [left, right]: [&str; 2], maps: &[Part], (number, stem): (u64, &str)) -> FrameFiles {
    let image = |part: &str| {
        let remedy = "each left image needs a right image, and ground truth unless `ground_truth: none`";
        existing_file(folder.join(part).join(format!("{stem}.png")), remedy)
    };
    let mut files = FrameFiles::default();
    files.add(LEFT, image(left));
    files.add(RIGHT, image(right));
    let remedy = "each frame needs its calibration, 000150.txt for 000150_10.png (KITTI: data_stereo_flow_calib.zip)";
    files.add(CALIBRATION, existing_file(folder.join("calib").join(format!("{number:06}.txt")), remedy));
    for map in maps {
        files.add(map, image(map));
    }
    files
}
