//! `kitti/odometry`: sequences of KITTI's odometry benchmark: rectified pairs without depth truth.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::{Context, Fault, Outputs, Port, Source, SourceKind, ValueType, regular_file};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::sources::dataset::{
    CALIBRATION, Entry, Files, LEFT, Layout, Listing, RIGHT, folders, no_file, no_folder, stems, survey,
};
use crate::sources::kitti::calibration::{Lines, PROJECTIONS, pair};
use crate::sources::kitti::raw::KittiCameras;
use crate::sources::kitti::time;

const KIND: &str = "kitti/odometry";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds `sequences` with a folder a sequence (00), with calib.txt, times.txt, image_0 and image_1 (grey) or image_2 and image_3 (colour) \
    (KITTI odometry, data_odometry_color.zip or data_odometry_gray.zip, and data_odometry_calib.zip)";

const MOST_BYTES: u64 = 16 << 20;

/// Parameters of `kitti/odometry`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiOdometryParams {
    /// The folder that holds `sequences`; or a sequence's own.
    pub root: DataPath,
    /// Which sequence: `00` to `21`. Not of a sequence's own folder.
    pub sequence: String,
    /// Which pair of cameras: `color` (`image_2`, `image_3`) or `grey` (`image_0`, `image_1`).
    pub cameras: KittiCameras,
    /// Which frames, by their number. By default all.
    pub frames: FrameSelection,
}

const fn image_folders(cameras: KittiCameras) -> [&'static str; 2] {
    match cameras {
        KittiCameras::Color => ["image_2", "image_3"],
        KittiCameras::Grey => ["image_0", "image_1"],
    }
}

pub(crate) struct KittiOdometry {
    cameras: KittiCameras,
}

impl SourceKind for KittiOdometry {
    type Params = KittiOdometryParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI odometry: sequences of rectified stereo pairs, grey or colour, without depth truth.",
            doc: "\
Layout (Geiger, Lenz, Urtasun, *Are we ready for Autonomous Driving?*, 2012): `<root>/sequences/00/image_2/%06d.png` (left; `image_0` of the grey cameras), \
`image_3` (right; `image_1`), `calib.txt` with `P0` to `P3`, `times.txt` in seconds.\n\n\
A frame's id is sequence and number (`00_000042`), its time that of `times.txt`, else 10 Hz.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left image, 8 bit, with its file's bytes."),
                Port::frame("right", ValueType::Image, "Right image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline."),
            ],
        }
    }

    fn check(params: &KittiOdometryParams) -> Result<(), (&'static str, String)> {
        if params.root.path().as_os_str().is_empty() {
            return Err(("root", format!("root is missing: {LAYOUT}")));
        }
        let is_name = params.sequence.bytes().all(|byte| byte.is_ascii_alphanumeric());
        match is_name {
            true => Ok(()),
            false => Err(("sequence", format!("`{}` is no sequence: KITTI's are 00 to 21", params.sequence))),
        }
    }

    fn open(params: KittiOdometryParams) -> Result<Box<dyn Source>, Fault> {
        list(&params)?.open(Self { cameras: params.cameras })
    }

    fn survey(params: KittiOdometryParams) -> Survey {
        survey(list(&params).map(|listing| (listing, Self { cameras: params.cameras })))
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
}

fn cameras(folder: &Path) -> Option<&'static str> {
    let pairs = [(["image_2", "image_3"], "color"), (["image_0", "image_1"], "grey")];
    let has_pair = |sides: [&str; 2]| sides.into_iter().all(|side| folder.join(side).is_dir());
    let has_calibration = folder.join("calib.txt").is_file();
    pairs.into_iter().find(|(sides, _)| has_calibration && has_pair(*sides)).map(|(_, cameras)| cameras)
}

