//! Pairs of two calibrated cameras become rectified ones as they are read.

use std::sync::{Arc, Mutex};

use depthloom_graphs::ErrorMessage;
use depthloom_graphs::values::{Calibration, Image, Pixels};
use depthloom_kernels::rectify::{Interpolation, Map, Rectified, View, remap, stereo_rectify};
use depthloom_threads::locked;
use image::{GrayImage, RgbImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sources::calibration::camera_files::{CalibratedCamera, CameraPair};
use crate::sources::calibration::rectified_pair::{BASELINE_M, CENTRE_PX, FOCAL_PX};

/// Longer baselines need `metres_per_unit`: OpenCV's translations are in the unit of the board's squares.
const LONGEST_UNSAID_M: f64 = 2.0;

/// Files hold few digits.
const FOCAL_TOLERANCE: f64 = 1e-5;
const CENTRE_TOLERANCE_PX: f64 = 1e-2;

/// Precision of positions between pixels when a pair is rectified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Sampling {
    /// Exact positions: OpenCV 5's `remap` with `CV_32FC1` maps.
    #[default]
    Float,
    /// Multiples of 1/32 px: OpenCV 4's `remap`, and OpenCV 5's with `CV_16SC2` maps.
    Fixed,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RectifyOptions {
    /// Use only the projections of the calibration.
    pub rectified: bool,
    /// Computes the rectification with [`stereo_rectify`]; a negative value keeps the focal length.
    pub alpha: Option<f64>,
    pub sampling: Sampling,
    /// Length of one unit of the file's translations, metres.
    pub metres_per_unit: Option<f64>,
}

#[derive(Debug)]
pub(crate) struct Rectifier {
    pub calibration: Calibration,
    /// `None` if the images are rectified already.
    maps: Option<[Map; 2]>,
}

impl Rectifier {
    pub(crate) fn new(pair: &CameraPair, options: &RectifyOptions, size: (u32, u32)) -> Result<Self, ErrorMessage> {
        for (side, camera) in ["left", "right"].into_iter().zip(&pair.cameras) {
            if let Some((width, height)) = camera.size.filter(|calibrated| *calibrated != size) {
                let what = format!(
                    "the {side} camera was calibrated for {width}x{height}, and the image is {}x{}",
                    size.0, size.1
                );
                let remedy = "images must have the size they were calibrated with: no crop, no other scale";
                return Err(ErrorMessage::new(what).remedy(remedy));
            }
        }
        let views = Self::views(pair, options, size)?;
        let calibration = calibration(&views, pair, options, size)?;
        let is_unchanged = |(camera, view): (&CalibratedCamera, &View)| {
            let camera = &camera.camera;
            let turned = view.rotation.as_flattened().iter().zip([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
            camera.lens.is_none()
                && turned.map(|(is, none)| (is - none).abs()).fold(0.0, f64::max) < 1e-9
                && (camera.focal_px, camera.centre_px) == (view.focal_px, view.centre_px)
        };
        let maps = match options.rectified || pair.cameras.iter().zip(&views.views).all(is_unchanged) {
            true => None,
            false => {
                let interpolation = match options.sampling {
                    Sampling::Float => Interpolation::Float,
                    Sampling::Fixed => Interpolation::Fixed,
                };
                Some([0, 1].map(|at| Map::new(&pair.cameras[at].camera, &views.views[at], size, interpolation)))
            }
        };
        Ok(Self { calibration, maps })
    }

    fn views(pair: &CameraPair, options: &RectifyOptions, size: (u32, u32)) -> Result<Rectified, ErrorMessage> {
        let [left, right] = &pair.cameras;
        if let ((Some(left), Some(right)), None) = ((left.rectified, right.rectified), options.alpha) {
            return Ok(Rectified {
                views: [left.0, right.0],
                translation: (right.1 / right.0.focal_px[0]) - (left.1 / left.0.focal_px[0]),
            });
        }
        if options.rectified {
            return Err(ErrorMessage::new("the calibration has no projections of rectified images").remedy(
                "with `rectified: true` it needs P1 and P2 (R1, R2), and no `alpha`; or set focal_px and baseline_m",
            ));
        }
        let Some((rotation, translation)) = pair.pose else {
            return Err(ErrorMessage::new("the calibration lacks the pose between the cameras")
                .remedy("it needs R and T, or R1, R2, P1 and P2 (`alpha` needs R and T)"));
        };
        let cameras = [&left.camera, &right.camera];
        let alpha = options.alpha.filter(|alpha| *alpha >= 0.0);
        stereo_rectify(cameras, size, &rotation, translation, alpha).ok_or_else(|| {
            ErrorMessage::new("the cameras' rectification cannot be computed")
                .remedy("cameras must stand side by side, and both have a lens of one kind; or add R1, R2, P1 and P2")
        })
    }

    pub(crate) const fn moves_pixels(&self) -> bool {
        self.maps.is_some()
    }

    pub(crate) fn pair(&self, left: Image, right: Image) -> (Image, Image) {
        match &self.maps {
            None => (left, right),
            Some(maps) => (rectified(&left, &maps[0]), rectified(&right, &maps[1])),
        }
    }
}

pub(crate) fn rectified(image: &Image, map: &Map) -> Image {
    let (width, height) = image.dimensions();
    let size = (width as usize, height as usize);
    Image::new(match image.pixels() {
        Pixels::Grey(grey) => {
            let mut out = GrayImage::new(width, height);
            remap::<1>(grey, size, map, &mut out);
            Pixels::Grey(out)
        }
        Pixels::Rgb(rgb) => {
            let mut out = RgbImage::new(width, height);
            remap::<3>(rgb, size, map, &mut out);
            Pixels::Rgb(out)
        }
    })
}

fn calibration(
    found: &Rectified,
    pair: &CameraPair,
    options: &RectifyOptions,
    (width, height): (u32, u32),
) -> Result<Calibration, ErrorMessage> {
    let [left, right] = &found.views;
    let wrong = |what: String, remedy: &str| Err(ErrorMessage::new(what).remedy(remedy));
    let (f, c) = (left.focal_px, left.centre_px);
    let named = [
        ("focal length", f[0], FOCAL_PX),
        ("principal point's column", c[0], CENTRE_PX),
        ("principal point's row", c[1], CENTRE_PX),
    ];
    for (what, number, possible) in named {
        if !possible.contains(&number) {
            let what = format!("the rectified pair's {what} would be {number:.6e} px");
            return wrong(what, "no camera has that: is the calibration that of these images?");
        }
    }
    if (f[0] - right.focal_px[0]).abs() > FOCAL_TOLERANCE * f[0] {
        let what = format!("the rectified cameras have focal lengths of {} and {} px", f[0], right.focal_px[0]);
        return wrong(what, "P1 and P2 of a rectified pair have the same: take both from one calibration");
    }
    if (f[0] - f[1]).abs() > 0.01 * f[0] {
        let what = format!(
            "the rectified pixels are not square: focal lengths of {} px along rows and {} px along columns",
            f[0], f[1]
        );
        return wrong(what, "let stereoRectify choose the projections");
    }
    let apart = [0, 1].map(|axis| (c[axis] - right.centre_px[axis]).abs());
    // Principal points that are meant to be equal differ in their last digits.
    let doffs_px = if apart[0] > CENTRE_TOLERANCE_PX { right.centre_px[0] - c[0] } else { 0.0 };
    if apart[0] > f64::from(width) {
        let what =
            format!("the rectified principal points are {} px apart along rows, more than the image is wide", apart[0]);
        return wrong(what, "rectify with CALIB_ZERO_DISPARITY, or set `alpha`, which computes this from R and T");
    }
    if apart[1] > CENTRE_TOLERANCE_PX {
        let what = format!("the rectified principal points are {} px apart along columns: rows do not meet", apart[1]);
        return wrong(what, "P1 and P2 of a rectified pair have the same: take both from one calibration");
    }
    let baseline_m = -found.translation * options.metres_per_unit.unwrap_or(1.0);
    if baseline_m < 0.0 {
        let what =
            format!("in the calibration the right camera is {:.4} m to the left of the left camera", -baseline_m);
        return wrong(what, "left and right are exchanged: exchange the images, or the cameras in the calibration");
    }
    if options.metres_per_unit.is_none() && !pair.in_metres && baseline_m > LONGEST_UNSAID_M {
        let what =
            format!("the baseline would be {baseline_m:.4} m: the lengths in the calibration are probably not metres");
        return wrong(
            what,
            "set the length of one unit of its T (that of the board's squares): `metres_per_unit: 0.001` for millimetres, 1 for metres",
        );
    }
    if !BASELINE_M.contains(&baseline_m) {
        let (least, most) = (BASELINE_M.start(), BASELINE_M.end());
        let what = format!("the baseline is {baseline_m:e} m, expected {least} to {most} m");
        return wrong(what, "a right camera's projection tells it: P2[0,3] is -f * B; or T, with `metres_per_unit`");
    }
    Ok(Calibration { width, height, focal_px: f[0], cx_px: c[0], cy_px: c[1], baseline_m, doffs_px })
}

/// The rectifier of the latest size, because a source's images have one size.
#[derive(Debug, Default)]
pub(crate) struct LatestRectifier(Mutex<Option<SizedRectifier>>);

type SizedRectifier = ((u32, u32), Arc<Rectifier>);

impl LatestRectifier {
    /// Blocks callers while it is computed.
    pub(crate) fn get(
        &self,
        pair: &CameraPair,
        options: &RectifyOptions,
        size: (u32, u32),
    ) -> Result<Arc<Rectifier>, ErrorMessage> {
        let mut latest = locked(&self.0);
        if let Some((_, known)) = latest.as_ref().filter(|(other, _)| *other == size) {
            return Ok(Arc::clone(known));
        }
        let rectifier = Arc::new(Rectifier::new(pair, options, size)?);
        *latest = Some((size, Arc::clone(&rectifier)));
        Ok(rectifier)
    }
}
