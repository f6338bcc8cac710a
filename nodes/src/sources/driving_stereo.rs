//! `drivingstereo`: the DrivingStereo data set, as unpacked.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::{Calibration, Depth, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs, Port, ValueType};
use depthloom_kernels::depth::truth_from_depth_png;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::filled;
use crate::sources::calibration::rectified_pair::check_plausible;
use crate::sources::dataset::folders::{
    existing_file, existing_folder, existing_with_ending, folders, missing_folder, stems,
};
use crate::sources::dataset::frame_files::{CALIBRATION, File, Files, LEFT, Part, RIGHT, TRUTH};
use crate::sources::dataset::{DatasetKind, Listing, depth_port, image_port, recognised, required, truth_off};
use crate::sources::evaluation::{Evaluation, with_optional};
use crate::sources::files::named_lines::NamedLines;
use crate::sources::true_disparity;

const KIND: &str = "drivingstereo";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds left-image-half-size, right-image-half-size and disparity-map-half-size or depth-map-half-size (a weather; or full-size), \
train-left-image, train-right-image, ..., or test-left-image, ...; images are in these folders or in one subfolder per sequence";
const WANTED: &str = "a calibration has the lines `P_rect_101:` (left) and `P_rect_103:` (right), 12 numbers each, px, and `T_103:`, 3 numbers, metres: take it from \
half-image-calib or full-image-calib, as the images' size is";

const DEPTH: Part = "depth";

/// Size of the images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DrivingStereoSize {
    /// 881 x 400.
    #[default]
    Half,
    /// 1762 x 800.
    Full,
}

/// Which pixels are true.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DrivingStereoTruth {
    /// All pixels that the laser scanners hit.
    #[default]
    All,
    /// Ground truth is not read, even if it exists.
    None,
}

/// Parameters of `drivingstereo`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct DrivingStereo {
    /// Folder that contains the folders of images: of a weather subset, the training set or the test set.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Size of the images: `half` or `full`.
    pub size: DrivingStereoSize,
    /// Folder of calibrations, `half-image-calib` or `full-image-calib`. By default depthloom searches `root`, its
    /// folder `calib`, and the parent folder of `root`.
    pub calibrations: Option<DataPath>,
    /// Sequences to read: `2018-10-19-09-30-39`. All by default.
    pub sequences: Vec<String>,
    /// Pixels with ground truth: `all` or `none` (not read).
    pub ground_truth: DrivingStereoTruth,
    /// Selected frames, by their count over all sequences, from 0. All by default.
    pub frames: FrameSelection,
}

impl DrivingStereoSize {
    const fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::Full => "full",
        }
    }

    /// Maps of the full size have the range of those of half the size.
    const fn disparity_factor(self) -> f32 {
        match self {
            Self::Half => 256.0,
            Self::Full => 128.0,
        }
    }
}

impl DatasetKind for DrivingStereo {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let [_, occ, _] = Evaluation::always();
        let depth = "Sparse ground-truth depth, metres, NaN = unknown; from depth maps, else from disparities if there is a calibration.";
        let calibration = "Focal length, principal points, baseline; absent without a folder of calibrations.";
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "DrivingStereo: rectified driving pairs in different weather, with sparse laser ground truth.",
            doc: "\
Layout (Yang et al., *DrivingStereo: A Large-Scale Dataset for Stereo Matching in Autonomous Driving Scenarios*, \
2019; drivingstereo-dataset.github.io):\n\n\
- a weather subset: `<root>/left-image-half-size/<stem>.jpg`, `right-image-half-size`, \
`disparity-map-half-size/<stem>.png`, `depth-map-half-size`, or the same with `full-size`;\n\
- the test set: the same below `test-left-image`, `test-right-image`, `test-disparity-map`, `test-depth-map`;\n\
- the training set: `train-left-image/<sequence>/<stem>.jpg` and so on.\n\n\
Ground truth is 16-bit PNG, 0 = unknown: disparity * 256 px at half size, disparity * 128 px at full size, depth * \
256 m. Calibrations are `half-image-calib/<sequence>.txt` or `full-image-calib`: `f = P_rect_101[0,0]`, and `B` is \
the length of `T_103`. The last column of `P_rect_103` is not used: in half-size files it is that of the full size, \
so the baseline would be twice as long.\n\n\
The id of a frame is the stem of its file (`2018-10-19-09-30-39_2018-10-19-09-31-36-438`: sequence, then time). Its \
index counts over all sequences. Its time is at 10 Hz.",
            outputs: vec![
                image_port("left", "Left colour image, with the bytes of its file."),
                image_port("right", "Right colour image, with the bytes of its file."),
                Port::frame("calibration", ValueType::Calibration, calibration).optional(),
                depth_port(depth).optional(),
                occ,
            ],
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == DrivingStereoTruth::None, "all", &["depth", "disp_occ"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let params = Self { root: DataPath(root.to_owned()), ..Self::default() };
        recognised::<Self>(&params, "DrivingStereo", root)
    }

