//! `kitti/depth`: KITTI's depth benchmark: annotated depth maps over the images of the raw data.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Outputs, natural_order};
use depthloom_kernels::depth::truth_from_depth_png;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::shape::filled;
use crate::sources::dataset::folders::{existing_file, existing_folder, existing_with_ending, folders, stems};
use crate::sources::dataset::frame_files::{CALIBRATION, Files, LEFT, Part, RIGHT, TRUTH};
use crate::sources::dataset::{DatasetKind, Listing, calibration_port, depth_port, image_port, required};
use crate::sources::kitti::calibration;
use crate::sources::kitti::cameras::KittiCameras;
use crate::sources::kitti::drives::{self, IMAGES};
use crate::sources::kitti::raw::KittiRaw;

const KIND: &str = "kitti/depth";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds a folder a drive (2011_09_26_drive_0001_sync), in `train` and `val` or without them, with \
    proj_depth/groundtruth/image_02 (KITTI depth, data_depth_annotated.zip)";
const RAW: &str = "raw contains one folder per date (2011_09_26) with its calibration and its drives' image_02/data and image_03/data (KITTI raw)";

/// Depth maps that are the ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum KittiDepthTruth {
    /// `groundtruth`: eleven accumulated scans, checked against stereo.
    #[default]
    Groundtruth,
    /// `velodyne_raw`: one projected scan.
    VelodyneRaw,
}

impl KittiDepthTruth {
    const fn folder(self) -> &'static str {
        match self {
            Self::Groundtruth => "groundtruth",
            Self::VelodyneRaw => "velodyne_raw",
        }
    }
}

/// Parameters of `kitti/depth`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiDepth {
    /// Folder that contains the drives with their `proj_depth`, or `train` and `val` with the drives.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Folder of KITTI's raw data, which contains the images and the calibration.
    #[schemars(extend("mandatory" = true))]
    pub raw: DataPath,
    /// Drives to read, in this order: `2011_09_26_drive_0001_sync`, with or without `_sync`. By default all with
    /// ground truth.
    pub drives: Vec<String>,
    /// Depth maps that are the ground truth: `groundtruth` (annotated) or `velodyne_raw` (one scan).
    pub ground_truth: KittiDepthTruth,
    /// Selected frames, all with ground truth by default. For one drive use KITTI's numbers, for several drives the
    /// count over all drives, from 0.
    pub frames: FrameSelection,
}

impl DatasetKind for KittiDepth {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI depth: annotated depth maps for the rectified colour pairs of KITTI's raw data.",
            doc: "\
Layout (Uhrig et al., *Sparsity Invariant CNNs*, 2017): \
`<root>/<drive>_sync/proj_depth/groundtruth/image_02/%010d.png`, directly in `root` or in its folders `train` and \
`val`, as in the archive. Images and calibration come from KITTI's raw data: \
`<raw>/<date>/<drive>_sync/image_02/data/%010d.png`, `image_03`, `<raw>/<date>/calib_cam_to_cam.txt`.\n\n\
The id of a frame is drive and number (`2011_09_26_drive_0001_sync_0000000005`). The frames are those with ground \
truth; the benchmark leaves out the first and last five frames of a drive. Ground truth is depth in metres * 256 in \
16 bits, 0 = unknown.",
            outputs: vec![
                image_port("left", "Left colour image, 8 bit, with the bytes of its file."),
                image_port("right", "Right colour image, 8 bit, with the bytes of its file."),
                calibration_port(),
                depth_port("Ground-truth depth, metres, NaN = unknown."),
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)?;
        required("raw", &params.raw, RAW)
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let truths = [KittiDepthTruth::Groundtruth, KittiDepthTruth::VelodyneRaw];
        let there = truths.into_iter().find_map(|truth| drives(root, truth).ok().map(|drives| (truth, drives.len())));
        let Some((truth, count)) = there else { return Vec::new() };
        // The raw data is often in this folder, or next to it.
        let within = |folder: &Path| -> Vec<PathBuf> {
            folders(folder, LAYOUT).unwrap_or_default().into_iter().map(|name| folder.join(name)).collect()
        };
        let mut candidates = [Some(root), root.parent()].into_iter().flatten().flat_map(within);
        let raw = candidates.find(|folder| !KittiRaw::recognise(folder).is_empty());
        let what = match &raw {
            Some(_) => format!("KITTI depth, drives with ground truth: {count}"),
            None => format!(
                "KITTI depth, drives with ground truth: {count}; set `raw` to KITTI's raw data, which contains the images"
            ),
        };
        let raw = raw.unwrap_or_else(|| PathBuf::from("/path/to/kitti_raw"));
        let params = json!({ "root": root, "raw": raw, "ground_truth": truth.folder() });
        vec![Recognised::new(what, params)]
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let lines = calibration::day_lines(files.required(CALIBRATION)?)?;
        let calibration = calibration::of_day(&lines, KittiCameras::Color, size)?;
        let mut outputs = Outputs::one("left", left).with("right", right).with("calibration", calibration);
        if let Some(raw) = files.map_u16(TRUTH, "metres", size)? {
            let metres = filled(size, |out| truth_from_depth_png(&raw, out));
            outputs = outputs.with("depth", Depth { metres });
        }
        Ok(outputs)
    }
}

