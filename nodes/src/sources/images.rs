//! `images`: your own pairs, or images of a single camera.

mod globs;
mod pairs;
mod recognise;
mod sides;
mod truth;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{
    DataPath, Frame, FrameSelection, Recognised, SourceDeclaration, Survey, SwitchedOff,
};
use depthloom_graphs::values::{Calibration, Depth, Image, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs, Port, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::globs::{Match, files as files_of_pattern};
use self::pairs::{Pairs, by_list, by_names, list_has_pairs};
use self::truth::{ImagesTruth, TruthOf, TruthUnit};
use crate::sources::calibration::camera_files::{self, CameraPair, FORMS};
use crate::sources::calibration::rectified_pair::{check_plausible, middle};
use crate::sources::calibration::rectifier::{LatestRectifier, RectifyOptions, Sampling};
use crate::sources::dataset::folders::{existing_file, existing_folder};
use crate::sources::dataset::frame_files::{File, Files, LEFT, Part, RIGHT, TRUTH};
use crate::sources::dataset::{DatasetKind, FrameFiles, Listing, depth_port, image_port, required};
use crate::sources::evaluation::with_optional;
use crate::sources::files::{self, image_file};
use crate::sources::true_disparity;

const KIND: &str = "images";
const VERSION: u32 = 2;
const LAYOUT: &str =
    "root is the folder to which `left`, `right`, `list`, ground-truth and calibration files are relative";

const CALIBRATIONS: [Part; 4] = ["calibration", "calibration_2", "calibration_3", "calibration_4"];

/// Cameras: numbers of a rectified pair, or files.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ImagesCalibration {
    /// Focal length of the rectified pair or of the single camera, px.
    #[schemars(extend("minimum" = 1, "maximum" = 1_000_000))]
    pub focal_px: Option<f64>,
    /// Distance between the cameras' centres, metres. Optional without right images; then no disparity has a depth.
    #[schemars(extend("minimum" = 0.0001, "maximum" = 10_000))]
    pub baseline_m: Option<f64>,
    /// Column of the principal point, px; (0, 0) is the centre of the first pixel. The default is the centre of the
    /// image.
    pub cx_px: Option<f64>,
    /// Row of the principal point, px; as `cx_px`.
    pub cy_px: Option<f64>,
    /// Column of the right camera's principal point minus that of the left, px (Middlebury's `doffs`): depth is `f *
    /// B / (d + doffs)`.
    #[schemars(range(min = -100_000, max = 100_000))]
    pub doffs_px: f64,
    /// Calibration files, relative to `root`: OpenCV's FileStorage (YAML, XML or JSON, one file or two), two
    /// `camera_info` YAML files of ROS (left, right), or a camchain of Kalibr.
    pub files: Vec<String>,
    /// Length of one unit of translation in the files, metres: 0.001 for millimetres. The default is metres; then a
    /// baseline above 2 m is refused.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub metres_per_unit: Option<f64>,
    /// Whether the images are already rectified. If so, only the projections of the files are used.
    pub rectified: bool,
    /// Whether the lens coefficients of an OpenCV file belong to its `fisheye` module. The file does not contain this
    /// information.
    pub fisheye: bool,
    /// Recomputes the rectification, even if the files contain one, with `alpha` of `stereoRectify`: 0 (no black
    /// pixels) to 1 (no pixel is lost), or -1 (the focal length is kept).
    #[schemars(extend("minimum" = -1, "maximum" = 1))]
    pub alpha: Option<f64>,
    /// Precision of positions between pixels in rectification: `float` (as OpenCV 5 with `CV_32FC1` maps) or `fixed`
    /// (1/32 px, as OpenCV 4).
    pub sampling: Sampling,
}

impl ImagesCalibration {
    fn is_given(&self) -> bool {
        self.focal_px.is_some() || self.baseline_m.is_some() || !self.files.is_empty()
    }
}

/// Parameters of `images`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ImagesParams {
    /// Folder to which all other paths are relative.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Pattern of the left images. `*` stands for any text within a name: `cam0/*.png`, `*_left.png`.
    pub left: Option<String>,
    /// Pattern of the right images: `cam1/*.png`, `*_right.png`. Leave it out for a single camera; the output `right`
    /// does not exist then.
    pub right: Option<String>,
    /// CSV file that replaces `left` and `right`: columns left[,right][,ground_truth][,frame], one row per frame.
    pub list: Option<String>,
    /// Cameras: numbers of a rectified pair (`focal_px`, `baseline_m`), or `files`. Without it there is no output
    /// `calibration`.
    pub calibration: ImagesCalibration,
    /// Number of bits that the samples of 16-bit images use: 12 for a 12-bit camera that stores numbers up to 4095.
    /// The upper 8 of them are used. The default is 16, as in OpenCV's `imread`.
    #[schemars(range(min = 8, max = 16))]
    pub bits: Option<u32>,
    /// Ground truth: the files and the meaning of their numbers.
    pub ground_truth: ImagesTruth,
    /// Selected frames, by their position in the order of names, or of the list, from 0. All by default.
    pub frames: FrameSelection,
}

