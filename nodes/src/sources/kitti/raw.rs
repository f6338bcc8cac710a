//! `kitti/raw`: drives of KITTI's raw data, synchronised and rectified, with the laser scanner as truth.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::values::{Calibration, Depth};
use depthloom_graphs::{Context, Fault, Outputs, Port, Source, SourceKind, ValueType, counted, regular_file};
use depthloom_kernels::velodyne::{Rule, depth_from_points};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::shape::filled;
use crate::sources::dataset::{
    CALIBRATION, File, Files, Gathered, LEFT, Layout, Listing, Part, RIGHT, folders, no_file, no_folder, numbered,
    stems, survey,
};
use crate::sources::images::natural_text;
use crate::sources::kitti::calibration::{self, COLOUR, Lines};
use crate::sources::kitti::time;

const KIND: &str = "kitti/raw";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds a folder a date (2011_09_26), with calib_cam_to_cam.txt, calib_velo_to_cam.txt and a folder a drive \
    (2011_09_26_drive_0002_sync) with image_02/data and image_03/data (KITTI raw, \"synced+rectified data\" and \"calibration\")";

pub(super) const CAMERAS: &str = "calib_cam_to_cam.txt has `S_rect_0x:` (width, height), `R_rect_00:` (9 numbers) and `P_rect_0x:` of both cameras (12 numbers, \
`f 0 cx -f*x 0 f cy 0 0 0 1 0`: px and metres): take it from the date's calibration zip again";
const SCANNERS: &str = "calib_velo_to_cam.txt has `R:` (9 numbers) and `T:` (3 numbers, metres): take it from the date's calibration zip again";

const SCAN: Part = "scan";
const SCANNER: Part = "calibration_scanner";

pub(super) const IMAGES: [&str; 3] = ["png", "jpg", "jpeg"];

const SPLIT: &str = "a line is `2011_09_26/2011_09_26_drive_0002_sync 0000000069 l`, or `2011_09_26/2011_09_26_drive_0002_sync/image_02/data/0000000069.png`";

/// Bytes.
const MOST_BYTES: u64 = 16 << 20;

/// Which pair of cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiCameras {
    /// The colour cameras, 02 and 03.
    #[default]
    Color,
    /// The grey cameras, 00 and 01.
    Grey,
}

impl KittiCameras {
    pub(crate) const fn folders(self) -> [&'static str; 2] {
        match self {
            Self::Color => ["image_02", "image_03"],
            Self::Grey => ["image_00", "image_01"],
        }
    }

    pub(crate) const fn projections(self) -> [&'static str; 2] {
        match self {
            Self::Color => COLOUR,
            Self::Grey => ["P_rect_00", "P_rect_01"],
        }
    }

    const fn size(self) -> &'static str {
        match self {
            Self::Color => "S_rect_02",
            Self::Grey => "S_rect_00",
        }
    }
}

/// What is true.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiRawTruth {
    /// The laser scans, projected into the left camera.
    #[default]
    Velodyne,
    /// None: scans are not read, even where there are some.
    None,
}

/// By whose rules a scan becomes depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Compat {
    /// Points in front of the camera, at the nearest pixel; the nearest point wins; depth along the camera's axis.
    #[default]
    None,
    /// monodepth2's `generate_depth_map`, with depth along the camera's axis.
    Monodepth2,
    /// The same with depth along the scanner's x axis (`vel_depth`), as the truth of the Eigen split is made.
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
pub(crate) struct KittiRawParams {
    /// The folder that holds the dates; or a date's own.
    pub root: DataPath,
    /// Which drives, in this order: `2011_09_26_drive_0002_sync`, with or without `_sync`. By default all there are.
    pub drives: Vec<String>,
    /// A list of frames as monodepth2's and Eigen's: `2011_09_26/2011_09_26_drive_0002_sync 0000000069 l`, or a path of a left image, a line each.
    /// Frames come in its order, each pair once and whichever camera its line names; `left` is always the left image.
    pub split: Option<DataPath>,
    /// Which pair of cameras: `color` (02, 03) or `grey` (00, 01).
    pub cameras: KittiCameras,
    /// What is true: `velodyne` or `none`.
    pub truth: KittiRawTruth,
    /// By whose rules a scan becomes depth: `none` (ours), `monodepth2`, or `monodepth2-eigen`.
    pub compat: Compat,
    /// Which frames: of one drive by KITTI's number, of several by their count over all drives, of a split by their count in it, from 0. By default all.
    pub frames: FrameSelection,
}

