//! A scene as Middlebury keeps it from 2014 on, and ETH3D after it: a calibration text, disparities as PFM, a mask of what both cameras see.

use std::path::{Path, PathBuf};

use depthloom_graphs::values::{Calibration, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs};
use image::Luma;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::calibration::possible;
use crate::sources::dataset::{CALIBRATION, File, Files, LEFT, Part, RIGHT, TRUTH, no_file};
use crate::sources::evaluation::Evaluation;
use crate::sources::true_disparity;

pub(crate) const MASK: Part = "mask0nocc";
/// 128: seen by one camera, 0: no ground truth.
const SEEN_BY_BOTH: u8 = 255;

const WANTED: &str = "a calibration has the lines `cam0=[f 0 cx; 0 f cy; 0 0 1]` and `cam1` likewise (px), `doffs=` (px) and `baseline=` (mm), and may say \
`width=` and `height=` (px): take it from the scene's archive again";

/// Which true pixels are given as `depth`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TruePixels {
    /// All that are known.
    #[default]
    All,
    /// Those that both cameras see.
    Noc,
    /// None: truth is not read, even where there is some.
    None,
}

pub(crate) fn with_ending(folder: &Path, stem: &str, endings: &[&str]) -> Option<PathBuf> {
    endings.iter().map(|ending| folder.join(format!("{stem}.{ending}"))).find(|path| path.is_file())
}

pub(crate) fn files(images: &Path, truths: &Path, truth: TruePixels) -> Result<Vec<(Part, PathBuf)>, Fault> {
    let there = |path: PathBuf, remedy: &str| if path.is_file() { Ok(path) } else { Err(no_file(&path, remedy)) };
    let pair = "a scene has both images, im0.png (left) and im1.png (right): unpack its archive again";
    let mut files = vec![
        (LEFT, there(images.join("im0.png"), pair)?),
        (RIGHT, there(images.join("im1.png"), pair)?),
        (CALIBRATION, there(images.join("calib.txt"), "each scene has its calibration: unpack its archive again")?),
    ];
    if truth == TruePixels::None {
        return Ok(files);
    }
    let named = ["disp0GT", "disp0"].iter().find_map(|stem| with_ending(truths, stem, &["pfm"]));
    let missing = || {
        no_file(
            &truths.join("disp0.pfm"),
            "a scene's truth is disp0.pfm or disp0GT.pfm; without truth, say `truth: none`",
        )
    };
    files.push((TRUTH, named.ok_or_else(missing)?));
    let mask = truths.join("mask0nocc.png");
    if truth == TruePixels::Noc || mask.is_file() {
        let remedy = "what both cameras see is told by a mask, which Middlebury's training set of 2014 (MiddEval3) and ETH3D have; without it `truth: all`";
        files.push((MASK, there(mask, remedy)?));
    }
    Ok(files)
}

