//! `kitti/stereo2012`: the KITTI stereo 2012 benchmark, as unpacked.

use std::path::Path;

use depthloom_graphs::contracts::{DataPath, Frame, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::values::TrueDisparity;
use depthloom_graphs::{Context, Fault, Outputs, Port, Source, SourceKind, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::dataset::{
    CALIBRATION, Files, Gathered, LEFT, Layout, Listing, Part, RIGHT, no_file, no_folder, stems, survey,
};
use crate::sources::evaluation::Evaluation;
use crate::sources::kitti::calibration::{Lines, PROJECTIONS, pair};
use crate::sources::kitti::raw::KittiCameras;
use crate::sources::kitti::stereo_2015::{KittiTruth, Split, halves};
use crate::sources::true_disparity;

const KIND: &str = "kitti/stereo2012";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds `training` (with truth) or `testing` (without), each with colored_0 (left) and colored_1 (right), or image_0 and image_1 of the grey \
    cameras, of 000000_10.png ..., and calib; in training also disp_noc or disp_occ, unless `truth: none` (KITTI stereo 2012, data_stereo_flow.zip)";

const NOC: Part = "disp_noc";
const OCC: Part = "disp_occ";

/// Parameters of `kitti/stereo2012`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiStereo2012Params {
    /// The folder that holds `training` and `testing`.
    pub root: DataPath,
    /// Which half: `training` or `testing`.
    pub split: Split,
    /// Which pair of cameras: `color` (`colored_0`, `colored_1`) or `grey` (`image_0`, `image_1`).
    pub cameras: KittiCameras,
    /// Which true pixels: `noc` (seen by both cameras), `occ` (all) or `none`. Testing frames have none.
    pub truth: KittiTruth,
    /// Whether the truth of training frames is given as disparities too (`disp_noc`, `disp_occ`, `occluded`), as far as their folders
    /// are there: for `score/disparity`.
    pub disparities: bool,
    /// Which frames, by KITTI's number. By default all there are.
    pub frames: FrameSelection,
}

pub(crate) struct KittiStereo2012 {
    cameras: KittiCameras,
    truth: Option<Part>,
    disparities: bool,
}

impl SourceKind for KittiStereo2012 {
    type Params = KittiStereo2012Params;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI stereo 2012: rectified pairs, colour or grey, with sparse laser truth.",
            doc: "\
Layout (Geiger, Lenz, Urtasun, *Are we ready for Autonomous Driving?*, 2012): `<root>/training` and `<root>/testing` with `colored_0` (left) and `colored_1` \
(right), or `image_0` and `image_1` of the grey cameras, names `%06d_10.png`; `disp_noc` and `disp_occ` in `training`; `calib/%06d.txt` with `P0` to `P3`. The \
second time step, `_11`, is not read.\n\n\
A frame's id is its file's stem (`000150_10`), its index the number (150). Truth is depth: `f * B / (v / 256)` of the 16-bit disparity `v`, NaN where `v` is 0; \
with `disparities: true` the disparities are given too. The truth is that of the grey cameras' left one; KITTI takes it for the colour camera's, too.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left image, 8 bit, with its file's bytes."),
                Port::frame("right", ValueType::Image, "Right image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline."),
                Port::frame(
                    "depth",
                    ValueType::Depth,
                    "Sparse true depth, metres, NaN = unknown; absent in `testing`.",
                )
                .optional(),
            ]
            .into_iter()
            .chain(Evaluation::asked())
            .collect(),
        }
    }

    fn check(params: &KittiStereo2012Params) -> Result<(), (&'static str, String)> {
        match params.root.path().as_os_str().is_empty() {
            true => Err(("root", format!("root is missing: {LAYOUT}"))),
            false => Ok(()),
        }
    }

    fn open(params: KittiStereo2012Params) -> Result<Box<dyn Source>, Fault> {
        let (listing, layout) = Self::listed(&params)?;
        listing.open(layout)
    }

    fn survey(params: KittiStereo2012Params) -> Survey {
        survey(Self::listed(&params))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        halves(root, "KITTI stereo 2012", [NOC, OCC], |half| {
            let pairs = [("colored_0", "colored_1", "color"), ("image_0", "image_1", "grey")].into_iter();
            let mut found = pairs.filter(|(left, right, _)| half.join(left).is_dir() && half.join(right).is_dir());
            found.next().map(|(.., cameras)| json!({ "cameras": cameras }))
        })
    }
}