pub(crate) struct KittiRaw {
    cameras: KittiCameras,
    compat: Compat,
}

impl SourceKind for KittiRaw {
    type Params = KittiRawParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI raw: drives of rectified stereo pairs, with projected laser scans as truth.",
            doc: "\
Layout (Geiger, Lenz, Stiller, Urtasun, *Vision meets Robotics: The KITTI Dataset*, 2013; \"synced+rectified\"): \
`<root>/<date>/<drive>_sync/image_02/data/%010d.png` (left; `image_00` of the grey cameras), `image_03` (right), `velodyne_points/data/%010d.bin`, \
`image_02/timestamps.txt`; in `<root>/<date>` `calib_cam_to_cam.txt` and `calib_velo_to_cam.txt`. Images may be JPEG.\n\n\
A frame's id is drive and number (`2011_09_26_drive_0002_sync_0000000001`), its time the left camera's, else 10 Hz.\n\n\
Truth is sparse: a scan's points through `P_rect_02 R_rect_00 [R|T]`. Points in front of the camera are kept, each at the nearest pixel (half to even), \
the nearest point wins a pixel. `compat: monodepth2` has the rules of that repository's `generate_depth_map`, which much published work is scored with: points \
with x >= 0 of the scanner, a pixel less in row and column, duplicates by `row * (width - 1) + column - 1`; `monodepth2-eigen` with the scanner's x as depth, \
as the truth of the Eigen split is exported. A frame without a scan has no truth.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left image, 8 bit, with its file's bytes."),
                Port::frame("right", ValueType::Image, "Right image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline."),
                Port::frame(
                    "depth",
                    ValueType::Depth,
                    "Sparse true depth, metres, NaN = unknown; absent without a scan.",
                )
                .optional(),
            ],
        }
    }

    fn check(params: &KittiRawParams) -> Result<(), (&'static str, String)> {
        if params.root.path().as_os_str().is_empty() {
            return Err(("root", format!("root is missing: {LAYOUT}")));
        }
        if params.split.is_some() && !params.drives.is_empty() {
            return Err(("drives", "a split names the drive of each frame: give one of both".to_owned()));
        }
        if params.compat != Compat::None
            && (params.truth, params.cameras) != (KittiRawTruth::Velodyne, KittiCameras::Color)
        {
            return Err((
                "compat",
                "monodepth2 projects scans into the colour camera: `truth: velodyne`, `cameras: color`".to_owned(),
            ));
        }
        Ok(())
    }

    fn open(params: KittiRawParams) -> Result<Box<dyn Source>, Fault> {
        let (listing, layout) = listed(&params)?;
        listing.open(layout)
    }

    fn survey(params: KittiRawParams) -> Survey {
        survey(listed(&params))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        // A drive's own folder stands for the drive in the folder above.
        let name = root.file_name().map(|name| name.to_string_lossy().into_owned()).filter(|name| is_drive(name));
        if let (Some(name), Some(above)) = (name, root.parent()) {
            let cameras = [("image_02", "color"), ("image_00", "grey")];
            let cameras = cameras.into_iter().filter(|(camera, _)| root.join(camera).join("data").is_dir());
            return cameras
                .map(|(_, cameras)| {
                    let params = json!({ "root": above, "drives": [name], "cameras": cameras });
                    Recognised::new(format!("KITTI raw, 1 drive, {cameras} cameras"), params)
                })
                .collect();
        }
        let found = drives(root).unwrap_or_default();
        let has = |camera: &str| found.values().any(|drive| drive.folder.join(camera).is_dir());
        let cameras = [("image_02", "color"), ("image_00", "grey")].into_iter().filter(|(camera, _)| has(camera));
        let count = counted(found.len(), "drive");
        cameras
            .map(|(_, cameras)| {
                let what = format!("KITTI raw, {count}, {cameras} cameras");
                Recognised::new(what, json!({ "root": root, "cameras": cameras }))
            })
            .collect()
    }
}

