//! The figure of the learning curves: loss and validation against the step, a panel a curve.
//!
//! Training is blue, validation red. Losses that are all positive and differ by more than a factor of ten have a logarithmic axis.
//! A loss that is no finite number interrupts its line; a step without a validation does not. A curve without a finite loss has no
//! panel.

use kuva::plot::legend::{LegendEntry, LegendShape};
use kuva::plot::{LinePlot, ScatterPlot};
use kuva::render::figure::Figure as Sheet;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;

use super::LearningCurve;
use crate::colours::{BLUE, RED};
use crate::figure::{LONE_PANEL_PX, PANEL_PX, styled, svg};

/// Losses that differ by more than this have a logarithmic axis.
const DECADE: f64 = 10.0;

/// The figure as SVG; equal numbers give equal bytes.
pub(crate) fn render(curves: &[LearningCurve]) -> String {
    let panels: Vec<_> = curves.iter().map(|curve| (curve, Panel::of(curve))).collect();
    let panels: Vec<_> = panels.into_iter().filter(|(_, panel)| panel.points().next().is_some()).collect();
    let columns = panels.len().clamp(1, 2);
    let rows = panels.len().div_ceil(columns).max(1);
    let mut plots = Vec::new();
    let mut layouts = Vec::new();
    for (place, (curve, panel)) in panels.iter().enumerate() {
        let mut layout = panel.layout().with_title(curve.label.as_str());
        if place % columns == 0 {
            layout = layout.with_y_label("loss");
        }
        if place + columns >= panels.len() {
            layout = layout.with_x_label("step");
        }
        plots.push(panel.plots());
        layouts.push(layout);
    }
    let (width_px, height_px) = if panels.len() == 1 { LONE_PANEL_PX } else { PANEL_PX };
    let sheet = Sheet::new(rows, columns)
        .with_structure((0..panels.len()).map(|panel| vec![panel]).collect())
        .with_plots(plots)
        .with_layouts(layouts)
        .with_cell_size(width_px, height_px)
        .with_spacing(8.0)
        .with_title("Learning curves")
        .with_title_size(17)
        // Below the panels: a curve may go through any corner.
        .with_shared_legend_entries(legend(panels.iter().any(|(_, panel)| !panel.validation.is_empty())))
        .with_shared_legend_bottom();
    svg(sheet)
}

/// What a panel draws: steps and losses, in stretches without a gap.
struct Panel {
    training: Vec<Vec<(f64, f64)>>,
    validation: Vec<Vec<(f64, f64)>>,
}

impl Panel {
    fn of(curve: &LearningCurve) -> Self {
        let points = curve.curve.points.iter();
        let training: Vec<(f64, f64)> = points.clone().map(|point| (point.step as f64, point.loss)).collect();
        let validation: Vec<(f64, f64)> =
            points.filter_map(|point| Some((point.step as f64, point.validation?))).collect();
        Self { training: stretches(&training), validation: stretches(&validation) }
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.training.iter().chain(&self.validation).flatten().copied()
    }

    /// The axes: steps from zero, losses with a little room around them.
    fn layout(&self) -> Layout {
        let last_step = self.points().map(|(step, _)| step).fold(1.0, f64::max);
        let low = self.points().map(|(_, loss)| loss).fold(f64::INFINITY, f64::min);
        let high = self.points().map(|(_, loss)| loss).fold(f64::NEG_INFINITY, f64::max);
        let logarithmic = low > 0.0 && high > DECADE * low;
        let (low, high) = if logarithmic {
            let room = (high / low).powf(0.05);
            (low / room, high * room)
        } else {
            let room = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
            // The axis of losses that cannot be negative does not promise any.
            let below = if low >= 0.0 { (low - room).max(0.0) } else { low - room };
            (below, high + room)
        };
        let layout = styled(Layout::new((0.0, last_step), (low, high)))
            .with_x_axis_min(0.0)
            .with_x_axis_max(last_step)
            .with_y_axis_min(low)
            .with_y_axis_max(high);
        if logarithmic { layout.with_log_y() } else { layout }
    }