pub(crate) struct Images {
    calibration: Cameras,
    options: RectifyOptions,
    bits: Option<u32>,
    truth: ImagesTruth,
    meaning: String,
    rectifier: LatestRectifier,
}

enum Cameras {
    Unknown,
    Numbers { focal_px: f64, baseline_m: f64, centre_px: [Option<f64>; 2], doffs_px: f64 },
    Files { pair: Box<CameraPair>, bytes: Vec<(PathBuf, Arc<[u8]>)> },
}

impl DatasetKind for Images {
    type Params = ImagesParams;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "Your own images, pairs or of a single camera: file patterns or a list, calibration, ground truth.",
            doc: "\
**Images** are PNG, JPEG, WebP, TIFF or PNM with 8 or 16 bits, decoded to the pixels of OpenCV's `imread` (the EXIF \
orientation is applied). Two patterns find them (`left: cam0/*.png`, `right: cam1/*.png`), or a CSV list names them. \
Images of a single camera have only `left`.\n\n\
**Pairs.** Two files form a pair if `*` stands for the same text in both. If no two files match in this way, files \
pair if the numbers in that text are equal. If that matches none either, files pair by order, with a warning; this \
is refused if the counts differ or if numbers (times) contradict it. Numbers in names sort as numbers: 9 before 10. \
The id of a frame is the text that `*` stands for, or the column `frame` of the list. Its index is its position from \
0.\n\n\
**Calibration** is given as numbers of a rectified pair, or as files:\n\n\
- OpenCV: `M1`, `D1`, `M2`, `D2` with `R1`, `R2`, `P1`, `P2`. With `R` and `T` instead, depthloom computes these \
(`stereoRectify` with `CALIB_ZERO_DISPARITY`).\n\
- ROS: two `camera_info` files with `plumb_bob`, `rational_polynomial` or `equidistant`.\n\
- Kalibr: `cam0`, `cam1` with `radtan` or `equidistant`.\n\n\
A single camera is calibrated with numbers: `focal_px`, and `cx_px`, `cy_px` where they are known. Without `baseline_m`, nodes \
that convert between disparity and depth refuse the calibration.\n\n\
If the cameras have distortion or rotation, and `rectified` is not set, pairs are rectified when they are read, as \
OpenCV's `initUndistortRectifyMap` and `remap` (linear) do. Pixels outside the camera's image are black. The size \
does not change.\n\n\
**Ground truth** is 8- or 16-bit PNG or TIFF, 32-bit float TIFF, PFM, NPY, NPZ or EXR, with the size of the left image. It is \
depth along the optical axis or disparity, see `ground_truth.unit` and `ground_truth.divide_by`. Values that are 0, negative, \
infinite or NaN are unknown. The depth of a disparity `d` is `f * B / (d + doffs)`.",
            outputs: outputs([true; 3], Some(true)),
        }
    }

    fn check(params: &ImagesParams) -> Result<(), (&'static str, String)> {
        let ImagesParams { root, left, right, list, calibration, ground_truth, .. } = params;
        required("root", root, LAYOUT)?;
        match (list, left, right) {
            (None, Some(_), _) => {}
            (Some(_), None, None) if ground_truth.files.is_none() => {}
            (Some(_), None, None) => {
                let what = "`ground_truth.files` cannot be combined with `list`: name the ground-truth files in the column `ground_truth` of the list";
                return Err(("ground_truth", what.to_owned()));
            }
            (Some(_), ..) => {
                return Err(("list", "list cannot be combined with `left` and `right`: use one of the two".to_owned()));
            }
            (None, None, None) => {
                let what = "left is missing: set e.g. `left: cam0/*.png` and, for pairs, `right: cam1/*.png`, or `list: pairs.csv`";
                return Err(("left", what.to_owned()));
            }
            (None, None, Some(_)) => {
                let what =
                    "`left` is missing: a pair needs both `left` and `right`; the images of a single camera are `left`";
                return Err(("left", what.to_owned()));
            }
        }
        let numbers = calibration.focal_px.is_some() || calibration.baseline_m.is_some();
        let centre = calibration.cx_px.is_some() || calibration.cy_px.is_some() || calibration.doffs_px != 0.0;
        if !calibration.files.is_empty() && (numbers || centre) {
            return Err(("calibration", "numbers cannot be combined with `files`: use one of the two".to_owned()));
        }
        if calibration.files.len() > CALIBRATIONS.len() {
            return Err(("calibration", format!("a calibration has at most {} files", CALIBRATIONS.len())));
        }
        if (numbers || centre) && calibration.focal_px.is_none() {
            let what = "a calibration in numbers needs `focal_px`, and for pairs `baseline_m`";
            return Err(("calibration", what.to_owned()));
        }
        if calibration.rectified && calibration.alpha.is_some() {
            return Err(("calibration", "what is `rectified` already has no `alpha`".to_owned()));
        }
        match has_pairs(params) {
            Some(true) if numbers && calibration.baseline_m.is_none() => {
                let what = "a calibration of pairs in numbers needs `focal_px` and `baseline_m`";
                Err(("calibration", what.to_owned()))
            }
            Some(false) if !calibration.files.is_empty() => {
                let what = "`files` calibrate pairs, and there is no `right`: set `focal_px` and, where known, `cx_px` and `cy_px`";
                Err(("calibration", what.to_owned()))
            }
            Some(false) if calibration.rectified || calibration.doffs_px != 0.0 && calibration.baseline_m.is_none() => {
                let what = "`rectified` and `doffs_px` are of pairs, and there is no `right`: leave them out";
                Err(("calibration", what.to_owned()))
            }
            _ => Ok(()),
        }
    }

    fn switched_off(params: &ImagesParams) -> Vec<SwitchedOff> {
        if has_pairs(params) != Some(false) {
            return Vec::new();
        }
        let remedy = match &params.list {
            Some(list) => format!("add the column `right` to {list}"),
            None => "set `right` in the source: the pattern of the right images".to_owned(),
        };
        vec![SwitchedOff { output: "right", why: "the images are of a single camera".to_owned(), remedy }]
    }

    fn outputs(params: &ImagesParams) -> Result<Vec<Port>, Fault> {
        let has_truth = params.ground_truth.files.is_some() || params.list.is_some();
        let truth = has_truth.then_some(params.ground_truth.unit == TruthUnit::Pixels);
        let calibration = &params.calibration;
        let has_baseline = calibration.baseline_m.is_some() || !calibration.files.is_empty();
        Ok(outputs([has_pairs(params) != Some(false), calibration.is_given(), has_baseline], truth))
    }

    fn list(params: &ImagesParams) -> Result<(Listing, Self), Fault> {
        let first = |mut faults: Vec<Fault>| faults.swap_remove(0);
        let images = Self::new(params).map_err(first)?;
        Ok((images.list_frames(params).map_err(first)?, images))
    }

    fn survey(params: &ImagesParams) -> Survey {
        let (images, calibration_faults) = match Self::new(params) {
            Ok(images) => (Ok(images), Vec::new()),
            // Other faults are found without a calibration.
            Err(faults) => {
                let params = ImagesParams { calibration: ImagesCalibration::default(), ..params.clone() };
                (Self::new(&params), faults)
            }
        };
        let survey = match images.and_then(|images| Ok((images.list_frames(params)?, images))) {
            Ok((listing, images)) => listing.survey(images),
            Err(faults) => Survey { source: None, faults, facts: Vec::new() },
        };
        Survey { faults: calibration_faults.into_iter().chain(survey.faults).collect(), ..survey }
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        recognise::recognise(root)
    }

    fn meaning(&self) -> String {
        self.meaning.clone()
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = match files.get(RIGHT) {
            Some(_) => files.pair_of_bits(self.bits, ctx).map(|(left, right)| (left, Some(right)))?,
            None => (files.left_of_bits(self.bits, ctx)?, None),
        };
        let size = left.dimensions();
        let (calibration, is_moved, (left, right)) = self.calibrated(files, (left, right))?;
        let mut outputs = with_optional(Outputs::one("left", left), "right", right);
        if let Some(file) = files.get(TRUTH) {
            if is_moved && self.truth.of == TruthOf::Left {
                let what = format!(
                    "{} is ground truth of the left image in its file, but pairs are rectified when they are read",
                    file.path.display()
                );
                return Err(Fault::new(what).remedy(
                    "ground truth must belong to the rectified left image: set `ground_truth: { of: rectified }` if it does, otherwise remove `truth`",
                ));
            }
            let numbers = self.truth_numbers(file, ctx)?;
            files.same_size_as_left(size, file, numbers.dimensions())?;
            let numbers = self.truth.numbers(&numbers);
            if self.truth.unit == TruthUnit::Pixels {
                let truth = TrueDisparity { px: numbers };
                let of_pair = calibration.as_ref().filter(|calibration| !calibration.is_single_camera());
                let depth = of_pair.map(|calibration| true_disparity::depth(&truth, calibration));
                outputs = with_optional(outputs, "depth", depth).with("disparity", truth);
            } else {
                outputs = outputs.with("depth", Depth { metres: numbers });
            }
        }
        Ok(with_optional(outputs, "calibration", calibration))
    }
}