impl KittiStereo2012 {
    fn listed(params: &KittiStereo2012Params) -> Result<(Listing, Self), Fault> {
        let truth = match (params.split, params.truth) {
            (Split::Testing, _) | (_, KittiTruth::None) => None,
            (Split::Training, KittiTruth::Noc) => Some(NOC),
            (Split::Training, KittiTruth::Occ) => Some(OCC),
        };
        let disparities = params.disparities && params.split == Split::Training;
        let layout = Self { cameras: params.cameras, truth, disparities };
        Ok((layout.list(params)?, layout))
    }

    fn list(&self, params: &KittiStereo2012Params) -> Result<Listing, Fault> {
        let root = params.root.path();
        if !root.is_dir() {
            return Err(no_folder(root, LAYOUT));
        }
        let folder = root.join(params.split.folder());
        if !folder.is_dir() {
            return Err(no_folder(&folder, LAYOUT));
        }
        let [left, right] = match params.cameras {
            KittiCameras::Color => ["colored_0", "colored_1"],
            KittiCameras::Grey => ["image_0", "image_1"],
        };
        let is_first = |stem: &String| stem.ends_with("_10") && stem.len() == 9;
        let lefts: Vec<String> = stems(&folder.join(left), &["png"], LAYOUT)?.into_keys().filter(is_first).collect();
        let numbers: Vec<(u64, &str)> =
            lefts.iter().filter_map(|stem| Some((stem[..6].parse().ok()?, stem.as_str()))).collect();
        if numbers.is_empty() {
            let empty = folder.join(left);
            return Err(
                Fault::new(format!("{} holds no image named like 000000_10.png", empty.display())).remedy(LAYOUT)
            );
        }
        // Truth that is asked for must be there; of disparities for scores, what is there is given.
        let maps = [NOC, OCC]
            .into_iter()
            .filter(|part| self.truth == Some(*part) || (self.disparities && folder.join(part).is_dir()));
        let maps: Vec<Part> = maps.collect();
        let mut listing = Listing::default();
        for at in params.frames.select(&numbers)? {
            let (number, stem) = numbers[at];
            listing.gather(Frame::at_10_hz(stem, number), gathered(&folder, [left, right], &maps, number, stem));
        }
        listing.warnings.extend(params.frames.left_out(&numbers));
        Ok(listing)
    }
}

fn gathered(folder: &Path, [left, right]: [&str; 2], maps: &[Part], number: u64, stem: &str) -> Gathered {
    let file = |of: &str, name: String, remedy: &str| {
        let path = folder.join(of).join(name);
        if path.is_file() { Ok(path) } else { Err(no_file(&path, remedy)) }
    };
    let image = |of: &str| {
        file(of, format!("{stem}.png"), "each left image needs its right one, and its truth unless `truth: none`")
    };
    let calibration = file(
        "calib",
        format!("{number:06}.txt"),
        "each frame needs its calibration, 000150.txt for 000150_10.png (KITTI: data_stereo_flow_calib.zip)",
    );
    let mut files = Gathered::default();
    files.take(LEFT, image(left));
    files.take(RIGHT, image(right));
    files.take(CALIBRATION, calibration);
    for map in maps {
        files.take(map, image(map));
    }
    files
}

impl Layout for KittiStereo2012 {
    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn meaning(&self) -> String {
        format!("{:?} {:?} {}", self.cameras, self.truth, self.disparities)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let file = files.the(CALIBRATION)?;
        let text = file.text();
        let cameras = match self.cameras {
            KittiCameras::Color => ["P2", "P3"],
            KittiCameras::Grey => ["P0", "P1"],
        };
        let calibration = pair(&Lines::of(&file.path, &text, PROJECTIONS)?, cameras, size)?;
        let map =
            |part| Ok::<_, Fault>(files.map_u16(part, "disparity", size)?.as_ref().map(TrueDisparity::from_px_256));
        let maps = Evaluation { noc: map(NOC)?, occ: map(OCC)?, objects: None };
        let truth = match self.truth {
            Some(NOC) => maps.noc.as_ref(),
            Some(_) => maps.occ.as_ref(),
            None => None,
        };
        let mut outputs = Outputs::one("left", left).with("right", right);
        if let Some(truth) = truth {
            outputs = outputs.with("depth", true_disparity::depth(truth, &calibration));
        }
        outputs = outputs.with("calibration", calibration);
        Ok(if self.disparities { maps.outputs(outputs) } else { outputs })
    }
}
