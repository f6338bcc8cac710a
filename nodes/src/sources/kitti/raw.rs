//! `kitti/raw`: drives of KITTI's raw data, synchronised and rectified, with the laser scanner as ground truth.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::Depth;
use depthloom_graphs::{Context, Fault, Outputs, counted, natural_order};
use depthloom_kernels::velodyne::{Rule, depth_from_points};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::shape::filled;
use crate::sources::dataset::folders::{existing_file, missing_file, stems};
use crate::sources::dataset::frame_files::{CALIBRATION, File, Files, LEFT, Part, RIGHT};
use crate::sources::dataset::{
    DatasetKind, FrameFiles, Listing, calibration_port, depth_port, image_port, required, truth_off,
};
use crate::sources::kitti::calibration;
use crate::sources::kitti::cameras::KittiCameras;
use crate::sources::kitti::drives::{self, Drive, DriveFrame, IMAGES, is_drive};
use crate::sources::kitti::time::Clock;

const KIND: &str = "kitti/raw";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds a folder a date (2011_09_26), with calib_cam_to_cam.txt, calib_velo_to_cam.txt and a folder a drive \
    (2011_09_26_drive_0002_sync) with image_02/data and image_03/data (KITTI raw, \"synced+rectified data\" and \"calibration\")";

const SCAN: Part = "scan";
const SCANNER: Part = "calibration_scanner";

/// Ground truth to read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiRawTruth {
    /// Laser scans, projected into the left camera.
    #[default]
    Velodyne,
    /// Scans are not read, even if they exist.
    None,
}

/// Rules that convert a scan to depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Compat {
    /// Points in front of the camera, at the nearest pixel; the nearest point wins; depth along the camera's axis.
    #[default]
    None,
    /// `generate_depth_map` of monodepth2, with depth along the camera's axis.
    Monodepth2,
    /// The same with depth along the scanner's x axis (`vel_depth`), as in the ground truth of the Eigen split.
    Monodepth2Eigen,
}

impl Compat {
    const fn rule(self) -> Rule {
        match self {
            Self::None => Rule::Nearest,
            Self::Monodepth2 => Rule::Monodepth2 { scanner_depth: false },
            Self::Monodepth2Eigen => Rule::Monodepth2 { scanner_depth: true },
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Monodepth2 => "monodepth2",
            Self::Monodepth2Eigen => "monodepth2-eigen",
        }
    }
}

/// Parameters of `kitti/raw`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct KittiRaw {
    /// Folder that contains the folders of dates, or the folder of one date.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Drives to read, in this order: `2011_09_26_drive_0002_sync`, with or without `_sync`. All by default.
    pub drives: Vec<String>,
    /// File with a list of frames, as used by monodepth2 and Eigen et al. Each line is
    /// `2011_09_26/2011_09_26_drive_0002_sync 0000000069 l`, or the path of a left image. Frames are read in the
    /// order of the list, each pair once. `left` is always the left image, whichever camera the line names.
    pub split: Option<DataPath>,
    /// Camera pair: `color` (02, 03) or `grey` (00, 01).
    pub cameras: KittiCameras,
    /// Ground truth: `velodyne` or `none`.
    pub ground_truth: KittiRawTruth,
    /// Rules that convert a scan to depth: `none` (depthloom's own), `monodepth2` or `monodepth2-eigen`.
    pub compat: Compat,
    /// Selected frames, all by default. For one drive use KITTI's numbers, for several drives the count over all
    /// drives, with `split` the position in it; counts start at 0.
    pub frames: FrameSelection,
}