fn listed(params: &KittiRawParams) -> Result<(Listing, KittiRaw), Fault> {
    Ok((list(params)?, KittiRaw { cameras: params.cameras, compat: params.compat }))
}

#[derive(Clone)]
struct Drive {
    name: String,
    date: PathBuf,
    folder: PathBuf,
}

fn is_drive(name: &str) -> bool {
    name.contains("_drive_") && name.ends_with("_sync")
}

fn drives(root: &Path) -> Result<BTreeMap<String, Drive>, Fault> {
    if !root.is_dir() {
        return Err(no_folder(root, LAYOUT));
    }
    let within = folders(root, LAYOUT)?;
    let is_date = root.join("calib_cam_to_cam.txt").is_file() || within.iter().any(|name| is_drive(name));
    let dates = match is_date {
        true => vec![root.to_owned()],
        false => within.into_iter().map(|date| root.join(date)).collect(),
    };
    let mut drives = BTreeMap::new();
    for date in dates {
        for name in folders(&date, LAYOUT)?.into_iter().filter(|name| is_drive(name)) {
            drives.insert(name.clone(), Drive { folder: date.join(&name), date: date.clone(), name });
        }
    }
    match drives.is_empty() {
        true => Err(Fault::new(format!("{} holds no drive", root.display())).remedy(LAYOUT)),
        false => Ok(drives),
    }
}

/// With or without `_sync`, or a path that ends in it.
pub(super) fn drive_named<'a, T>(drives: &'a BTreeMap<String, T>, name: &str) -> Result<(&'a String, &'a T), Fault> {
    let name = name.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
    let full = if name.ends_with("_sync") { name.to_owned() } else { format!("{name}_sync") };
    drives.get_key_value(&full).ok_or_else(|| {
        let there = drives.keys().take(4).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = drives.len().saturating_sub(4);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Fault::new(format!("there is no drive {name}")).remedy(format!("there are {there}{more}"))
    })
}

/// Listed once per drive.
struct Held {
    lefts: BTreeMap<String, PathBuf>,
    rights: BTreeMap<String, PathBuf>,
    scans: BTreeMap<String, PathBuf>,
    times: Vec<u64>,
    clock: PathBuf,
}

impl Held {
    fn of(drive: &Drive, params: &KittiRawParams) -> Result<Self, Fault> {
        let [left, right] = params.cameras.folders();
        let scans = drive.folder.join("velodyne_points").join("data");
        let wants_scans = params.truth == KittiRawTruth::Velodyne;
        let clock = drive.folder.join(left).join("timestamps.txt");
        Ok(Self {
            lefts: stems(&drive.folder.join(left).join("data"), &IMAGES, LAYOUT)?,
            rights: stems(&drive.folder.join(right).join("data"), &IMAGES, LAYOUT)?,
            scans: if wants_scans && scans.is_dir() { stems(&scans, &["bin"], LAYOUT)? } else { BTreeMap::new() },
            times: if clock.is_file() { time::read(&clock)? } else { Vec::new() },
            clock,
        })
    }
}