pub(crate) fn values(files: &Files, truth: TruePixels, ctx: &Context<'_>) -> Result<Outputs, Fault> {
    let (left, right) = files.pair(ctx)?;
    let size = left.dimensions();
    let calibration = calibration(files.the(CALIBRATION)?, size)?;
    let outputs = Outputs::one("left", left).with("right", right);
    let Some(px) = files.map_f32(TRUTH, size)? else { return Ok(outputs.with("calibration", calibration)) };
    let occ = TrueDisparity { px };
    let seen = "a mask has 8 bits, one channel: 255 where both cameras see a pixel, 128 where one does, 0 where its truth is unknown";
    let noc = files.map_u8(MASK, seen, size)?.map(|mask| {
        let mut px = occ.px.clone();
        let both = |(px, mask): (&mut f32, &u8)| {
            if *mask != SEEN_BY_BOTH {
                *px = f32::NAN;
            }
        };
        px.iter_mut().zip(mask.iter()).for_each(both);
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
    let depth = of_depth.zip(calibration.as_ref()).map(|(truth, of)| true_disparity::depth(truth, of));
    let mut outputs = maps.outputs(outputs);
    if let Some(depth) = depth {
        outputs = outputs.with("depth", depth);
    }
    match calibration {
        Some(calibration) => outputs.with("calibration", calibration),
        None => outputs,
    }
}

pub(crate) fn without(px: &Raster<f32>, set: &Raster<u8>) -> Raster<f32> {
    let (width, height) = px.dimensions();
    Raster::from_fn(width, height, |x, y| Luma([if set[(x, y)].0[0] > 0 { f32::NAN } else { px[(x, y)].0[0] }]))
}

fn calibration(file: &File, size: (u32, u32)) -> Result<Calibration, Fault> {
    let text = file.text();
    let of = Text { file, text: &text };
    let ((left_line, left), (right_line, right)) = (of.camera("cam0")?, of.camera("cam1")?);
    let ((doffs_line, doffs_px), (baseline_line, baseline_mm)) = (of.number("doffs")?, of.number("baseline")?);
    for (name, pixels) in [("width", size.0), ("height", size.1)] {
        if of.line(name).is_none() {
            continue;
        }
        let (line, number) = of.number(name)?;
        if number != f64::from(pixels) {
            let what = format!("{name} is {number} px, and the left image's {pixels} px");
            return Err(of
                .fault(Some(line), what)
                .remedy("take images and calibration of one archive, at one resolution"));
        }
    }
    let [focal_px, cx_px, cy_px] = left;
    if (right[0] - focal_px).abs() > 1e-6 * focal_px {
        let what = format!(
            "cam1 has a focal length of {} px and cam0 one of {focal_px} px: rectified cameras have the same",
            right[0]
        );
        return Err(of.fault(Some(right_line), what));
    }
    // Numbers of three decimals.
    if (right[1] - cx_px - doffs_px).abs() > 0.01 {
        let what = format!(
            "doffs is {doffs_px} px, and the principal points of cam0 and cam1 are {} px apart",
            right[1] - cx_px
        );
        return Err(of.fault(Some(doffs_line), what));
    }
    let (width, height) = size;
    let found = Calibration { width, height, focal_px, cx_px, cy_px, baseline_m: baseline_mm / 1000.0, doffs_px };
    let of_baseline = |what: &str| what.starts_with("the baseline");
    possible::check(&found)
        .map_err(|what| of.fault(Some(if of_baseline(&what) { baseline_line } else { left_line }), what))?;
    Ok(found)
}

struct Text<'a> {
    file: &'a File,
    text: &'a str,
}

impl Text<'_> {
    fn fault(&self, line: Option<usize>, what: impl std::fmt::Display) -> Fault {
        let path = self.file.path.display();
        let place = line.map_or_else(|| path.to_string(), |line| format!("{path}:{line}"));
        Fault::new(format!("{place}: {what}")).remedy(WANTED)
    }

    fn line(&self, name: &str) -> Option<(usize, &str)> {
        let mut lines = (1..).zip(self.text.lines());
        lines.find_map(|(number, line)| {
            let (other, value) = line.split_once('=')?;
            (other.trim() == name).then_some((number, value.trim()))
        })
    }

    fn value(&self, name: &str) -> Result<(usize, &str), Fault> {
        self.line(name).ok_or_else(|| self.fault(None, format!("there is no line `{name}=`")))
    }

    fn number(&self, name: &str) -> Result<(usize, f64), Fault> {
        let (line, value) = self.value(name)?;
        Ok((line, self.parsed(line, name, value)?))
    }

    fn parsed(&self, line: usize, name: &str, value: &str) -> Result<f64, Fault> {
        let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| {
            let value: String = value.chars().take(40).collect();
            self.fault(Some(line), format!("{name} holds `{value}`, which is no number"))
        })
    }

    /// `[f 0 cx; 0 f cy; 0 0 1]`
    fn camera(&self, name: &str) -> Result<(usize, [f64; 3]), Fault> {
        let (line, value) = self.value(name)?;
        let matrix = value.strip_prefix('[').and_then(|value| value.strip_suffix(']'));
        let matrix = matrix.ok_or_else(|| self.fault(Some(line), format!("{name} is no matrix in brackets")))?;
        let mut numbers = Vec::with_capacity(9);
        for token in matrix.split([' ', ';', ',', '\t']).filter(|token| !token.is_empty()).take(10) {
            numbers.push(self.parsed(line, name, token)?);
        }
        match numbers[..] {
            [focal_px, _, cx_px, _, _, cy_px, _, _, _] => Ok((line, [focal_px, cx_px, cy_px])),
            _ => Err(self.fault(Some(line), format!("{name} does not hold the 9 numbers of a 3x3 matrix"))),
        }
    }
}