    fn meaning(&self) -> String {
        format!("{:?}", self.size)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let calibration = files.get(CALIBRATION).map(|file| calibration(file, size)).transpose()?;
        let disparities = files.map_u16(TRUTH, "disparity", size)?.map(|map| self.disparities(&map));
        let depth = match files.map_u16(DEPTH, "metres", size)? {
            Some(map) => Some(Depth { metres: filled(size, |out| truth_from_depth_png(&map, out)) }),
            None => disparities
                .as_ref()
                .zip(calibration.as_ref())
                .map(|(truth, calibration)| true_disparity::depth(truth, calibration)),
        };
        let outputs = Outputs::one("left", left).with("right", right);
        let outputs = with_optional(outputs, "calibration", calibration);
        let outputs = with_optional(outputs, "depth", depth);
        Ok(Evaluation { occ: disparities, ..Evaluation::default() }.outputs(outputs))
    }
}

struct Parts {
    left: PathBuf,
    right: PathBuf,
    truth: Vec<(Part, PathBuf)>,
}

impl Parts {
    fn find(root: &Path, params: &DrivingStereo) -> Result<Self, Fault> {
        let size = params.size.name();
        let sized = |name: &str| format!("{name}-{size}-size");
        let flat = |name: &str| unpacked(root.join(sized(name)));
        let test = |name: &str| unpacked(root.join(format!("test-{name}")).join(sized(name)));
        let train = |name: &str| unpacked(root.join(format!("train-{name}")));
        let layouts: [&dyn Fn(&str) -> PathBuf; 3] = [&flat, &test, &train];
        let mut there = layouts.into_iter().filter(|folder| folder("left-image").is_dir());
        let folder = there.next().ok_or_else(|| missing_folder(&flat("left-image"), LAYOUT))?;
        let (left, right) = (folder("left-image"), folder("right-image"));
        if let Some(other) = there.next() {
            let what = format!("{} and {} are both there", left.display(), other("left-image").display());
            return Err(Fault::new(what).remedy("set `root` to a folder that contains only one of them"));
        }
        if params.ground_truth == DrivingStereoTruth::None {
            return Ok(Self { left, right, truth: Vec::new() });
        }
        let maps = [(TRUTH, folder("disparity-map")), (DEPTH, folder("depth-map"))];
        let truth: Vec<_> = maps.iter().filter(|(_, folder)| folder.is_dir()).cloned().collect();
        if truth.is_empty() {
            let remedy =
                "ground truth is one disparity or depth map per frame; without ground truth, set `ground_truth: none`";
            return Err(missing_folder(&maps[0].1, remedy));
        }
        Ok(Self { left, right, truth })
    }
}

/// The folder, or the folder of the same name in it, where an archive was unpacked.
fn unpacked(folder: PathBuf) -> PathBuf {
    let inner = folder.file_name().map(|name| folder.join(name));
    inner.filter(|inner| inner.is_dir()).unwrap_or(folder)
}

fn calibrations(params: &DrivingStereo) -> Result<Option<PathBuf>, Fault> {
    if let Some(folder) = &params.calibrations {
        let remedy = "`calibrations` is half-image-calib or full-image-calib, unpacked";
        existing_folder(folder.path(), remedy)?;
        return Ok(Some(folder.path().to_owned()));
    }
    let name = format!("{}-image-calib", params.size.name());
    let root = params.root.path();
    let places = [root.to_owned(), root.join("calib"), root.join(".."), root.join("../calib")];
    Ok(places.into_iter().map(|place| unpacked(place.join(&name))).find(|folder| folder.is_dir()))
}