fn list(params: &KittiRawParams) -> Result<Listing, Fault> {
    let all = drives(params.root.path())?;
    let mut held: HashMap<String, Held> = HashMap::new();
    // Every frame there is: its drive, and its stem.
    let mut there: Vec<Named<'_>> = Vec::new();
    let mut listing = Listing::default();
    if let Some(split) = &params.split {
        let (frames, twice) = frames_of_split(split.path(), &all)?;
        listing.warnings.extend((twice > 0).then(|| {
            format!(
                "{} names frames again, of the other camera or the same, on {twice} of its lines: each pair is taken once",
                split.path().display()
            )
        }));
        if frames.is_empty() {
            return Err(Fault::new(format!("{} names no frame", split.path().display())).remedy(SPLIT));
        }
        for (drive, stem) in frames {
            if !held.contains_key(&drive.name) {
                held.insert(drive.name.clone(), Held::of(drive, params)?);
            }
            there.push((drive, stem));
        }
    } else {
        let chosen: Vec<&Drive> = match params.drives.is_empty() {
            true => all.values().collect(),
            false => params
                .drives
                .iter()
                .map(|name| drive_named(&all, name).map(|(_, drive)| drive))
                .collect::<Result<_, _>>()?,
        };
        for drive in chosen {
            let holds = Held::of(drive, params)?;
            let mut stems: Vec<&String> = holds.lefts.keys().collect();
            stems.sort_by(|a, b| natural_text(a, b));
            there.extend(stems.into_iter().map(|stem| (drive, stem.clone())));
            if held.insert(drive.name.clone(), holds).is_some() {
                return Err(Fault::new(format!("drive {} is named twice", drive.name)));
            }
        }
    }
    if there.is_empty() {
        return Err(Fault::new(format!("{} holds no image", params.root.path().display())).remedy(LAYOUT));
    }
    // One drive's frames have KITTI's own numbers.
    let one = params.split.is_none() && held.len() == 1;
    let numbers = if one { numbered(there.iter().map(|(_, stem)| stem.as_str())) } else { None };
    let number = |count: usize| numbers.as_ref().map_or(count as u64, |numbers| numbers[count]);
    let ids: Vec<(u64, String)> = there
        .iter()
        .enumerate()
        .map(|(count, (drive, stem))| (number(count), format!("{}_{stem}", drive.name)))
        .collect();
    let known: Vec<(u64, &str)> = ids.iter().map(|(index, id)| (*index, id.as_str())).collect();
    let mut without_scan = 0;
    for at in params.frames.select(&known)? {
        let (drive, stem) = &there[at];
        let holds = &held[&drive.name];
        without_scan += usize::from(!holds.scans.contains_key(stem));
        let of_drive = stem.parse::<usize>().ok();
        let (index, id) = known[at];
        let frame = time::frame(id, index, of_drive, &holds.times, &holds.clock)?;
        listing.gather(frame, gathered(params, drive, holds, stem));
    }
    listing.warnings.extend(params.frames.left_out(&known));
    if params.truth == KittiRawTruth::Velodyne && without_scan > 0 {
        let of = listing.entries.len();
        listing.warnings.push(format!("{without_scan} of {of} frames have no laser scan, and so no truth"));
    }
    Ok(listing)
}

fn gathered(params: &KittiRawParams, drive: &Drive, holds: &Held, stem: &str) -> Gathered {
    let find = |folder: &str, files: &BTreeMap<String, PathBuf>| {
        let remedy = "each left image needs its right one, of the same number (KITTI: unpack the drive again)";
        let missing = || no_file(&drive.folder.join(folder).join("data").join(format!("{stem}.png")), remedy);
        files.get(stem).cloned().ok_or_else(missing)
    };
    let of_date = |name: &str| {
        let path = drive.date.join(name);
        let remedy = "each date has its own calibration files (KITTI: unpack the date's calibration zip)";
        if path.is_file() { Ok(path) } else { Err(no_file(&path, remedy)) }
    };
    let [left, right] = params.cameras.folders();
    let mut files = Gathered::default();
    files.take(LEFT, find(left, &holds.lefts));
    files.take(RIGHT, find(right, &holds.rights));
    files.take(CALIBRATION, of_date("calib_cam_to_cam.txt"));
    if let Some(scan) = holds.scans.get(stem) {
        files.take(SCANNER, of_date("calib_velo_to_cam.txt"));
        files.take(SCAN, Ok(scan.clone()));
    }
    files
}

type Named<'a> = (&'a Drive, String);

/// Each pair once, in the file's order, and the number of lines that repeat one.
fn frames_of_split<'a>(path: &Path, drives: &'a BTreeMap<String, Drive>) -> Result<(Vec<Named<'a>>, usize), Fault> {
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let bytes = regular_file::read(path, MOST_BYTES).map_err(failed)?;
    let (mut frames, mut seen, mut twice) = (Vec::new(), std::collections::HashSet::new(), 0);
    for (index, line) in String::from_utf8_lossy(&bytes).lines().enumerate() {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let at = |what: String| Fault::new(format!("{}:{}: {what}", path.display(), index + 1));
        let mut words = line.split_whitespace();
        let first = words.next().unwrap_or_default();
        let named = first.split('/').find(|part| part.contains("_drive_"));
        let is_image = first.rsplit_once('.').is_some_and(|(_, ending)| IMAGES.contains(&ending));
        let number =
            if is_image { first.rsplit('/').next().and_then(|name| name.split('.').next()) } else { words.next() };
        let number = number.and_then(|number| number.parse::<u64>().ok());
        let (Some(named), Some(number)) = (named, number) else {
            return Err(at(format!("`{line}` names no frame")).remedy(SPLIT));
        };
        let drive = drive_named(drives, named)
            .map(|(_, drive)| drive)
            .map_err(|fault| fault.map_what(|what| format!("{}:{}: {what}", path.display(), index + 1)))?;
        let stem = format!("{number:010}");
        if seen.insert((drive.name.as_str(), number)) {
            frames.push((drive, stem));
        } else {
            twice += 1;
        }
    }
    Ok((frames, twice))
}

