//! What the numbers of a prediction are, found by comparing one frame with its ground truth.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Pixels};
use depthloom_nodes::predictions::FileMap;
use depthloom_terminal::CliError;

use super::numbers;
use crate::args::{AlignOption, EvaluateArgs, ForEstimate, ProtocolOption, QuantityOption, UnitOption};

/// One frame with ground truth.
pub(super) struct Reference {
    position: usize,
    size: (u32, u32),
    /// Metres; not above 0 where it is unknown. Empty without ground truth.
    depth: Vec<f32>,
    calibration: Option<Calibration>,
}

impl Reference {
    pub(super) fn new<'a>(position: usize, outputs: impl Iterator<Item = (&'static str, &'a Value)>) -> Self {
        let mut found = Self { position, size: (0, 0), depth: Vec::new(), calibration: None };
        let mut disparity = Vec::new();
        for (port, value) in outputs {
            match (port, value) {
                ("left", Value::Image(image)) => {
                    found.size = match image.pixels() {
                        Pixels::Grey(grey) => grey.dimensions(),
                        Pixels::Rgb(rgb) => rgb.dimensions(),
                    };
                }
                ("calibration", Value::Calibration(calibration)) => found.calibration = Some((**calibration).clone()),
                ("depth", value) => found.depth = numbers(value).unwrap_or_default().to_vec(),
                ("disparity" | "disp_occ" | "disp_noc", value) => {
                    disparity = numbers(value).unwrap_or_default().to_vec();
                }
                _ => {}
            }
        }
        if let (true, Some(calibration)) = (found.depth.is_empty(), &found.calibration) {
            let metre_pixels = (calibration.focal_px * calibration.baseline_m) as f32;
            found.depth = disparity.iter().map(|px| metre_pixels / (px + calibration.doffs_px as f32)).collect();
        }
        found
    }

    pub(super) fn has_ground_truth(&self) -> bool {
        self.depth.iter().any(|metres| *metres > 0.0 && metres.is_finite())
    }

    pub(super) const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Its position among the frames.
    pub(super) const fn frame(&self) -> usize {
        self.position
    }

    /// Pairs of a number and the ground truth of its pixel, metres.
    fn pairs<'a>(&'a self, map: &'a FileMap, invalid: Option<f64>) -> impl Iterator<Item = (f64, f64)> + 'a {
        let (own, size) = (map.numbers.dimensions(), self.size);
        self.depth.iter().enumerate().filter_map(move |(at, metres)| {
            let (x, y) = (at as u32 % size.0, at as u32 / size.0);
            let nearest =
                |at: u32, own: u32, size: u32| (2 * u64::from(at) + 1) * u64::from(own) / (2 * u64::from(size));
            let number = map.numbers.get_pixel(nearest(x, own.0, size.0) as u32, nearest(y, own.1, size.1) as u32).0[0];
            let is_valid = number > 0.0 && Some(f64::from(number)) != invalid && *metres > 0.0 && metres.is_finite();
            is_valid.then(|| (f64::from(number), f64::from(*metres)))
        })
    }
}

/// What the numbers are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Detected {
    pub(super) quantity: QuantityOption,
    pub(super) unit: UnitOption,
    pub(super) divide_by: f64,
    /// Median ratio of the estimate to the ground truth, in its quantity; `None` if nothing could be compared.
    ratio: Option<f64>,
    /// Whether anything was not given.
    is_detected: bool,
}

/// Candidates: quantity, unit, divisor.
const CANDIDATES: [(QuantityOption, UnitOption, f64); 9] = [
    (QuantityOption::Depth, UnitOption::Metres, 1.0),
    (QuantityOption::Depth, UnitOption::Metres, 256.0),
    (QuantityOption::Depth, UnitOption::Millimetres, 1.0),
    (QuantityOption::Disparity, UnitOption::Pixels, 1.0),
    (QuantityOption::Disparity, UnitOption::Pixels, 256.0),
    (QuantityOption::Disparity, UnitOption::Pixels, 16.0),
    (QuantityOption::Disparity, UnitOption::Share, 1.0),
    (QuantityOption::InverseDepth, UnitOption::Metres, 1.0),
    (QuantityOption::InverseDepth, UnitOption::Millimetres, 1.0),
];

/// Numbers of a map that are compared.
const MOST_COMPARED: usize = 20_000;