/// `None` if that is not known, because the list cannot be read.
fn has_pairs(params: &ImagesParams) -> Option<bool> {
    match &params.list {
        Some(list) => list_has_pairs(&params.root.path().join(list)),
        None => Some(params.right.is_some()),
    }
}

fn outputs([pairs, calibration, baseline]: [bool; 3], truth: Option<bool>) -> Vec<Port> {
    let mut ports = vec![image_port(
        "left",
        "Left image, 8 bit; with the bytes of its file if it is unchanged. The image of a single camera.",
    )];
    if pairs {
        ports.push(image_port(
            "right",
            "Right image, 8 bit, same size as `left`; with the bytes of its file if it is unchanged. Absent for a single camera.",
        ));
    }
    if calibration {
        let doc = "Focal length, principal point, baseline of the rectified pair; with the parameter `calibration`.";
        ports.push(Port::frame("calibration", ValueType::Calibration, doc).optional());
    }
    if truth.is_some_and(|is_disparity| baseline || !is_disparity) {
        ports.push(
            depth_port("Ground-truth depth, metres, NaN = unknown; absent if a frame has no ground truth.").optional(),
        );
    }
    if truth == Some(true) {
        let doc = "Ground-truth disparity, px, NaN = unknown; with `ground_truth.unit: pixels`.";
        ports.push(Port::frame("disparity", ValueType::TrueDisparity, doc).optional());
    }
    ports
}