impl DatasetKind for KittiRaw {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI raw: drives of rectified stereo pairs, with projected laser scans as ground truth.",
            doc: "\
Layout (Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013; \"synced+rectified\"): \
`<root>/<date>/<drive>_sync/image_02/data/%010d.png` (left; `image_00` for the grey cameras), `image_03` (right), \
`velodyne_points/data/%010d.bin`, `image_02/timestamps.txt`. `<root>/<date>` also contains `calib_cam_to_cam.txt` \
and `calib_velo_to_cam.txt`. Images may be JPEG.\n\n\
The id of a frame is drive and number (`2011_09_26_drive_0002_sync_0000000001`). Its time is that of the left \
camera, or 10 Hz without timestamps.\n\n\
Ground truth is sparse: the points of a laser scan, projected by `P_rect_02 R_rect_00 [R|T]`. Points in front of the \
camera count, each at the nearest pixel (half to even); if several points fall on a pixel, the nearest one wins. A \
frame without a scan has no ground truth.\n\n\
`compat: monodepth2` follows `generate_depth_map` of that repository, which many publications use for evaluation. It \
keeps points with x >= 0 in the scanner's frame, subtracts one pixel from row and column, and detects duplicates by \
`row * (width - 1) + column - 1`. `monodepth2-eigen` also uses the scanner's x as depth, as in the exported ground \
truth of the Eigen split.",
            outputs: vec![
                image_port("left", "Left image, 8 bit, with the bytes of its file."),
                image_port("right", "Right image, 8 bit, with the bytes of its file."),
                calibration_port(),
                depth_port("Sparse ground-truth depth, metres, NaN = unknown; absent without a scan.").optional(),
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)?;
        if params.split.is_some() && !params.drives.is_empty() {
            return Err((
                "drives",
                "drives cannot be combined with split, which names the drive of each frame".to_owned(),
            ));
        }
        if params.compat != Compat::None
            && (params.ground_truth, params.cameras) != (KittiRawTruth::Velodyne, KittiCameras::Color)
        {
            return Err((
                "compat",
                "monodepth2 projects scans into the colour camera: `ground_truth: velodyne`, `cameras: color`"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == KittiRawTruth::None, "velodyne", &["depth"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let pairs = [KittiCameras::Color, KittiCameras::Grey].into_iter();
        let name = root.file_name().map(|name| name.to_string_lossy().into_owned()).filter(|name| is_drive(name));
        if let (Some(name), Some(parent)) = (name, root.parent()) {
            let there = pairs.filter(|pair| root.join(pair.folders()[0]).join("data").is_dir());
            return there
                .map(|pair| {
                    let params = json!({ "root": parent, "drives": [name], "cameras": pair.name() });
                    Recognised::new(format!("KITTI raw, 1 drive, {} cameras", pair.name()), params)
                })
                .collect();
        }
        let found = drives::find(root, LAYOUT).unwrap_or_default();
        let has = |pair: &KittiCameras| found.values().any(|drive| drive.folder.join(pair.folders()[0]).is_dir());
        let count = counted(found.len(), "drive");
        pairs
            .filter(has)
            .map(|pair| {
                let what = format!("KITTI raw, {count}, {} cameras", pair.name());
                Recognised::new(what, json!({ "root": root, "cameras": pair.name() }))
            })
            .collect()
    }

    fn meaning(&self) -> String {
        format!("{:?} {}", self.cameras, self.compat.name())
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let lines = calibration::day_lines(files.required(CALIBRATION)?)?;
        let calibration = calibration::of_day(&lines, self.cameras, size)?;
        let mut outputs = Outputs::one("left", left).with("right", right).with("calibration", calibration);
        if let Some(scan) = files.get(SCAN) {
            let projection = calibration::scanner_projection(&lines, files.required(SCANNER)?, self.cameras)?;
            outputs = outputs.with("depth", depth(scan, &projection, size, self.compat.rule())?);
        }
        Ok(outputs)
    }
}

/// The files of a drive, listed once.
struct DriveFiles {
    lefts: BTreeMap<String, PathBuf>,
    rights: BTreeMap<String, PathBuf>,
    scans: BTreeMap<String, PathBuf>,
    clock: Clock,
}

impl DriveFiles {
    fn list(drive: &Drive, params: &KittiRaw) -> Result<Self, Fault> {
        let [left, right] = params.cameras.folders();
        let scans = drive.folder.join("velodyne_points").join("data");
        let has_scans = params.ground_truth == KittiRawTruth::Velodyne && scans.is_dir();
        Ok(Self {
            lefts: stems(&drive.folder.join(left).join("data"), &IMAGES, LAYOUT)?,
            rights: stems(&drive.folder.join(right).join("data"), &IMAGES, LAYOUT)?,
            scans: if has_scans { stems(&scans, &["bin"], LAYOUT)? } else { BTreeMap::new() },
            clock: Clock::of_dates(drive.folder.join(left).join("timestamps.txt"))?,
        })
    }

    fn of_frame(&self, drive: &Drive, cameras: KittiCameras, stem: &str) -> FrameFiles {
        let image = |folder: &str, files: &BTreeMap<String, PathBuf>| {
            let remedy = "each left image needs a right image of the same number (KITTI: unpack the drive again)";
            let missing = || missing_file(&drive.folder.join(folder).join("data").join(format!("{stem}.png")), remedy);
            files.get(stem).cloned().ok_or_else(missing)
        };
        let of_date = |name: &str| {
            let remedy = "each date has its own calibration files (KITTI: unpack the date's calibration zip)";
            existing_file(drive.date.join(name), remedy)
        };
        let [left, right] = cameras.folders();
        let mut files = FrameFiles::default();
        files.add(LEFT, image(left, &self.lefts));
        files.add(RIGHT, image(right, &self.rights));
        files.add(CALIBRATION, of_date("calib_cam_to_cam.txt"));
        if let Some(scan) = self.scans.get(stem) {
            files.add(SCANNER, of_date("calib_velo_to_cam.txt"));
            files.add(SCAN, Ok(scan.clone()));
        }
        files
    }
}

fn list(params: &KittiRaw) -> Result<Listing, Fault> {
    let all = drives::find(params.root.path(), LAYOUT)?;
    let mut by_drive: HashMap<&str, DriveFiles> = HashMap::new();
    let mut frames: Vec<DriveFrame<'_>> = Vec::new();
    let mut listing = Listing::default();
    if let Some(split) = &params.split {
        let repeated;
        (frames, repeated) = drives::frames_of_split(split.path(), &all)?;
        listing.warnings.extend((repeated > 0).then(|| {
            format!(
                "{} names frames again, of the other camera or the same, on {repeated} of its lines: each pair is taken once",
                split.path().display()
            )
        }));
        for (drive, _) in &frames {
            if !by_drive.contains_key(&*drive.name) {
                by_drive.insert(&drive.name, DriveFiles::list(drive, params)?);
            }
        }
    } else {
        let chosen: Vec<&Drive> = match params.drives.is_empty() {
            true => all.values().collect(),
            false => {
                let named = |name: &String| drives::named(&all, name).map(|(_, drive)| drive);
                params.drives.iter().map(named).collect::<Result<_, _>>()?
            }
        };
        for drive in chosen {
            let files = DriveFiles::list(drive, params)?;
            let mut stems: Vec<&String> = files.lefts.keys().collect();
            stems.sort_by(|a, b| natural_order(a, b));
            frames.extend(stems.into_iter().map(|stem| (drive, stem.clone())));
            if by_drive.insert(&drive.name, files).is_some() {
                return Err(Fault::new(format!("drive {} is named twice", drive.name)));
            }
        }
    }
    if frames.is_empty() {
        return Err(Fault::new(format!("no image found in {}", params.root.path().display())).remedy(LAYOUT));
    }
    let one_drive = params.split.is_none() && by_drive.len() == 1;
    let ids = drives::ids(frames.iter().map(|(drive, stem)| (&*drive.name, &**stem)), one_drive);
    let known: Vec<(u64, &str)> = ids.iter().map(|(index, id)| (*index, id.as_str())).collect();
    let mut without_scan = 0;
    for at in params.frames.select(&known)? {
        let ((drive, stem), (index, id)) = (&frames[at], known[at]);
        let files = &by_drive[&*drive.name];
        without_scan += usize::from(!files.scans.contains_key(stem));
        let frame = files.clock.frame(id, index, stem.parse().ok())?;
        listing.add(frame, files.of_frame(drive, params.cameras, stem));
    }
    listing.warnings.extend(params.frames.left_out(&known));
    if params.ground_truth == KittiRawTruth::Velodyne && without_scan > 0 {
        let count = listing.len();
        listing.warnings.push(format!("{without_scan} of {count} frames have no laser scan, and so no ground truth"));
    }
    Ok(listing)
}

/// Little-endian f32, four per point.
fn depth(scan: &File, projection: &[f64; 12], size: (u32, u32), rule: Rule) -> Result<Depth, Fault> {
    let (points, rest) = scan.bytes.as_chunks::<16>();
    if !rest.is_empty() {
        let what = format!("{} bytes are not a whole number of points of 16 bytes", scan.bytes.len());
        return Err(scan.fault(what).remedy("the scan was cut short: copy or unpack it again"));
    }
    let points = points.iter().map(|point| {
        let numbers = point.as_chunks::<4>().0;
        [0, 1, 2, 3].map(|at| f32::from_le_bytes(numbers[at]))
    });
    let metres = filled(size, |out| {
        depth_from_points(points, projection, (size.0 as usize, size.1 as usize), rule, out);
    });
    Ok(Depth { metres })
}
