//! Contradictions between images, calibration and ground truth of a frame, which readers accept and metrics do not
//! show.

mod pair;
mod reduced;
mod truth;
mod votes;

use depthloom_graphs::values::Calibration;
use depthloom_graphs::{Port, Value};

use truth::Truth;

/// What contradicts itself in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contradiction {
    /// What it is about: the port whose value is most probably wrong.
    pub port: &'static str,
    /// A lower-case fragment.
    pub what: String,
    /// What can be done about it.
    pub remedy: &'static str,
}

/// Looks at a frame of a source with these ports: at `left`, `right`, `calibration` and its ground-truth depths, as far
/// as they are there.
#[must_use]
pub fn inspect(ports: &[Port], values: &[Option<Value>]) -> Vec<Contradiction> {
    let value = |name: &str| {
        let at = ports.iter().position(|port| port.name == name)?;
        values.get(at)?.as_ref()
    };
    let image = |name: &str| match value(name) {
        Some(Value::Image(image)) => Some(&**image),
        _ => None,
    };
    let calibration = match value("calibration") {
        Some(Value::Calibration(calibration)) => Some(&**calibration),
        _ => None,
    };
    let mut found = Vec::new();
    let left = image("left");
    if let (Some(calibration), Some(left)) = (calibration, left) {
        found.extend(calibration_and_image(calibration, left.dimensions()));
    }
    let right = image("right");
    let (pair_faults, votes) = left.zip(right).map(|(left, right)| pair::faults(left, right)).unwrap_or_default();
    found.extend(pair_faults);
    let truths = ports.iter().zip(values).filter_map(|(port, value)| Truth::from_value(port.name, value.as_ref()?));
    let truths: Vec<Truth<'_>> = truths.collect();
    // A depth is computed from the disparity of the same frame: its faults are reported once, for the depth.
    let of_depth = truths.iter().any(Truth::is_depth);
    let is_disparity = truths.iter().any(|of| !of.is_depth());
    for truth in truths.iter().filter(|of| of.is_depth() == of_depth) {
        found.extend(truth.fault(calibration, votes.as_ref(), is_disparity));
    }
    found
}

/// A camera sees from about 5 to 170 degrees across.
const FOCAL_PER_WIDTH: std::ops::RangeInclusive<f64> = 0.04..=12.0;

fn calibration_and_image(calibration: &Calibration, (width, height): (u32, u32)) -> Vec<Contradiction> {
    let mut found = Vec::new();
    let mut add = |what: String, remedy| found.push(Contradiction { port: "calibration", what, remedy });
    if (calibration.width, calibration.height) != (width, height) {
        let (w, h) = (calibration.width, calibration.height);
        add(
            format!("the calibration is of {w}x{h}, and the image is {width}x{height}"),
            "images must have the size they were calibrated with",
        );
    }
    let (cx, cy) = (calibration.cx_px, calibration.cy_px);
    let inside = |at: f64, count: u32| (0.0..f64::from(count)).contains(&at);
    if !inside(cx, width) || !inside(cy, height) {
        add(
            format!("the principal point ({cx:.1}, {cy:.1}) px lies outside of the image of {width}x{height}"),
            "was the calibration made with images of another size, or is it that of another camera?",
        );
    }
    let focal = calibration.focal_px;
    if !FOCAL_PER_WIDTH.contains(&(focal / f64::from(width))) {
        let degrees = 2.0 * (0.5 * f64::from(width) / focal).atan().to_degrees();
        add(
            format!("with a focal length of {focal} px an image {width} px wide sees {degrees:.1} degrees"),
            "is the focal length in pixels, and of images of this size?",
        );
    }
    found
}

const FEWEST: usize = 20;