impl Images {
    fn new(params: &ImagesParams) -> Result<Self, Vec<Fault>> {
        let given = &params.calibration;
        let calibration = match (given.focal_px, given.files.is_empty()) {
            (Some(focal_px), _) => {
                let (baseline_m, centre_px) = (given.baseline_m.unwrap_or(0.0), [given.cx_px, given.cy_px]);
                Cameras::Numbers { focal_px, baseline_m, centre_px, doffs_px: given.doffs_px }
            }
            (None, true) => Cameras::Unknown,
            (None, false) => {
                let (mut bytes, mut faults) = (Vec::new(), Vec::new());
                for name in &given.files {
                    let path = existing_file(params.root.path().join(name), &format!("{LAYOUT}; {FORMS}"));
                    match path.and_then(|path| image_file::read(&path).map(|bytes| (path, bytes))) {
                        Ok(file) => bytes.push(file),
                        Err(fault) => faults.push(fault),
                    }
                }
                if !faults.is_empty() {
                    return Err(faults);
                }
                let texts: Vec<_> = bytes.iter().map(|(path, bytes)| (path.as_path(), &**bytes)).collect();
                let pair = camera_files::read(&texts, given.fisheye).map_err(|fault| vec![fault])?;
                Cameras::Files { pair: Box::new(pair), bytes }
            }
        };
        let options = RectifyOptions {
            rectified: given.rectified,
            alpha: given.alpha,
            sampling: given.sampling,
            metres_per_unit: given.metres_per_unit,
        };
        // The content of files decides, not their paths.
        let meaning = {
            let calibration = ImagesCalibration { files: Vec::new(), ..given.clone() };
            let truth = ImagesTruth { files: None, ..params.ground_truth.clone() };
            format!("{calibration:?} {truth:?} {:?}", params.bits)
        };
        let (bits, truth) = (params.bits, params.ground_truth.clone());
        Ok(Self { calibration, options, bits, truth, meaning, rectifier: LatestRectifier::default() })
    }