pub(super) fn detect(
    args: &EvaluateArgs,
    name: &str,
    map: &FileMap,
    invalid: Option<f64>,
    reference: &Reference,
) -> Result<Detected, CliError> {
    let quantity = ForEstimate::value_for(&args.quantity, name).copied();
    let unit = ForEstimate::value_for(&args.unit, name).copied();
    let divide_by = ForEstimate::value_for(&args.divide_by, name).copied();
    if let Some(divisor) = divide_by
        && (divisor <= 0.0 || !divisor.is_finite())
    {
        return Err(CliError::usage(format!("--divide-by is {divisor}, expected a number above 0"), "correct it"));
    }
    let all: Vec<(f64, f64)> = reference.pairs(map, invalid).collect();
    let pairs: Vec<(f64, f64)> = all.iter().step_by(all.len().div_ceil(MOST_COMPARED).max(1)).copied().collect();
    let is_disparity_protocol = matches!(args.protocol, ProtocolOption::KittiStereo | ProtocolOption::Middlebury);
    let fits = |(of, in_unit, _): &(QuantityOption, UnitOption, f64)| {
        quantity.is_none_or(|quantity| quantity == *of)
            && unit.is_none_or(|unit| unit == *in_unit)
            && (!is_disparity_protocol || quantity.is_some() || *of == QuantityOption::Disparity)
            && (*of != QuantityOption::Disparity || reference.calibration.is_some())
    };
    let mut candidates: Vec<(QuantityOption, UnitOption, f64)> = CANDIDATES.into_iter().filter(fits).collect();
    if let Some(divisor) = divide_by {
        candidates.iter_mut().for_each(|candidate| candidate.2 = divisor);
    }
    if candidates.is_empty() {
        let what = format!("{name}: --unit does not fit the quantity, or a disparity has no calibration");
        return Err(CliError::usage(what, "depth is in metres or millimetres, disparity in pixels or share"));
    }
    // Depth and disparity differ in how ratios spread over the image; units differ in the median of the ratios.
    let judged = candidates.iter().map(|&(quantity, unit, divide_by)| {
        let mut logs: Vec<f64> = pairs
            .iter()
            .filter_map(|&(number, metres)| {
                let expected = reference.expected(quantity, unit, metres, map.numbers.width())?;
                Some((number / divide_by / expected).ln()).filter(|log| log.is_finite())
            })
            .collect();
        let middle = median(&mut logs);
        let mut apart: Vec<f64> = logs.iter().map(|log| (log - middle.unwrap_or(0.0)).abs()).collect();
        (Detected { quantity, unit, divide_by, ratio: middle.map(f64::exp), is_detected: false }, median(&mut apart))
    });
    let cost = |(detected, apart): &(Detected, Option<f64>)| {
        let off = detected.ratio.map_or(10.0, |ratio| ratio.ln().abs());
        // A wrong quantity spreads ratios; among equals the scale decides.
        4.0 * apart.unwrap_or(10.0) + off
    };
    let best = judged.min_by(|a, b| cost(a).total_cmp(&cost(b)));
    let (mut detected, _) = best.unwrap_or_else(|| unreachable!("there are candidates"));
    detected.is_detected = quantity.is_none() || unit.is_none() || divide_by.is_none();
    if detected.divide_by >= 256.0 && map.bits == 8 {
        detected.divide_by = 1.0;
    }
    Ok(detected)
}

impl Reference {
    /// The number that a depth would be.
    fn expected(&self, quantity: QuantityOption, unit: UnitOption, metres: f64, columns: u32) -> Option<f64> {
        let length = if unit == UnitOption::Millimetres { 1000.0 } else { 1.0 };
        Some(match quantity {
            QuantityOption::Depth => metres * length,
            QuantityOption::InverseDepth => 1.0 / (metres * length),
            QuantityOption::Disparity => {
                let calibration = self.calibration.as_ref()?;
                let px = calibration.focal_px * calibration.baseline_m / metres - calibration.doffs_px;
                let share = px / f64::from(self.size.0);
                if unit == UnitOption::Share { share } else { share * f64::from(columns) }
            }
        })
    }
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

impl Detected {
    pub(super) fn text(&self) -> String {
        let unit = match (self.quantity, self.unit) {
            (QuantityOption::Depth, UnitOption::Millimetres) => "depth in millimetres",
            (QuantityOption::Depth, _) => "depth in metres",
            (QuantityOption::InverseDepth, UnitOption::Millimetres) => "inverse depth in 1/mm",
            (QuantityOption::InverseDepth, _) => "inverse depth in 1/m",
            (QuantityOption::Disparity, UnitOption::Share) => "disparity as a share of the width",
            (QuantityOption::Disparity, _) => "disparity in pixels",
        };
        let divided = if self.divide_by == 1.0 { String::new() } else { format!(", divided by {}", self.divide_by) };
        let how = if self.is_detected { "detected" } else { "as given" };
        let ratio = self.ratio.map_or_else(String::new, |ratio| format!("; median ratio to ground truth {ratio:.3}"));
        format!("{unit}{divided} ({how}{ratio})")
    }

    /// Whether the scale looks wrong.
    pub(super) fn warning(&self, args: &EvaluateArgs) -> Option<String> {
        let is_aligned = match args.align {
            Some(align) => align != AlignOption::None,
            None => args.protocol == ProtocolOption::Monodepth2,
        };
        let ratio = self.ratio.filter(|ratio| !is_aligned && ratio.ln().abs() > 1.5_f64.ln());
        match (ratio, self.ratio) {
            (Some(ratio), _) => Some(format!(
                "its median is {ratio:.3} times the ground truth: check --quantity, --unit and --divide-by, or use --align"
            )),
            (None, None) => Some("no number of the first frame could be compared with ground truth".to_owned()),
            (None, Some(_)) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CANDIDATES, QuantityOption, UnitOption, median};

    #[test]
    fn the_median_of_an_even_number_is_the_upper() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0, 4.0]), Some(3.0));
        assert_eq!(median(&mut []), None);
    }

    #[test]
    fn every_unit_belongs_to_its_quantity() {
        for (quantity, unit, _) in CANDIDATES {
            let of_disparity = matches!(unit, UnitOption::Pixels | UnitOption::Share);
            assert_eq!(of_disparity, quantity == QuantityOption::Disparity);
        }
    }
}