fn images(folder: &Path, endings: &[&str]) -> Result<Vec<(String, String, PathBuf)>, Fault> {
    let mut found = Vec::new();
    for inner in std::iter::once(String::new()).chain(folders(folder, LAYOUT)?) {
        let stems = stems(&folder.join(&inner), endings, LAYOUT)?;
        found.extend(stems.into_iter().map(|(stem, path)| (inner.clone(), stem, path)));
    }
    Ok(found)
}

fn sequence(stem: &str) -> &str {
    stem.split_once('_').map_or(stem, |(sequence, _)| sequence)
}

fn list(params: &DrivingStereo) -> Result<Listing, Fault> {
    let root = params.root.path();
    existing_folder(root, LAYOUT)?;
    let parts = Parts::find(root, params)?;
    let calibrations = calibrations(params)?;
    let is_selected =
        |stem: &str| params.sequences.is_empty() || params.sequences.iter().any(|name| name == sequence(stem));
    let mut lefts = images(&parts.left, &["jpg", "png"])?;
    lefts.retain(|(_, stem, _)| is_selected(stem));
    lefts.sort_by(|(_, a, _), (_, b, _)| a.cmp(b));
    if lefts.is_empty() {
        let what = format!("{} contains no image of the requested sequences", parts.left.display());
        return Err(Fault::new(what).remedy(LAYOUT));
    }
    let known: Vec<(u64, &str)> = (0..).zip(&lefts).map(|(index, (_, stem, _))| (index, stem.as_str())).collect();
    let mut listing = Listing::default();
    if calibrations.is_none() {
        let name = format!("{}-image-calib", params.size.name());
        let what = format!("there is no folder {name} in root, its calib or beside root: frames have no calibration");
        listing.warnings.push(what);
    }
    listing.add_selected(&params.frames, &known, |at| {
        let (inner, stem, left) = &lefts[at];
        let file = |folder: &Path, endings: &[&str], remedy: &str| {
            existing_with_ending(&folder.join(inner), stem, endings, remedy)
        };
        let remedy = "each left image needs a right image: unpack the archive again";
        let mut files = vec![(LEFT, left.clone()), (RIGHT, file(&parts.right, &["jpg", "png"], remedy)?)];
        for (part, folder) in &parts.truth {
            let remedy = "each frame needs its files; remove the whole folder to read frames without them; without ground truth, set `ground_truth: none`";
            files.push((*part, file(folder, &["png"], remedy)?));
        }
        if let Some(folder) = &calibrations {
            let remedy = "each sequence needs its calibration: unpack the archive again, or remove the whole folder";
            files.push((CALIBRATION, existing_file(folder.join(format!("{}.txt", sequence(stem))), remedy)?));
        }
        Ok(files)
    })?;
    Ok(listing)
}

impl DrivingStereo {
    fn disparities(&self, map: &Raster<u16>) -> TrueDisparity {
        let factor = self.size.disparity_factor();
        let px = |&fixed: &u16| if fixed > 0 { f32::from(fixed) / factor } else { f32::NAN };
        let px = Raster::from_raw(map.width(), map.height(), map.iter().map(px).collect());
        TrueDisparity { px: px.expect("one number per pixel") }
    }
}

fn calibration(file: &File, (width, height): (u32, u32)) -> Result<Calibration, Fault> {
    let lines = NamedLines::parse(&file.path, &file.text(), ':', WANTED)?;
    let (line, left) = lines.numbers::<12>("P_rect_101")?;
    let (_, right) = lines.numbers::<12>("P_rect_103")?;
    let (baseline_line, place) = lines.numbers::<3>("T_103")?;
    let baseline_m = place.iter().map(|metres| metres * metres).sum::<f64>().sqrt();
    let doffs_px = right[2] - left[2];
    let found = Calibration { width, height, focal_px: left[0], cx_px: left[2], cy_px: left[6], baseline_m, doffs_px };
    check_plausible(&found)
        .map_err(|wrong| lines.fault(Some(if wrong.is_baseline { baseline_line } else { line }), wrong.what))?;
    // A principal point is near the image's middle: that of the other size's file is at its edge, or halfway to it.
    let is_near = |at: f64, size: u32| (0.3..0.7).contains(&(at / f64::from(size)));
    if !is_near(found.cx_px, width) {
        let what = format!("the principal point's column is {} px, and the images have {width} columns", found.cx_px);
        return Err(lines
            .fault(Some(line), what)
            .remedy("take the calibrations of the images' size: half-image-calib or full-image-calib"));
    }
    Ok(found)
}
