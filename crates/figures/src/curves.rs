//! The figure of the learning curves: loss and validation against the step, a panel a curve.
//!
//! Training is blue, validation red. Losses that are all positive and differ by more than a factor of ten have a logarithmic axis.
//! A loss that is no finite number interrupts its line; a step without a validation does not. A curve without a finite loss has no
//! panel.

use depthloom_graphs::values::Curve;

use crate::colours::{BLUE, RED};
use crate::drawing::{Drawing, Fill, Stroke, colour};
use crate::plot::{Axis, Entry, Item, Panel as Plot, Sheet, Size, Swatch};

/// Losses that differ by more than this have a logarithmic axis.
const DECADE: f64 = 10.0;
const LINE_PT: f64 = 1.2;

/// Learning curves by label.
///
/// # Errors
/// What is wrong with its size, in words.
pub fn learning_curves(curves: &[(&str, &Curve)], title: &str, size: Size) -> Result<Drawing, String> {
    let panels: Vec<_> = curves.iter().map(|(label, curve)| (*label, Panel::of(curve))).collect();
    let panels: Vec<_> = panels.into_iter().filter(|(_, panel)| panel.points().next().is_some()).collect();
    let columns = if size.is_wide() { panels.len().clamp(1, 2) } else { 1 };
    let mut plots = Vec::new();
    for (place, (label, panel)) in panels.iter().enumerate() {
        let (mut x, mut y) = panel.axes();
        if place % columns == 0 {
            "loss".clone_into(&mut y.label);
        }
        if place + columns >= panels.len() {
            "step".clone_into(&mut x.label);
        }
        let aspect = if columns == 1 && size.is_wide() { 0.45 } else { 0.62 };
        plots.push(Plot { title: Some((*label).to_owned()), items: panel.items(), aspect, ..Plot::new(x, y) });
    }
    let validated = panels.iter().any(|(_, panel)| !panel.validation.is_empty());
    let line = |colour_of: &str| Swatch::Line(Stroke::new(colour(colour_of), LINE_PT));
    let mut legend = vec![Entry::new("training", line(BLUE))];
    legend.extend(validated.then(|| Entry::new("validation", line(RED))));
    let sheet = Sheet {
        width_pt: size.width_pt(),
        height_pt: size.height_pt(),
        columns,
        title: title.to_owned(),
        panels: plots,
        legend,
        ..Sheet::default()
    };
    sheet.drawing()
}

/// What a panel draws: steps and losses, in stretches without a gap.
struct Panel {
    training: Vec<Vec<(f64, f64)>>,
    validation: Vec<Vec<(f64, f64)>>,
}

impl Panel {
    fn of(curve: &Curve) -> Self {
        let points = curve.points.iter();
        let training: Vec<(f64, f64)> = points.clone().map(|point| (point.step as f64, point.loss)).collect();
        let validation: Vec<(f64, f64)> =
            points.filter_map(|point| Some((point.step as f64, point.validation?))).collect();
        Self { training: stretches(&training), validation: stretches(&validation) }
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.training.iter().chain(&self.validation).flatten().copied()
    }

    /// The axes: steps from zero, losses with a little room around them.
    fn axes(&self) -> (Axis, Axis) {
        let last_step = self.points().map(|(step, _)| step).fold(1.0, f64::max);
        let low = self.points().map(|(_, loss)| loss).fold(f64::INFINITY, f64::min);
        let high = self.points().map(|(_, loss)| loss).fold(f64::NEG_INFINITY, f64::max);
        let steps = Axis::new(0.0, last_step, "");
        if low > 0.0 && high > DECADE * low {
            let room = libm::pow(high / low, 0.05);
            return (steps, Axis::log(low / room, high * room, ""));
        }
        let room = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
        // The axis of losses that cannot be negative does not promise any.
        let below = if low >= 0.0 { (low - room).max(0.0) } else { low - room };
        (steps, Axis::new(below, high + room, ""))
    }

    /// Lines, and a dot where a stretch is a single point; validation last, since it has the fewer points.
    fn items(&self) -> Vec<Item> {
        let coloured = self.training.iter().map(|stretch| (stretch, BLUE));
        let coloured = coloured.chain(self.validation.iter().map(|stretch| (stretch, RED)));
        let item = |(stretch, tint): (&Vec<(f64, f64)>, &str)| {
            let (points, tint) = (stretch.clone(), colour(tint));
            match stretch.len() {
                1 => Item::Dots { points, radius: 1.5, fill: Fill::new(tint, 1.0) },
                _ => Item::Line { points, stroke: Stroke::new(tint, LINE_PT) },
            }
        };
        coloured.map(item).collect()
    }
}

/// Points in stretches of finite losses.
fn stretches(points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let split = points.split(|(_, loss)| !loss.is_finite());
    split.filter(|stretch| !stretch.is_empty()).map(<[_]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::CurvePoint;

    use super::*;
    use crate::plot::Scale;

    fn curve(losses: &[f64]) -> Curve {
        let point = |(step, &loss): (u64, &f64)| CurvePoint {
            step: 100 * step,
            loss,
            validation: step.is_multiple_of(2).then_some(1.5 * loss),
            learning_rate: 1e-3,
        };
        let points = (0..).zip(losses).map(point).collect();
        Curve { points }
    }

    #[test]
    fn a_loss_that_is_no_number_interrupts_its_line_and_a_missing_validation_does_not() {
        let panel = Panel::of(&curve(&[4.0, 3.0, f64::NAN, 2.0, 1.0]));
        assert_eq!(panel.training, [vec![(0.0, 4.0), (100.0, 3.0)], vec![(300.0, 2.0), (400.0, 1.0)]]);
        assert_eq!(panel.validation, [vec![(0.0, 6.0)], vec![(400.0, 1.5)]]);
        let whole = Panel::of(&curve(&[4.0, 3.0, 2.0]));
        assert_eq!(whole.validation, [vec![(0.0, 6.0), (200.0, 3.0)]]);
        assert!(whole.items().iter().all(|item| matches!(item, Item::Line { .. })));
        assert!(panel.items().iter().skip(2).all(|item| matches!(item, Item::Dots { .. })), "a point alone is a dot");
    }

    #[test]
    fn losses_over_decades_have_a_logarithmic_axis_unless_one_is_not_positive() {
        let logarithmic = |losses: &[f64]| Panel::of(&curve(losses)).axes().1.scale == Scale::Log;
        assert!(logarithmic(&[40.0, 3.0, 0.2]));
        assert!(!logarithmic(&[4.0, 3.0, 2.0]));
        assert!(!logarithmic(&[40.0, 3.0, -0.2]));
        assert!(!logarithmic(&[40.0, 3.0, 0.0]));
    }

    #[test]
    fn equal_numbers_give_equal_bytes() {
        let curves = [curve(&[40.0, 3.0, 0.2]), curve(&[1.0, f64::NAN, f64::INFINITY, 0.5]), curve(&[])];
        let labelled: Vec<(&str, &Curve)> = curves.iter().map(|curve| ("learn/teacher", curve)).collect();
        let render = |curves: &[(&str, &Curve)]| learning_curves(curves, "", Size::default()).unwrap().svg();
        let svg = render(&labelled);
        assert!(svg == render(&labelled), "two renderings of one figure differ");
        assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "no coordinate is missing");
        assert_eq!(svg, render(&labelled[..2]), "a curve without points has no panel");
        assert!(render(&labelled[2..]).trim_end().ends_with("</svg>"), "nothing to draw is an empty figure");
    }
}
