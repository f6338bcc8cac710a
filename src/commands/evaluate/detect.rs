//! What the numbers of a prediction are, found by comparing one frame with its ground truth.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Pixels};
use depthloom_nodes::predictions::{FileMap, nearest};
use depthloom_terminal::CliError;

use super::numbers;
use crate::args::{AlignOption, EvaluateArgs, ForEstimate, ProtocolOption, QuantityOption, UnitOption};

/// One frame with ground truth.
pub(super) struct Reference {
    size: (u32, u32),
    /// Ports that have a value.
    ports: Vec<&'static str>,
    /// Metres; not above 0 where it is unknown. Empty without ground truth.
    depth: Vec<f32>,
    calibration: Option<Calibration>,
}

impl Reference {
    pub(super) fn new<'a>(outputs: impl Iterator<Item = (&'static str, &'a Value)>) -> Self {
        let mut found = Self { size: (0, 0), ports: Vec::new(), depth: Vec::new(), calibration: None };
        let mut disparity = Vec::new();
        for (port, value) in outputs {
            found.ports.push(port);
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

    pub(super) fn has(&self, port: &str) -> bool {
        self.ports.contains(&port)
    }

    /// Pairs of a number and the ground truth of its pixel, metres.
    fn pairs<'a>(&'a self, map: &'a FileMap, invalid: Option<f64>) -> impl Iterator<Item = (f64, f64)> + 'a {
        let (own, size) = (map.numbers.dimensions(), self.size);
        self.depth.iter().enumerate().filter_map(move |(at, metres)| {
            let (x, y) = (at as u32 % size.0, at as u32 / size.0);
            let number = map.numbers.get_pixel(nearest(x, own.0, size.0), nearest(y, own.1, size.1)).0[0];
            let is_number = number.is_finite() && Some(f64::from(number)) != invalid;
            let is_valid = is_number && *metres > 0.0 && metres.is_finite();
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
    /// Whether the divisor was given, or the file has floats.
    is_divided: bool,
    /// Share of the pixels with ground truth that have a valid number.
    valid_share: f64,
    /// Share of the numbers that are 0.
    zero_share: f64,
    /// Whether the order of the numbers contradicts the quantity that was given.
    opposes: bool,
}

impl Default for Detected {
    fn default() -> Self {
        Self {
            quantity: QuantityOption::Depth,
            unit: UnitOption::Metres,
            divide_by: 1.0,
            ratio: None,
            is_detected: true,
            is_divided: true,
            valid_share: 0.0,
            zero_share: 0.0,
            opposes: false,
        }
    }
}

/// The correlation of ranks from which the order of the numbers decides between depth and its inverse.
const DECISIVE: f64 = 0.1;

/// Spearman's correlation of ranks of the numbers with depth; `None` where either is constant.
fn rank_correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let ranks = |value: fn(&(f64, f64)) -> f64| {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&a, &b| value(&pairs[a]).total_cmp(&value(&pairs[b])));
        let mut ranks = vec![0.0; pairs.len()];
        // Equal values have the mean of their ranks.
        for equal in order.chunk_by(|&a, &b| value(&pairs[a]) == value(&pairs[b])) {
            let below = order.partition_point(|&at| value(&pairs[at]) < value(&pairs[equal[0]]));
            equal.iter().for_each(|&at| ranks[at] = below as f64 + (equal.len() - 1) as f64 / 2.0);
        }
        ranks
    };
    let (one, two) = (ranks(|pair| pair.0), ranks(|pair| pair.1));
    let middle = pairs.len().saturating_sub(1) as f64 / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - middle) * (b - middle)).sum::<f64>();
    let scale = (product(&one, &one) * product(&two, &two)).sqrt();
    (scale > 0.0).then(|| product(&one, &two) / scale)
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
    let order = rank_correlation(&pairs);
    let is_disparity_protocol = args.protocol.is_of_disparity();
    if is_disparity_protocol && quantity.is_none() && order.is_some_and(|order| order > DECISIVE) {
        let what = format!(
            "{name}: the numbers grow with the distance, so they are depths, and this --protocol scores disparities"
        );
        return Err(CliError::usage(what, "choose another --protocol, or state `--quantity disparity`"));
    }
    // Scale and shift are unknown: the numbers are inverse depth, whatever their scale.
    let is_relative = args.align == Some(AlignOption::ScaleAndShift);
    let fits = |(of, in_unit, divisor): &(QuantityOption, UnitOption, f64)| {
        let is_depth = *of == QuantityOption::Depth;
        let is_in_order = match order {
            Some(order) if order.abs() > DECISIVE => is_depth == (order > 0.0),
            _ => true,
        };
        quantity.is_none_or(|quantity| quantity == *of)
            && (quantity.is_some() || is_in_order)
            && unit.is_none_or(|unit| unit == *in_unit)
            && (!is_disparity_protocol || *of == QuantityOption::Disparity)
            && (!is_relative || quantity.is_some() || unit.is_some() || *of != QuantityOption::Disparity)
            && (*of != QuantityOption::Disparity || reference.calibration.is_some())
            && (*divisor < 256.0 || map.bits > 8)
    };
    let mut candidates: Vec<(QuantityOption, UnitOption, f64)> = CANDIDATES.into_iter().filter(fits).collect();
    if let Some(divisor) = divide_by {
        candidates.iter_mut().for_each(|candidate| candidate.2 = divisor);
    }
    if candidates.is_empty() {
        let what = format!("{name}: --unit does not fit the quantity, or a disparity has no calibration");
        return Err(CliError::usage(what, "depth is in metres or millimetres, disparity in pixels or share"));
    }
    let judged = candidates.iter().map(|&(quantity, unit, divide_by)| {
        let ratio = |&(number, metres): &(f64, f64)| {
            let expected = reference.expected(quantity, unit, metres, map.numbers.width())?;
            Some((number / divide_by / expected).ln()).filter(|log| log.is_finite())
        };
        let mut logs: Vec<f64> = pairs.iter().filter(|(number, _)| *number > 0.0).filter_map(ratio).collect();
        Detected { quantity, unit, divide_by, ratio: median(&mut logs).map(f64::exp), ..Detected::default() }
    });
    let off = |detected: &Detected| detected.ratio.map_or(f64::MAX, |ratio| ratio.ln().abs());
    let best = judged.min_by(|a, b| off(a).total_cmp(&off(b)));
    let mut detected = best.unwrap_or_default();
    detected.is_detected = quantity.is_none() || unit.is_none() || divide_by.is_none();
    detected.is_divided = divide_by.is_some() || map.bits > 16;
    let with_truth = reference.depth.iter().filter(|metres| **metres > 0.0 && metres.is_finite()).count().max(1);
    let is_inverse = detected.quantity == QuantityOption::InverseDepth;
    let valid = all.iter().filter(|(number, _)| is_inverse || *number > 0.0).count();
    detected.valid_share = valid as f64 / with_truth as f64;
    detected.zero_share = all.iter().filter(|(number, _)| *number == 0.0).count() as f64 / all.len().max(1) as f64;
    detected.opposes = quantity.is_some_and(|quantity| {
        let is_depth = quantity == QuantityOption::Depth;
        order.is_some_and(|order| order.abs() > DECISIVE && is_depth != (order > 0.0))
    });
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
        let valid = 100.0 * self.valid_share;
        format!("{unit}{divided} ({how}{ratio}); {valid:.1} % of the pixels with ground truth are valid")
    }

    /// Whether anything of the frame could be compared.
    pub(super) const fn is_compared(&self) -> bool {
        self.ratio.is_some()
    }

    /// What looks wrong.
    pub(super) fn warnings(&self, args: &EvaluateArgs) -> Vec<String> {
        let is_aligned = match args.align {
            Some(align) => align != AlignOption::None,
            None => args.protocol == ProtocolOption::Monodepth2,
        };
        // Of whole numbers the divisor is a guess: a deviation that floats may have is suspicious.
        let most: f64 = if self.is_divided { 1.5 } else { 1.15 };
        let ratio = self.ratio.filter(|ratio| !is_aligned && ratio.ln().abs() > most.ln());
        let is_inverse = self.quantity == QuantityOption::InverseDepth;
        let is_of_disparity = args.protocol.is_of_disparity();
        let align = if is_of_disparity { "" } else { ", or use --align" };
        let warnings = [
            ratio.map(|ratio| {
                format!("its median is {ratio:.3} times the ground truth: check --quantity, --unit and --divide-by{align}")
            }),
            self.ratio.is_none().then(|| "no number of its first frames could be compared with ground truth".to_owned()),
            self.opposes.then(|| "its numbers contradict --quantity: they change with the distance the other way".to_owned()),
            (is_inverse && self.zero_share > 0.01).then(|| {
                let percent = 100.0 * self.zero_share;
                format!("{percent:.0} % of its numbers are 0, which is the largest depth: set --invalid 0 if they mean invalid")
            }),
        ];
        warnings.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{CANDIDATES, QuantityOption, UnitOption, median, rank_correlation};

    #[test]
    fn the_median_of_an_even_number_is_the_upper() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0, 4.0]), Some(3.0));
        assert_eq!(median(&mut []), None);
    }

    #[test]
    fn ranks_show_whether_numbers_grow_with_depth() {
        let correlation = |number: fn(f64) -> f64| {
            let pairs: Vec<(f64, f64)> = (1..50).map(|at| (number(f64::from(at)), f64::from(at))).collect();
            rank_correlation(&pairs)
        };
        assert!(correlation(|metres| metres / 80.0).is_some_and(|order| (order - 1.0).abs() < 1e-9));
        assert!(correlation(|metres| 0.3 - 1.0 / metres).is_some_and(|order| (order - 1.0).abs() < 1e-9));
        assert!(correlation(|metres| -metres).is_some_and(|order| (order + 1.0).abs() < 1e-9));
        assert_eq!(correlation(|_| 4.0), None);
        // SciPy: spearmanr([1, 2, 2, 3], [1, 2, 3, 4]) is 0.9486832980505139.
        let ties = rank_correlation(&[(1.0, 1.0), (2.0, 2.0), (2.0, 3.0), (3.0, 4.0)]).expect("it varies");
        assert!((ties - 0.948_683_298_050_513_9).abs() < 1e-12, "{ties}");
    }

    #[test]
    fn every_unit_belongs_to_its_quantity() {
        for (quantity, unit, _) in CANDIDATES {
            let of_disparity = matches!(unit, UnitOption::Pixels | UnitOption::Share);
            assert_eq!(of_disparity, quantity == QuantityOption::Disparity);
        }
    }
}