fn drives(root: &Path, truth: KittiDepthTruth) -> Result<BTreeMap<String, PathBuf>, Fault> {
    let mut found = BTreeMap::new();
    let halves = [root.to_owned(), root.join("train"), root.join("val")];
    existing_folder(root, LAYOUT)?;
    for half in halves.iter().filter(|half| half.is_dir()) {
        for name in folders(half, LAYOUT)?.into_iter().filter(|name| name.contains("_drive_")) {
            let maps = half.join(&name).join("proj_depth").join(truth.folder()).join("image_02");
            if maps.is_dir() {
                found.insert(name, maps);
            }
        }
    }
    match found.is_empty() {
        true => {
            Err(Fault::new(format!("no drive with {1} found in {0}", root.display(), truth.folder())).remedy(LAYOUT))
        }
        false => Ok(found),
    }
}

fn list(params: &KittiDepth) -> Result<Listing, Fault> {
    let all = drives(params.root.path(), params.ground_truth)?;
    let chosen: Vec<(&String, &PathBuf)> = match params.drives.is_empty() {
        true => all.iter().collect(),
        false => params.drives.iter().map(|name| drives::named(&all, name)).collect::<Result<_, _>>()?,
    };
    let mut frames: Vec<(&str, String, PathBuf)> = Vec::new();
    for (drive, maps) in &chosen {
        let mut stems: Vec<(String, PathBuf)> = stems(maps, &["png"], LAYOUT)?.into_iter().collect();
        stems.sort_by(|(a, _), (b, _)| natural_order(a, b));
        frames.extend(stems.into_iter().map(|(stem, map)| (drive.as_str(), stem, map)));
    }
    let ids = drives::ids(frames.iter().map(|(drive, stem, _)| (*drive, &**stem)), chosen.len() == 1);
    let known: Vec<(u64, &str)> = ids.iter().map(|(index, id)| (*index, id.as_str())).collect();
    let mut listing = Listing::default();
    listing.add_selected(&params.frames, &known, |at| {
        let (drive, stem, map) = &frames[at];
        files(params.raw.path(), drive, stem, map)
    })?;
    Ok(listing)
}

fn files(raw: &Path, drive: &str, stem: &str, map: &Path) -> Result<Vec<(Part, PathBuf)>, Fault> {
    // The raw data, or a date's own folder.
    let is_date = raw.join("calib_cam_to_cam.txt").is_file();
    let date = if is_date { raw.to_owned() } else { raw.join(drive.get(..10).unwrap_or(drive)) };
    let image = |camera: &str| existing_with_ending(&date.join(drive).join(camera).join("data"), stem, &IMAGES, RAW);
    let [left, right] = KittiCameras::Color.folders();
    let calibration = existing_file(date.join("calib_cam_to_cam.txt"), RAW)?;
    Ok(vec![(LEFT, image(left)?), (RIGHT, image(right)?), (CALIBRATION, calibration), (TRUTH, map.to_owned())])
}