impl Layout for KittiRaw {
    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn meaning(&self) -> String {
        format!("{:?} {}", self.cameras, self.compat.name())
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let camera = files.the(CALIBRATION)?;
        let text = camera.text();
        let lines = Lines::of(&camera.path, &text, CAMERAS)?;
        let calibration = calibration(&lines, self.cameras, size)?;
        let mut outputs = Outputs::one("left", left).with("right", right).with("calibration", calibration);
        if let Some(scan) = files.get(SCAN) {
            let projection = projection(&lines, files.the(SCANNER)?, self.cameras)?;
            outputs = outputs.with("depth", depth(scan, &projection, size, self.compat.rule())?);
        }
        Ok(outputs)
    }
}

pub(super) fn calibration(lines: &Lines<'_>, cameras: KittiCameras, size: (u32, u32)) -> Result<Calibration, Fault> {
    let (line, [width, height]) = lines.numbers::<2>(cameras.size())?;
    if (width, height) != (f64::from(size.0), f64::from(size.1)) {
        let what = format!("{} says {width}x{height}, and the image is {}x{}", cameras.size(), size.0, size.1);
        return Err(lines.fault(Some(line), what).remedy("take image and calibration of one date"));
    }
    calibration::pair(lines, cameras.projections(), size)
}

/// From the scanner to the left image: `P_rect R_rect_00 [R|T]`, 3x4, row-major.
fn projection(lines: &Lines<'_>, scanner: &File, cameras: KittiCameras) -> Result<[f64; 12], Fault> {
    let text = scanner.text();
    let scanner = Lines::of(&scanner.path, &text, SCANNERS)?;
    let ((_, r), (_, t)) = (scanner.numbers::<9>("R")?, scanner.numbers::<3>("T")?);
    let (_, rectify) = lines.numbers::<9>("R_rect_00")?;
    let (_, p) = lines.numbers::<12>(cameras.projections()[0])?;
    // Rectified camera coordinates from the scanner's, 4x4 without its last row.
    let mut turned = [0.0; 12];
    for (row, column) in (0..3).flat_map(|row| (0..4).map(move |column| (row, column))) {
        let of = |k: usize| if column == 3 { t[k] } else { r[3 * k + column] };
        turned[4 * row + column] = (0..3).map(|k| rectify[3 * row + k] * of(k)).sum();
    }
    let mut projection = [0.0; 12];
    for (row, column) in (0..3).flat_map(|row| (0..4).map(move |column| (row, column))) {
        let last = if column == 3 { p[4 * row + 3] } else { 0.0 };
        projection[4 * row + column] = (0..3).map(|k| p[4 * row + k] * turned[4 * k + column]).sum::<f64>() + last;
    }
    Ok(projection)
}

/// Little-endian f32, four per point.
fn depth(scan: &File, projection: &[f64; 12], size: (u32, u32), rule: Rule) -> Result<Depth, Fault> {
    let (points, rest) = scan.bytes.as_chunks::<16>();
    if !rest.is_empty() {
        let what = format!("{} bytes are no whole number of points of 16 bytes", scan.bytes.len());
        return Err(scan.fault(what).remedy("the scan was cut short: copy or unpack it again"));
    }
    let float =
        |point: &[u8; 16], at: usize| f32::from_le_bytes([point[at], point[at + 1], point[at + 2], point[at + 3]]);
    let points = points.iter().map(|point| [0, 4, 8, 12].map(|at| float(point, at)));
    let metres = filled(size, |out| {
        depth_from_points(points, projection, (size.0 as usize, size.1 as usize), rule, out);
    });
    Ok(Depth { metres })
}
