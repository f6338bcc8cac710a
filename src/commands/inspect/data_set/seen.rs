//! What the frames hold that were looked at.

use std::collections::BTreeMap;

use depthloom_graphs::values::{self, Pixels};
use depthloom_graphs::{Value, counted};
use schemars::JsonSchema;
use serde::Serialize;

/// What frames hold, of those looked at.
#[derive(Default)]
pub(super) struct Seen {
    pub frames: usize,
    /// Columns and rows, grey or colour: how many.
    images: BTreeMap<(u32, u32, bool), usize>,
    calibration: Option<values::Calibration>,
    /// Whether others have another focal length or baseline.
    calibrations_differ: bool,
    /// Whether the frames are made of files, and none of these is a calibration.
    pub calibration_is_assumed: bool,
    /// Ground truth by port: depths and disparities.
    truths: BTreeMap<&'static str, SeenTruth>,
}

/// Known pixels of all, and their numbers.
#[derive(Default)]
struct SeenTruth {
    frames: usize,
    pixels: u64,
    known: Vec<f32>,
    unit: &'static str,
}

impl Seen {
    pub(super) fn take(&mut self, port: &'static str, value: &Value) {
        match value {
            Value::Image(image) if port == "left" => {
                let ((width, height), colour) = (image.dimensions(), matches!(image.pixels(), Pixels::Rgb(_)));
                *self.images.entry((width, height, colour)).or_default() += 1;
            }
            Value::Calibration(of) => match &self.calibration {
                None => self.calibration = Some((**of).clone()),
                Some(known) => {
                    self.calibrations_differ |= (known.focal_px, known.baseline_m) != (of.focal_px, of.baseline_m);
                }
            },
            Value::Depth(depth) => self.truth(port, "m", depth.metres.as_raw()),
            Value::TrueDisparity(truth) => self.truth(port, "px", truth.px.as_raw()),
            _ => {}
        }
    }

    fn truth(&mut self, port: &'static str, unit: &'static str, numbers: &[f32]) {
        let truth = self.truths.entry(port).or_default();
        truth.unit = unit;
        truth.frames += 1;
        truth.pixels += numbers.len() as u64;
        truth.known.extend(numbers.iter().filter(|number| number.is_finite()));
    }
}

impl SeenTruth {
    fn density(&self) -> f64 {
        self.known.len() as f64 / (self.pixels as f64).max(1.0)
    }

    /// The least, the median, the largest number.
    fn spread(&self) -> [Option<f32>; 3] {
        let mut known = self.known.clone();
        known.sort_unstable_by(f32::total_cmp);
        [known.first(), known.get(known.len() / 2), known.last()].map(Option::<&f32>::copied)
    }
}

impl Seen {
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let mut lines = Vec::new();
        let sizes: Vec<String> = self
            .images
            .iter()
            .map(|((width, height, colour), count)| {
                let colour = if *colour { "colour" } else { "grey" };
                format!("{width}x{height}, {colour} ({})", counted(*count, "frame"))
            })
            .collect();
        if !sizes.is_empty() {
            lines.push(("size", sizes.join("; ")));
        }
        if let Some(of) = &self.calibration {
            let others = if self.calibrations_differ { "; other frames have others" } else { "" };
            let assumed = if self.calibration_is_assumed { " (assumed: no file says it)" } else { "" };
            let doffs = if of.doffs_px == 0.0 { String::new() } else { format!(", doffs {:.2} px", of.doffs_px) };
            lines.push((
                "calibration",
                format!(
                    "focal length {:.2} px, principal point ({:.2}, {:.2}) px, baseline {:.4} m{doffs}{assumed}{others}",
                    of.focal_px, of.cx_px, of.cy_px, of.baseline_m
                ),
            ));
        } else if self.frames > 0 {
            lines.push(("calibration", "none".to_owned()));
        }
        for (port, truth) in &self.truths {
            let [least, median, most] = truth.spread();
            let (unit, density) = (truth.unit, 100.0 * truth.density());
            let frames = counted(truth.frames, "frame");
            let spread = match (least, median, most) {
                (Some(least), Some(median), Some(most)) => {
                    format!("{least:.2} to {most:.2} {unit} (median {median:.2})")
                }
                _ => "not one is known".to_owned(),
            };
            lines.push(("ground truth", format!("{port}: {density:.1} % of the pixels of {frames}, {spread}")));
        }
        if self.truths.is_empty() && self.frames > 0 {
            lines.push(("ground truth", "none".to_owned()));
        }
        lines
    }

    /// The sizes of the images, for programs.
    pub(super) fn sizes(&self) -> Vec<ImageSize> {
        let size = |(&(width, height, colour), &frames): (&(u32, u32, bool), &usize)| ImageSize {
            width,
            height,
            colour,
            frames: frames as u64,
        };
        self.images.iter().map(size).collect()
    }

    /// The first calibration, for programs.
    pub(super) fn calibration(&self) -> Option<Calibration> {
        self.calibration.as_ref().map(|of| Calibration {
            focal_px: of.focal_px,
            cx_px: of.cx_px,
            cy_px: of.cy_px,
            baseline_m: of.baseline_m,
            doffs_px: of.doffs_px,
            same_for_all: !self.calibrations_differ,
            assumed: self.calibration_is_assumed,
        })
    }

    /// The truths by port, for programs.
    pub(super) fn truth_of_ports(&self) -> BTreeMap<String, Truth> {
        let of_port = |(port, truth): (&&str, &SeenTruth)| {
            let [min, median, max] = truth.spread().map(|number| number.map(f64::from));
            let (frames, density, unit) = (truth.frames as u64, truth.density(), truth.unit.to_owned());
            ((*port).to_owned(), Truth { frames, density, unit, min, median, max })
        };
        self.truths.iter().map(of_port).collect()
    }
}

/// Images of one size, pixels.
#[derive(JsonSchema, Serialize)]
pub(super) struct ImageSize {
    width: u32,
    height: u32,
    colour: bool,
    frames: u64,
}

/// The first calibration.
#[derive(JsonSchema, Serialize)]
pub(super) struct Calibration {
    focal_px: f64,
    cx_px: f64,
    cy_px: f64,
    baseline_m: f64,
    doffs_px: f64,
    same_for_all: bool,
    /// Whether it was assumed, not read from a file.
    assumed: bool,
}

/// A truth of the frames that were looked at.
#[derive(JsonSchema, Serialize)]
pub(super) struct Truth {
    frames: u64,
    /// The share of pixels that have one.
    density: f64,
    unit: String,
    min: Option<f64>,
    median: Option<f64>,
    max: Option<f64>,
}