    /// Lines, and a dot where a stretch is a single point; validation last, since it has the fewer points.
    fn plots(&self) -> Vec<Plot> {
        let coloured = self.training.iter().map(|stretch| (stretch, BLUE));
        let coloured = coloured.chain(self.validation.iter().map(|stretch| (stretch, RED)));
        let plot = |(stretch, colour): (&Vec<(f64, f64)>, &str)| {
            let points = stretch.iter().copied();
            if stretch.len() == 1 {
                Plot::Scatter(ScatterPlot::new().with_data(points).with_color(colour).with_size(3.0))
            } else {
                Plot::Line(LinePlot::new().with_data(points).with_color(colour).with_stroke_width(1.8))
            }
        };
        coloured.map(plot).collect()
    }
}

fn legend(validated: bool) -> Vec<LegendEntry> {
    let entry = |label: &str, colour: &str| LegendEntry {
        label: label.to_owned(),
        color: colour.to_owned(),
        shape: LegendShape::Line,
        dasharray: None,
    };
    [entry("training", BLUE)].into_iter().chain(validated.then(|| entry("validation", RED))).collect()
}

/// Points in stretches of finite losses.
fn stretches(points: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let split = points.split(|(_, loss)| !loss.is_finite());
    split.filter(|stretch| !stretch.is_empty()).map(<[_]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Curve, CurvePoint};

    use super::*;
    use crate::leading::Lead;

    fn curve(losses: &[f64]) -> LearningCurve {
        let point = |(step, &loss): (u64, &f64)| CurvePoint {
            step: 100 * step,
            loss,
            validation: step.is_multiple_of(2).then_some(1.5 * loss),
            learning_rate: 1e-3,
        };
        let points = (0..).zip(losses).map(point).collect();
        LearningCurve {
            label: "learn/teacher".to_owned(),
            lead: Lead::default(),
            node: "teacher".to_owned(),
            curve: Curve { points },
        }
    }

    #[test]
    fn a_loss_that_is_no_number_interrupts_its_line_and_a_missing_validation_does_not() {
        let panel = Panel::of(&curve(&[4.0, 3.0, f64::NAN, 2.0, 1.0]));
        assert_eq!(panel.training, [vec![(0.0, 4.0), (100.0, 3.0)], vec![(300.0, 2.0), (400.0, 1.0)]]);
        assert_eq!(panel.validation, [vec![(0.0, 6.0)], vec![(400.0, 1.5)]]);
        let whole = Panel::of(&curve(&[4.0, 3.0, 2.0]));
        assert_eq!(whole.validation, [vec![(0.0, 6.0), (200.0, 3.0)]]);
        assert!(whole.plots().iter().all(|plot| matches!(plot, Plot::Line(_))));
        assert!(panel.plots().iter().skip(2).all(|plot| matches!(plot, Plot::Scatter(_))), "a point alone is a dot");
    }

    #[test]
    fn losses_over_decades_have_a_logarithmic_axis_unless_one_is_not_positive() {
        let logarithmic = |losses: &[f64]| Panel::of(&curve(losses)).layout().log_y;
        assert!(logarithmic(&[40.0, 3.0, 0.2]));
        assert!(!logarithmic(&[4.0, 3.0, 2.0]));
        assert!(!logarithmic(&[40.0, 3.0, -0.2]));
        assert!(!logarithmic(&[40.0, 3.0, 0.0]));
    }

    #[test]
    fn equal_numbers_give_equal_bytes() {
        let curves = [curve(&[40.0, 3.0, 0.2]), curve(&[1.0, f64::NAN, f64::INFINITY, 0.5]), curve(&[])];
        let svg = render(&curves);
        assert!(svg == render(&curves), "two renderings of one figure differ");
        assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "no coordinate is missing");
        assert_eq!(svg, render(&curves[..2]), "a curve without points has no panel");
        assert!(render(&curves[2..]).trim_end().ends_with("</svg>"), "nothing to draw is an empty figure");
    }
}
