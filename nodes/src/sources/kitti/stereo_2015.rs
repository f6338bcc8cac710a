//! `kitti/stereo2015`: the KITTI stereo 2015 benchmark, as unpacked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::{Mask, Pixels};
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::dataset::folders::{at_file, existing_file, existing_folder, missing_file};
use crate::sources::dataset::frame_files::{CALIBRATION, Files, LEFT, Part, RIGHT};
use crate::sources::dataset::{DatasetKind, FrameFiles, Listing, required};
use crate::sources::files::image_file;
use crate::sources::kitti::calibration;
use crate::sources::kitti::stems::{Stems, unread_files};
use crate::sources::kitti::stereo::{GroundTruth, KittiTruth, Split, halves, ports, switched_off};

const KIND: &str = "kitti/stereo2015";
const VERSION: u32 = 2;
const LAYOUT: &str = "root contains `training` (with ground truth) or `testing` (without), each with image_2 (left) and image_3 (right) of 000000_10.png ...; \
    in training also disp_noc_0 or disp_occ_0, unless `ground_truth: none`";

const NOC: Part = "disp_noc_0";
const OCC: Part = "disp_occ_0";
const OBJECTS: Part = "obj_map";
const EVALUATION: [Part; 3] = [NOC, OCC, OBJECTS];

const CALIBRATIONS: &str = "calib_cam_to_cam";

/// Parameters of `kitti/stereo2015`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiStereo2015Params {
    /// Folder that contains `training` and `testing`.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Part of the benchmark: `training` or `testing`.
    pub split: Split,
    /// Pixels of `depth`: `noc` (seen by both cameras), `occ` (all with ground truth) or `none`. Testing frames have
    /// no ground truth.
    pub ground_truth: KittiTruth,
    /// Whether training frames also have ground-truth disparities (`disp_noc`, `disp_occ`, `occluded`) and the map of
    /// objects (`obj_map`), as far as their folders exist. `score/disparity` uses them.
    pub disparities: bool,
    /// Selected frames, by KITTI's number: `1..=40`, `0..48`, `[3, 7]` or a file of ids, in this order, each once.
    /// All of them must exist; `1..=40 available` skips missing ones. The default is `available`: all frames.
    pub frames: FrameSelection,
}

pub(crate) struct KittiStereo2015 {
    folder: PathBuf,
    truth: GroundTruth,
    /// The parts that `score/disparity` uses.
    evaluation: Vec<Part>,
}

impl DatasetKind for KittiStereo2015 {
    type Params = KittiStereo2015Params;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let mut outputs = ports(
            "Left colour image, 8 bit, with the bytes of its file.",
            "Right colour image, 8 bit, with the bytes of its file.",
        );
        let objects = "255 on objects (`obj_map`); with `disparities: true`.";
        outputs.push(Port::frame("obj_map", ValueType::Mask, objects).optional());
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI stereo 2015: rectified colour pairs with sparse laser ground truth.",
            doc: "\
Layout (Menze and Geiger, *Object Scene Flow for Autonomous Vehicles*, 2015): `<root>/training` and `<root>/testing` \
with `image_2` (left) and `image_3` (right), files `%06d_10.png`. `training` also contains `disp_noc_0` and \
`disp_occ_0`. `calib_cam_to_cam/%06d.txt` is optional. The second time step, `_11`, is not read.\n\n\
The id of a frame is the stem of its file (`000150_10`), its index the number (150). Images keep the bytes of their \
PNG files. Ground-truth depth is `f * B / (v / 256)` for the 16-bit disparity `v`, NaN where `v` is 0. With \
`disparities: true` the disparities are outputs, too, and so are the objects if `obj_map` exists.\n\n\
With calibration files, `f = P_rect_02[0,0]` and `B` is the distance between the centres of both projections. \
Without them, the focal length depends on the width of the image: 721.5377 px (1242), 718.856 (1241), 718.3351 \
(1238), 707.0912 (1226), 707.0493 (1224). The baseline is `B = 0.532725` m, and the run prints a warning.\n\n\
Your own rectified pairs may use the same layout. Frame 150 is `training/image_2/000150_10.png` and \
`training/image_3/000150_10.png`, 8-bit PNG. `training/calib_cam_to_cam/000150.txt` has two lines, `P_rect_02: f 0 \
cx 0 0 f cy 0 0 0 1 0` and `P_rect_03: f 0 cx -f*B 0 f cy 0 0 0 1 0` (px; the baseline `B` in metres). Ground truth \
is optional: 16-bit grey PNG of disparity * 256, 0 = unknown, in `disp_noc_0` or `disp_occ_0`. Without it, set \
`ground_truth: none`. The source `images` reads other layouts.",
            outputs,
        }
    }

    fn check(params: &KittiStereo2015Params) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)
    }

    fn switched_off(params: &KittiStereo2015Params) -> Vec<SwitchedOff> {
        let of_disparities = ["disp_noc", "disp_occ", "occluded", "obj_map"];
        switched_off(params.split, params.ground_truth, params.disparities, &of_disparities)
    }

    fn list(params: &KittiStereo2015Params) -> Result<(Listing, Self), Fault> {
        existing_folder(params.root.path(), LAYOUT)?;
        let folder = params.root.path().join(params.split.folder());
        let lefts = Stems::list(&folder, "image_2", LAYOUT)?;
        let known = lefts.known(&folder, LAYOUT)?;
        let is_given =
            |part: &Part| params.disparities && params.split == Split::Training && folder.join(part).is_dir();
        let evaluation: Vec<Part> = EVALUATION.into_iter().filter(is_given).collect();
        let parts = [NOC, OCC];
        let truth = GroundTruth {
            parts,
            depth: params.ground_truth.part(params.split, parts),
            disparities: !evaluation.is_empty(),
        };
        let kind = Self { folder, truth, evaluation };
        let companions = kind.companions()?;
        let has_calibration = kind.folder.join(CALIBRATIONS).is_dir();
        let mut listing = Listing::default();
        listing.add_selected(&params.frames, &known, |at| kind.files(known[at], &companions, has_calibration))?;
        let unread = companions.iter().flat_map(|(_, stems, _)| stems.without(&lefts));
        let unread: Vec<String> = lefts.others.iter().cloned().chain(unread).collect();
        listing.warnings.extend(unread_files(&unread));
        Ok((listing, kind))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        halves(root, "KITTI stereo 2015", [NOC, OCC], |half| {
            let pair = half.join("image_2").is_dir() && half.join("image_3").is_dir();
            pair.then(|| json!({}))
        })
    }

    /// Unlike other kinds, so that keys of older recordings stay valid.
    fn key(&self, files: &Files) -> Key {
        let bytes = |part: Part| files.get(part).map(|file| &*file.bytes);
        let mut key = Key::build(KIND).number(VERSION.into());
        for part in [LEFT, RIGHT] {
            key = key.bytes(bytes(part).unwrap_or_default());
        }
        for (name, bytes) in [("calibration", bytes(CALIBRATION)), ("truth", self.truth.depth.and_then(bytes))] {
            if let Some(bytes) = bytes {
                key = key.text(name).bytes(bytes);
            }
        }
        // More outputs need another key, though the same files were read.
        if !self.evaluation.is_empty() {
            key = key.text("disparities");
        }
        for part in self.evaluation.iter().filter(|part| Some(**part) != self.truth.depth) {
            key = key.text(part).bytes(bytes(part).unwrap_or_default());
        }
        key.finish()
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let pair = files.pair(ctx)?;
        let size = pair.0.dimensions();
        let calibration = match files.get(CALIBRATION) {
            Some(file) => calibration::from_text(&file.path, &file.text(), size)?,
            None => {
                let left = files.required(LEFT)?;
                let assumed = calibration::by_width(size).map_err(|fault| at_file(&left.path, fault))?;
                ctx.host.warn(&calibration::assumption(&self.folder));
                assumed
            }
        };
        self.truth.outputs(files, pair, calibration, objects(files, size)?)
    }
}