fn sequence(params: &KittiOdometryParams) -> Result<(PathBuf, String), Fault> {
    let root = params.root.path();
    if !root.is_dir() {
        return Err(no_folder(root, LAYOUT));
    }
    if params.sequence.is_empty() {
        let name = root.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        return match root.join("calib.txt").is_file() {
            true => Ok((root.to_owned(), name)),
            false => Err(Fault::new(format!("{} is no sequence", root.display()))
                .remedy(format!("say which: `sequence: \"00\"`; {LAYOUT}"))),
        };
    }
    let folder = root.join("sequences").join(&params.sequence);
    match folder.is_dir() {
        true => Ok((folder, params.sequence.clone())),
        false => Err(no_folder(&folder, LAYOUT)),
    }
}

fn list(params: &KittiOdometryParams) -> Result<Listing, Fault> {
    let (folder, name) = sequence(params)?;
    let [left, right] = image_folders(params.cameras);
    let mut lefts: Vec<(u64, String, PathBuf)> = stems(&folder.join(left), &["png", "jpg"], LAYOUT)?
        .into_iter()
        .filter_map(|(stem, path)| Some((stem.parse().ok()?, stem, path)))
        .collect();
    lefts.sort();
    if lefts.is_empty() {
        return Err(
            Fault::new(format!("{} holds no image named like 000000.png", folder.join(left).display())).remedy(LAYOUT)
        );
    }
    let rights = stems(&folder.join(right), &["png", "jpg"], LAYOUT)?;
    let calibration = folder.join("calib.txt");
    if !calibration.is_file() {
        return Err(no_file(&calibration, LAYOUT));
    }
    let clock = folder.join("times.txt");
    let times = times(&clock)?;
    let ids: Vec<(u64, String)> = lefts.iter().map(|(number, stem, _)| (*number, format!("{name}_{stem}"))).collect();
    let known: Vec<(u64, &str)> = ids.iter().map(|(index, id)| (*index, id.as_str())).collect();
    let mut listing = Listing::default();
    for at in params.frames.select(&known)? {
        let (index, id) = known[at];
        let (_, stem, left) = &lefts[at];
        let frame = time::frame(id, index, usize::try_from(index).ok(), &times, &clock)?;
        let missing = || {
            let remedy = "each left image needs its right one, of the same number (KITTI: unpack the sequence again)";
            no_file(&folder.join(right).join(format!("{stem}.png")), remedy)
        };
        listing.push(rights.get(stem).ok_or_else(missing).map(|right| Entry {
            frame,
            files: vec![(LEFT, left.clone()), (RIGHT, right.clone()), (CALIBRATION, calibration.clone())],
        }));
    }
    listing.warnings.extend(params.frames.left_out(&known));
    Ok(listing)
}

fn times(path: &Path) -> Result<Vec<u64>, Fault> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let bytes = regular_file::read(path, MOST_BYTES).map_err(failed)?;
    let text = String::from_utf8_lossy(&bytes);
    let time = |(index, line): (usize, &str)| {
        let seconds = line.trim().parse::<f64>().ok().filter(|seconds| (0.0..1e9).contains(seconds));
        seconds.map(|seconds| (seconds * 1e9).round() as u64).ok_or_else(|| {
            let line: String = line.chars().take(40).collect();
            Fault::new(format!("{}:{}: `{line}` is no time", path.display(), index + 1))
                .remedy("a line is a number of seconds, `1.036224e-01`; without the file frames come at 10 Hz")
        })
    };
    text.trim_end().lines().enumerate().map(time).collect()
}

impl Layout for KittiOdometry {
    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn meaning(&self) -> String {
        format!("{:?}", self.cameras)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let file = files.the(CALIBRATION)?;
        let text = file.text();
        let cameras = match self.cameras {
            KittiCameras::Color => ["P2", "P3"],
            KittiCameras::Grey => ["P0", "P1"],
        };
        let calibration = pair(&Lines::of(&file.path, &text, PROJECTIONS)?, cameras, left.dimensions())?;
        Ok(Outputs::one("left", left).with("right", right).with("calibration", calibration))
    }
}
