//! `sintel-stereo`: the MPI Sintel stereo training set, as unpacked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::{Calibration, Pixels, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs, Port, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::sources::calibration::rectified_pair::{check_plausible, middle};
use crate::sources::dataset::folders::{existing_file, existing_folder, folders, stems};
use crate::sources::dataset::frame_files::{CALIBRATION, File, Files, LEFT, Part, RIGHT, TRUTH};
use crate::sources::dataset::{DatasetKind, Listing, depth_port, image_port, recognised, required, truth_off};
use crate::sources::evaluation::Evaluation;
use crate::sources::files::image_file;
use crate::sources::middlebury::scene::{TruePixels, with_truth, without};

const KIND: &str = "sintel-stereo";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds `training` with final_left, final_right, clean_left, clean_right, disparities, occlusions and outofframe, each with a folder a \
sequence of frame_0001.png ... (MPI-Sintel-stereo-training)";

const OCCLUDED: Part = "occlusions";
const OUT_OF_FRAME: Part = "outofframe";

const BASELINE_M: f64 = 0.1;
/// First number and length of Sintel's camera files: the tag, 3x3 and 3x4 doubles.
const CAMERA_TAG: f32 = 202_021.25;
const CAMERA_BYTES: usize = 4 + 8 * (9 + 12);

/// Rendering pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SintelPass {
    /// With blur and depth of field.
    #[default]
    Final,
    /// Without blur and depth of field.
    Clean,
}

/// Parameters of `sintel-stereo`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SintelStereo {
    /// Folder that contains `training`.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Rendering pass: `final` or `clean`.
    pub pass: SintelPass,
    /// Sequences to read, in this order: `alley_1`. By default all, sorted by name.
    pub sequences: Vec<String>,
    /// Pixels of `depth`: `all` (all with ground truth), `noc` (seen by both cameras) or `none` (ground truth is not
    /// read).
    pub ground_truth: TruePixels,
    /// Focal length, px, used without camera files: the stereo archive does not contain it. It is 1120 for most
    /// sequences.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub focal_px: Option<f64>,
    /// Selected frames, by their count over all sequences, from 0. All by default.
    pub frames: FrameSelection,
}

