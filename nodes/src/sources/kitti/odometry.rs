//! `kitti/odometry`: sequences of KITTI's odometry benchmark: rectified pairs without ground truth.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration};
use depthloom_graphs::{Context, Fault, Outputs};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::dataset::folders::{existing_file, existing_folder, folders, missing_file, stems};
use crate::sources::dataset::frame_files::{CALIBRATION, Files, LEFT, RIGHT};
use crate::sources::dataset::{DatasetKind, Listing, calibration_port, image_port, required};
use crate::sources::kitti::calibration::from_projections;
use crate::sources::kitti::cameras::KittiCameras;
use crate::sources::kitti::time::Clock;

const KIND: &str = "kitti/odometry";
const VERSION: u32 = 2;
const LAYOUT: &str = "root contains `sequences` with one folder per sequence (00), with calib.txt, times.txt, image_0 and image_1 (grey) or image_2 and image_3 (colour) \
    (KITTI odometry, data_odometry_color.zip or data_odometry_gray.zip, and data_odometry_calib.zip)";

/// Parameters of `kitti/odometry`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiOdometry {
    /// Folder that contains `sequences`, or the folder of one sequence.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Sequence to read: `00` to `21`. Leave it out if `root` is the folder of a sequence.
    pub sequence: String,
    /// Camera pair: `color` (`image_2`, `image_3`) or `grey` (`image_0`, `image_1`).
    pub cameras: KittiCameras,
    /// Selected frames, by their number. All by default.
    pub frames: FrameSelection,
}

const fn image_folders(cameras: KittiCameras) -> [&'static str; 2] {
    match cameras {
        KittiCameras::Color => ["image_2", "image_3"],
        KittiCameras::Grey => ["image_0", "image_1"],
    }
}

impl DatasetKind for KittiOdometry {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI odometry: sequences of rectified stereo pairs, grey or colour, without ground-truth depth.",
            doc: "\
Layout (Geiger, Lenz, Urtasun, *Are we ready for Autonomous Driving?*, 2012): `<root>/sequences/00/image_2/%06d.png` \
(left; `image_0` for the grey cameras), `image_3` (right; `image_1`), `calib.txt` with `P0` to `P3`, and `times.txt` \
in seconds.\n\n\
The id of a frame is sequence and number (`00_000042`). Its time is that of `times.txt`, or 10 Hz without that file.",
            outputs: vec![
                image_port("left", "Left image, 8 bit, with the bytes of its file."),
                image_port("right", "Right image, 8 bit, with the bytes of its file."),
                calibration_port(),
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)?;
        let is_name = params.sequence.bytes().all(|byte| byte.is_ascii_alphanumeric());
        match is_name {
            true => Ok(()),
            false => Err(("sequence", format!("`{}` is not a sequence of KITTI: expected 00 to 21", params.sequence))),
        }
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        if let Some(cameras) = cameras(root) {
            let what = format!("a sequence of KITTI odometry, {cameras} cameras");
            return vec![Recognised::new(what, json!({ "root": root, "cameras": cameras }))];
        }
        let sequences = root.join("sequences");
        let names = folders(&sequences, LAYOUT).unwrap_or_default().into_iter();
        names
            .filter_map(|sequence| {
                let cameras = cameras(&sequences.join(&sequence))?;
                let what = format!("KITTI odometry, sequence {sequence}, {cameras} cameras");
                Some(Recognised::new(what, json!({ "root": root, "sequence": sequence, "cameras": cameras })))
            })
            .collect()
    }

    fn meaning(&self) -> String {
        format!("{:?}", self.cameras)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let calibration = from_projections(files.required(CALIBRATION)?, self.cameras, left.dimensions())?;
        Ok(Outputs::one("left", left).with("right", right).with("calibration", calibration))
    }
}

/// The first pair of cameras that a sequence's folder has.
fn cameras(folder: &Path) -> Option<&'static str> {
    let is_there = |cameras: &KittiCameras| image_folders(*cameras).iter().all(|side| folder.join(side).is_dir());
    let found = [KittiCameras::Color, KittiCameras::Grey].into_iter().find(is_there)?;
    folder.join("calib.txt").is_file().then(|| found.name())
}

fn sequence(params: &KittiOdometry) -> Result<(PathBuf, String), Fault> {
    let root = params.root.path();
    existing_folder(root, LAYOUT)?;
    if params.sequence.is_empty() {
        let name = root.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        return match root.join("calib.txt").is_file() {
            true => Ok((root.to_owned(), name)),
            false => Err(Fault::new(format!("{} is not the folder of a sequence", root.display()))
                .remedy(format!("set e.g. `sequence: \"00\"`; {LAYOUT}"))),
        };
    }
    let folder = root.join("sequences").join(&params.sequence);
    existing_folder(&folder, LAYOUT)?;
    Ok((folder, params.sequence.clone()))
}

fn list(params: &KittiOdometry) -> Result<Listing, Fault> {
    let (folder, name) = sequence(params)?;
    let [left, right] = image_folders(params.cameras);
    let mut lefts: Vec<(u64, String, PathBuf)> = stems(&folder.join(left), &["png", "jpg"], LAYOUT)?
        .into_iter()
        .filter_map(|(stem, path)| Some((stem.parse().ok()?, stem, path)))
        .collect();
    lefts.sort();
    if lefts.is_empty() {
        return Err(Fault::new(format!("no image named like 000000.png found in {}", folder.join(left).display()))
            .remedy(LAYOUT));
    }
    let rights = stems(&folder.join(right), &["png", "jpg"], LAYOUT)?;
    let calibration = existing_file(folder.join("calib.txt"), LAYOUT)?;
    let clock = Clock::of_seconds(folder.join("times.txt"))?;
    let ids: Vec<(u64, String)> = lefts.iter().map(|(number, stem, _)| (*number, format!("{name}_{stem}"))).collect();
    let known: Vec<(u64, &str)> = ids.iter().map(|(index, id)| (*index, id.as_str())).collect();
    let mut listing = Listing::default();
    for at in params.frames.select(&known)? {
        let (index, id) = known[at];
        let (_, stem, left) = &lefts[at];
        let frame = clock.frame(id, index, usize::try_from(index).ok())?;
        let missing = || {
            let remedy = "each left image needs a right image of the same number (KITTI: unpack the sequence again)";
            missing_file(&folder.join(right).join(format!("{stem}.png")), remedy)
        };
        let files = rights
            .get(stem)
            .ok_or_else(missing)
            .map(|right| vec![(LEFT, left.clone()), (RIGHT, right.clone()), (CALIBRATION, calibration.clone())]);
        listing.add(frame, files);
    }
    listing.warnings.extend(params.frames.left_out(&known));
    Ok(listing)
}