type Companions = Vec<(Part, Stems, &'static str)>;

impl KittiStereo2015 {
    /// The other folders of images, each with the remedy for a missing file.
    fn companions(&self) -> Result<Companions, Fault> {
        let mut companions = vec![(
            RIGHT,
            Stems::list(&self.folder, "image_3", LAYOUT)?,
            "each left image needs a right image of the same name (KITTI: unpack data_scene_flow.zip again)",
        )];
        if let Some(truth) = self.truth.depth {
            let remedy = "set `truth` to `noc`, `occ` or `none`, depending on the ground truth that exists (KITTI: unpack data_scene_flow.zip again)";
            companions.push((truth, Stems::list(&self.folder, truth, remedy)?, remedy));
        }
        for part in self.evaluation.iter().copied().filter(|part| Some(*part) != self.truth.depth) {
            let remedy = "each frame needs its files; remove the whole folder to read frames without them";
            companions.push((part, Stems::list(&self.folder, part, LAYOUT)?, remedy));
        }
        Ok(companions)
    }

    fn files(&self, (number, stem): (u64, &str), companions: &Companions, has_calibration: bool) -> FrameFiles {
        let path = |folder: &str| self.folder.join(folder).join(format!("{stem}.png"));
        let mut files = FrameFiles::default();
        files.add(LEFT, Ok(path("image_2")));
        for (part, stems, remedy) in companions {
            let path = path(stems.folder);
            files.add(part, if stems.stems.contains(stem) { Ok(path) } else { Err(missing_file(&path, remedy)) });
        }
        if has_calibration {
            let path = self.folder.join(CALIBRATIONS).join(format!("{number:06}.txt"));
            let remedy = "each frame needs its calibration, 000150.txt for 000150_10.png (KITTI: unpack data_scene_flow_calib.zip again); \
                remove the whole folder calib_cam_to_cam to use the focal lengths of KITTI's own images";
            files.add(CALIBRATION, existing_file(path, remedy));
        }
        files
    }
}

fn objects(files: &Files, size: (u32, u32)) -> Result<Option<Mask>, Fault> {
    let Some(file) = files.get(OBJECTS) else { return Ok(None) };
    let image = image_file::image(&file.path, Arc::clone(&file.bytes))?;
    files.same_size_as_left(size, file, image.dimensions())?;
    let Pixels::Grey(numbers) = image.pixels() else {
        let what = format!("{} is a colour image, expected one channel as in KITTI's object maps", file.path.display());
        return Err(Fault::new(what).remedy("write the objects' numbers as 8-bit grey, 0 = background"));
    };
    let mut set = numbers.clone();
    set.iter_mut().for_each(|number| *number = if *number > 0 { 255 } else { 0 });
    Ok(Some(Mask { set }))
}