impl DatasetKind for SintelStereo {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let depth = "Ground-truth depth, metres, NaN = unknown; absent without ground truth or calibration.";
        let calibration = "Focal length, principal point, baseline; absent without `focal_px` or camera files.";
        let ports = [
            image_port("left", "Left image, RGB, with the bytes of its file."),
            image_port("right", "Right image, RGB, with the bytes of its file."),
            Port::frame("calibration", ValueType::Calibration, calibration).optional(),
            depth_port(depth).optional(),
        ];
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "MPI Sintel stereo: rendered film scenes with dense ground truth, including occluded pixels.",
            doc: "\
Layout (Butler et al., *A naturalistic open source movie for optical flow evaluation*, 2012; \
sintel.is.tue.mpg.de/stereo): `<root>/training/{final,clean}_{left,right}/<sequence>/frame_%04d.png`; `disparities`, \
`occlusions` and `outofframe` have the same structure.\n\n\
A disparity is `4 R + G / 2^6 + B / 2^14` px of an RGB file, as in `sintel_io` of the archive. Pixels that are \
outside the right image (`outofframe`) are ignored by the benchmark and are unknown here. `disp_noc` contains the \
pixels that are not occluded, `disp_occ` also the occluded ones.\n\n\
Depth is `f * B / d` with `B` = 0.1 m. `f` comes from the camera files of Sintel's depth data set if \
`training/camdata_left` exists, otherwise from `focal_px` with the principal point at the centre of the image.\n\n\
The id of a frame is sequence and file (`alley_1_frame_0001`). Its index counts over all sequences. Its time is at \
10 Hz. Pixel centres have integer coordinates.",
            outputs: ports.into_iter().chain(Evaluation::always()).collect(),
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)?;
        above_zero("focal_px", params.focal_px, "px")
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == TruePixels::None, "all", &["depth", "disp_noc", "disp_occ", "occluded"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        Ok((list(params)?, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        let params = Self { root: DataPath(root.to_owned()), ..Self::default() };
        recognised::<Self>(&params, "MPI Sintel stereo", root)
    }

    fn meaning(&self) -> String {
        format!("{:?} {:?}", self.ground_truth, self.focal_px)
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let calibration = self.calibration(files, size)?;
        let outputs = Outputs::one("left", left).with("right", right);
        let Some(file) = files.get(TRUTH) else {
            return Ok(with_truth(outputs, self.ground_truth, Evaluation::default(), calibration));
        };
        let all = disparities(files, file, size)?;
        let mask = |part| {
            let what = "a mask of Sintel's has 8 bits, one channel, and is set where a pixel is not seen";
            files.map_u8(part, what, size)
        };
        let occ = mask(OUT_OF_FRAME)?.map_or_else(|| all.clone(), |set| without(&all, &set));
        let noc = mask(OCCLUDED)?.map(|set| TrueDisparity { px: without(&occ, &set) });
        let maps = Evaluation { noc, occ: Some(TrueDisparity { px: occ }), objects: None };
        Ok(with_truth(outputs, self.ground_truth, maps, calibration))
    }
}

fn list(params: &SintelStereo) -> Result<Listing, Fault> {
    let root = params.root.path();
    existing_folder(root, LAYOUT)?;
    let training = root.join("training");
    let pass = match params.pass {
        SintelPass::Final => "final",
        SintelPass::Clean => "clean",
    };
    let lefts = training.join(format!("{pass}_left"));
    let sequences = if params.sequences.is_empty() { folders(&lefts, LAYOUT)? } else { params.sequences.clone() };
    let mut frames: Vec<(String, String, PathBuf)> = Vec::new();
    for sequence in &sequences {
        let lefts = stems(&lefts.join(sequence), &["png"], LAYOUT)?;
        frames.extend(lefts.into_iter().map(|(stem, left)| (sequence.clone(), stem, left)));
    }
    if frames.is_empty() {
        return Err(Fault::new(format!("{} holds no frame", lefts.display())).remedy(LAYOUT));
    }
    let ids: Vec<String> = frames.iter().map(|(sequence, stem, _)| format!("{sequence}_{stem}")).collect();
    let known: Vec<(u64, &str)> = (0..).zip(&ids).map(|(index, id)| (index, id.as_str())).collect();
    let has_cameras = training.join("camdata_left").is_dir();
    let mut listing = Listing::default();
    listing.add_selected(&params.frames, &known, |at| {
        let (sequence, stem, left) = &frames[at];
        let file = |folder: &str, ending: &str, remedy: &str| {
            existing_file(training.join(folder).join(sequence).join(format!("{stem}.{ending}")), remedy)
        };
        let remedy = "each left image needs a right image: unpack the archive again";
        let mut files = vec![(LEFT, left.clone()), (RIGHT, file(&format!("{pass}_right"), "png", remedy)?)];
        if params.ground_truth != TruePixels::None {
            let remedy =
                "ground truth is one disparity map and two masks per frame; without ground truth, set `ground_truth: none`";
            for (part, folder) in [(TRUTH, "disparities"), (OCCLUDED, OCCLUDED), (OUT_OF_FRAME, OUT_OF_FRAME)] {
                files.push((part, file(folder, "png", remedy)?));
            }
        }
        if has_cameras {
            let remedy = "each frame needs its camera, or the whole folder away: unpack Sintel's depth archive again";
            files.push((CALIBRATION, file("camdata_left", "cam", remedy)?));
        }
        Ok(files)
    })?;
    Ok(listing)
}

impl SintelStereo {
    fn calibration(&self, files: &Files, size: (u32, u32)) -> Result<Option<Calibration>, Fault> {
        let file = files.get(CALIBRATION);
        let ([focal_px, cx_px, cy_px], remedy) = match (file, self.focal_px) {
            (Some(file), _) => (camera(file)?, "take the camera file from Sintel's depth archive again"),
            (None, Some(focal_px)) => {
                let (cx_px, cy_px) = middle(size);
                ([focal_px, cx_px, cy_px], "`focal_px` is in pixels, 1120 of most sequences")
            }
            (None, None) => return Ok(None),
        };
        let (width, height) = size;
        let found = Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: BASELINE_M, doffs_px: 0.0 };
        check_plausible(&found).map_err(|wrong| {
            file.map_or_else(|| Fault::new(&*wrong.what), |file| file.fault(&wrong.what)).remedy(remedy)
        })?;
        Ok(Some(found))
    }
}

/// `4 R + G / 2^6 + B / 2^14`.
fn disparities(files: &Files, file: &File, size: (u32, u32)) -> Result<Raster<f32>, Fault> {
    let image = image_file::image(&file.path, Arc::clone(&file.bytes))?;
    files.same_size_as_left(size, file, image.dimensions())?;
    let Pixels::Rgb(rgb) = image.pixels() else {
        return Err(file
            .fault("it is a grey image, expected RGB: Sintel stores a disparity in the three channels")
            .remedy("use the folder `disparities` of the archive, not `disparities_viz`"));
    };
    let px = rgb.pixels().map(|pixel| {
        let [red, green, blue] = pixel.0.map(f32::from);
        4.0 * red + green / 64.0 + blue / 16384.0
    });
    Ok(Raster::from_raw(size.0, size.1, px.collect()).expect("one number per pixel"))
}

fn camera(file: &File) -> Result<[f64; 3], Fault> {
    let bytes = &file.bytes;
    let fault = |what: String| {
        file.fault(what)
            .remedy("a camera file is one of Sintel's depth archive, `camdata_left/<sequence>/frame_0001.cam`")
    };
    if bytes.len() != CAMERA_BYTES {
        return Err(fault(format!("it has {} bytes, and a camera file of Sintel's {CAMERA_BYTES}", bytes.len())));
    }
    if bytes.first_chunk().map(|tag| f32::from_le_bytes(*tag)) != Some(CAMERA_TAG) {
        return Err(fault(format!("it does not begin with {CAMERA_TAG}, the tag of Sintel's camera files")));
    }
    let number = |at: usize| bytes[4..].as_chunks().0.get(at).map_or(f64::NAN, |bytes| f64::from_le_bytes(*bytes));
    Ok([number(0), number(2), number(5)])
}