    fn list_frames(&self, params: &ImagesParams) -> Result<Listing, Vec<Fault>> {
        let root = params.root.path();
        existing_folder(root, LAYOUT).map_err(|fault| vec![fault])?;
        let Pairs { rows, faults, warnings, unpaired } = match (&params.list, &params.left, &params.right) {
            (Some(list), ..) => by_list(root, &root.join(list)).map_err(|fault| vec![fault])?,
            (None, left, right) => by_names(
                root,
                &left.clone().unwrap_or_default(),
                right.as_deref(),
                params.ground_truth.files.as_deref(),
            )?,
        };
        let mut listing = Listing::default();
        (listing.faults, listing.warnings, listing.unpaired) = (faults, warnings, unpaired);
        if rows.is_empty() {
            return Ok(listing);
        }
        let known: Vec<(u64, &str)> = (0..).zip(rows.iter().map(|row| row.id.as_str())).collect();
        let chosen = params.frames.select(&known).map_err(|fault| vec![fault])?;
        listing.warnings.extend(params.frames.left_out(&known));
        let mut rows: Vec<_> = rows.into_iter().map(Some).collect();
        for at in chosen {
            let Some(row) = rows[at].take() else { continue };
            let mut files = FrameFiles::default();
            files.add(LEFT, Ok(row.left));
            if let Some(right) = row.right.transpose() {
                files.add(RIGHT, right);
            }
            if let Cameras::Files { bytes, .. } = &self.calibration {
                for (part, (path, _)) in CALIBRATIONS.into_iter().zip(bytes) {
                    files.add(part, Ok(path.clone()));
                }
            }
            if let Some(truth) = row.truth.transpose() {
                files.add(TRUTH, truth);
            }
            listing.add(Frame::at_10_hz(row.id.as_str(), at as u64), files);
        }
        Ok(listing)
    }

    /// The flag is set if a rectification moved pixels.
    fn calibrated(&self, files: &Files, pair: Pair) -> Result<(Option<Calibration>, bool, Pair), Fault> {
        let size = pair.0.dimensions();
        match &self.calibration {
            Cameras::Unknown => Ok((None, false, pair)),
            Cameras::Numbers { focal_px, baseline_m, centre_px: [cx, cy], doffs_px } => {
                let middle = middle(size);
                let calibration = Calibration {
                    width: size.0,
                    height: size.1,
                    focal_px: *focal_px,
                    cx_px: cx.unwrap_or(middle.0),
                    cy_px: cy.unwrap_or(middle.1),
                    baseline_m: *baseline_m,
                    doffs_px: *doffs_px,
                };
                // A single camera has no baseline to check.
                let baseline_m = if calibration.is_single_camera() { 1.0 } else { calibration.baseline_m };
                check_plausible(&Calibration { baseline_m, ..calibration.clone() })
                    .map_err(|wrong| Fault::new(format!("the calibration cannot be: {}", wrong.what)))?;
                Ok((Some(calibration), false, pair))
            }
            Cameras::Files { pair: cameras, bytes } => {
                for (part, (path, known)) in CALIBRATIONS.into_iter().zip(bytes) {
                    if files.required(part)?.bytes != *known {
                        let what = format!("{} changed while it was read from", path.display());
                        return Err(Fault::new(what).remedy("run again"));
                    }
                }
                let rectifier = self.rectifier.get(cameras, &self.options, size).map_err(|error| {
                    let named: Vec<String> = bytes.iter().map(|(path, _)| path.display().to_string()).collect();
                    Fault::Failed(error).map_what(|what| format!("{}: {what}", named.join(", ")))
                })?;
                let pair = match pair {
                    (left, Some(right)) => {
                        let (left, right) = rectifier.pair(left, right);
                        (left, Some(right))
                    }
                    single => single,
                };
                Ok((Some(rectifier.calibration.clone()), rectifier.moves_pixels(), pair))
            }
        }
    }

    fn truth_numbers(&self, file: &File, ctx: &Context<'_>) -> Result<Raster<f32>, Fault> {
        let (numbers, bits) = files::numbers(&file.path, &file.bytes, None)?;
        if bits == 8 && self.truth.is_of_more_bits() {
            let most = 255.0 / self.truth.divide_by;
            let what = format!("the file has 8 bits, and no number in it is above {most} {}", self.truth.unit.name());
            return Err(file.fault(what).remedy(
                "expected 16 bits: an image tool may have saved the file with 8 bits; use the original file, or describe its numbers \
                 with `ground_truth.unit` and `ground_truth.divide_by`",
            ));
        }
        if let Some(warning) = self.truth.warning_of_8_bits().filter(|_| bits == 8) {
            ctx.host.warn(warning);
        }
        Ok(numbers)
    }
}

/// A left image, and the right one if there is any.
type Pair = (Image, Option<Image>);
