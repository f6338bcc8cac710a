//! Scenes of Middlebury from 2014 on, and of ETH3D: a calibration text, disparities as PFM, a mask of what both cameras
//! see.

use std::path::{Path, PathBuf};

use depthloom_graphs::values::{Calibration, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs};
use image::Luma;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::calibration::rectified_pair::check_plausible;
use crate::sources::dataset::folders::{existing_file, missing_file, with_ending};
use crate::sources::dataset::frame_files::{CALIBRATION, File, Files, LEFT, Part, RIGHT, TRUTH};
use crate::sources::evaluation::{Evaluation, with_optional};
use crate::sources::files::named_lines::NamedLines;
use crate::sources::true_disparity;

pub(crate) const MASK: Part = "mask0nocc";
/// 128: seen by one camera, 0: no ground truth.
const SEEN_BY_BOTH: u8 = 255;

const WANTED: &str = "a calibration has the lines `cam0=[f 0 cx; 0 f cy; 0 0 1]` and `cam1` likewise (px), `doffs=` (px) and `baseline=` (mm), and may say \
`width=` and `height=` (px): take it from the scene's archive again";

/// Pixels of the output `depth`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TruePixels {
    /// All pixels with ground truth.
    #[default]
    All,
    /// Pixels that both cameras see.
    Noc,
    /// Ground truth is not read, even if it exists.
    None,
}

pub(crate) fn files(images: &Path, truths: &Path, truth: TruePixels) -> Result<Vec<(Part, PathBuf)>, Fault> {
    let pair = "a scene has both images, im0.png (left) and im1.png (right): unpack its archive again";
    let calibration = "each scene has its calibration: unpack its archive again";
    let mut files = vec![
        (LEFT, existing_file(images.join("im0.png"), pair)?),
        (RIGHT, existing_file(images.join("im1.png"), pair)?),
        (CALIBRATION, existing_file(images.join("calib.txt"), calibration)?),
    ];
    if truth == TruePixels::None {
        return Ok(files);
    }
    let named = ["disp0GT", "disp0"].iter().find_map(|stem| with_ending(truths, stem, &["pfm"]));
    let missing = || {
        let remedy =
            "the ground truth of a scene is disp0.pfm or disp0GT.pfm; without ground truth, set `ground_truth: none`";
        missing_file(&truths.join("disp0.pfm"), remedy)
    };
    files.push((TRUTH, named.ok_or_else(missing)?));
    let mask = truths.join("mask0nocc.png");
    if truth == TruePixels::Noc || mask.is_file() {
        let remedy = "`ground_truth: noc` needs a mask, which only ETH3D and Middlebury's training set of 2014 (MiddEval3) contain; use `ground_truth: all`";
        files.push((MASK, existing_file(mask, remedy)?));
    }
    Ok(files)
}

pub(crate) fn values(files: &Files, truth: TruePixels, ctx: &Context<'_>) -> Result<Outputs, Fault> {
    let (left, right) = files.pair(ctx)?;
    let size = left.dimensions();
    let calibration = calibration(files.required(CALIBRATION)?, size)?;
    let outputs = Outputs::one("left", left).with("right", right);
    let Some(px) = files.map_f32(TRUTH, size)? else { return Ok(outputs.with("calibration", calibration)) };
    let occ = TrueDisparity { px };
    let seen = "a mask has 8 bits, one channel: 255 where both cameras see a pixel, 128 where one does, 0 where the ground truth is unknown";
    let noc = files.map_u8(MASK, seen, size)?.map(|mask| {
        let mut px = occ.px.clone();
        let hidden = px.iter_mut().zip(mask.iter()).filter(|(_, mask)| **mask != SEEN_BY_BOTH);
        hidden.for_each(|(px, _)| *px = f32::NAN);
        TrueDisparity { px }
    });
    Ok(with_truth(outputs, truth, Evaluation { noc, occ: Some(occ), objects: None }, Some(calibration)))
}

pub(crate) fn with_truth(
    outputs: Outputs,
    truth: TruePixels,
    maps: Evaluation,
    calibration: Option<Calibration>,
) -> Outputs {
    let of_depth = match truth {
        TruePixels::All => maps.occ.as_ref(),
        TruePixels::Noc => maps.noc.as_ref(),
        TruePixels::None => None,
    };
    let depth =
        of_depth.zip(calibration.as_ref()).map(|(truth, calibration)| true_disparity::depth(truth, calibration));
    let outputs = with_optional(maps.outputs(outputs), "depth", depth);
    with_optional(outputs, "calibration", calibration)
}

pub(crate) fn without(px: &Raster<f32>, set: &Raster<u8>) -> Raster<f32> {
    let (width, height) = px.dimensions();
    Raster::from_fn(width, height, |x, y| Luma([if set[(x, y)].0[0] > 0 { f32::NAN } else { px[(x, y)].0[0] }]))
}

fn calibration(file: &File, (width, height): (u32, u32)) -> Result<Calibration, Fault> {
    let lines = NamedLines::parse(&file.path, &file.text(), '=', WANTED)?;
    let ((left_line, left), (right_line, right)) = (camera(&lines, "cam0")?, camera(&lines, "cam1")?);
    let ((doffs_line, doffs_px), (baseline_line, baseline_mm)) = (lines.number("doffs")?, lines.number("baseline")?);
    for (name, pixels) in [("width", width), ("height", height)].into_iter().filter(|(name, _)| lines.has(name)) {
        let (line, number) = lines.number(name)?;
        if number != f64::from(pixels) {
            let what = format!("{name} is {number} px, and the left image's {pixels} px");
            let remedy = "take images and calibration of one archive, at one resolution";
            return Err(lines.fault(Some(line), what).remedy(remedy));
        }
    }
    let [focal_px, cx_px, cy_px] = left;
    if (right[0] - focal_px).abs() > 1e-6 * focal_px {
        let what = format!(
            "cam1 has a focal length of {} px and cam0 one of {focal_px} px: rectified cameras have the same",
            right[0]
        );
        return Err(lines.fault(Some(right_line), what));
    }
    let apart_px = right[1] - cx_px;
    // Numbers of three decimals.
    if (apart_px - doffs_px).abs() > 0.01 {
        let what = format!("doffs is {doffs_px} px, and the principal points of cam0 and cam1 are {apart_px} px apart");
        return Err(lines.fault(Some(doffs_line), what));
    }
    let found = Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: baseline_mm / 1000.0, doffs_px };
    check_plausible(&found)
        .map_err(|wrong| lines.fault(Some(if wrong.is_baseline { baseline_line } else { left_line }), wrong.what))?;
    Ok(found)
}

/// Line, focal length and principal point of a matrix `[f 0 cx; 0 f cy; 0 0 1]`.
fn camera(lines: &NamedLines<'_>, name: &str) -> Result<(usize, [f64; 3]), Fault> {
    let (line, value) = lines.value(name)?;
    let matrix = value.strip_prefix('[').and_then(|value| value.strip_suffix(']'));
    let matrix = matrix.ok_or_else(|| lines.fault(Some(line), format!("{name} is not a matrix in brackets")))?;
    let tokens = matrix.split([' ', ';', ',', '\t']).filter(|token| !token.is_empty()).take(10);
    let numbers: Vec<f64> = tokens.map(|token| lines.parse_number(line, name, token)).collect::<Result<_, Fault>>()?;
    match numbers[..] {
        [focal_px, _, cx_px, _, _, cy_px, _, _, _] => Ok((line, [focal_px, cx_px, cy_px])),
        _ => Err(lines.fault(Some(line), format!("{name} does not hold the 9 numbers of a 3x3 matrix"))),
    }
}
