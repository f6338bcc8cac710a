//! Learning curves: loss and validation against the step, a panel per curve.
//!
//! A loss that is not finite interrupts its line; a step without a validation does not. A curve without a finite loss
//! has no panel.

use depthloom_graphs::values::Curve;

use crate::colours::{BLUE, RED, colour};
use crate::comparison::LINE_PT;
use crate::drawing::Stroke;
use crate::plot::{Axis, Entry, Item, Panel, Sheet, Swatch};

/// Learning curves with their labels.
pub fn learning_curves<'a>(curves: impl IntoIterator<Item = (&'a str, &'a Curve)>) -> Sheet {
    let curves: Vec<(&str, &Curve)> = curves.into_iter().collect();
    let panels = curves.iter().filter_map(|(label, curve)| panel(label, curve)).collect();
    let is_validated = curves.iter().any(|(_, curve)| curve.points.iter().any(|point| point.validation.is_some()));
    let entry = |(words, name)| Entry::new(words, Swatch::Line(Stroke::new(colour(name), LINE_PT)));
    let names = [("training", BLUE), ("validation", RED)].into_iter().take(1 + usize::from(is_validated));
    let legend = names.map(entry).collect();
    Sheet { columns: 2, legend, panels, ..Sheet::default() }
}

fn panel(label: &str, curve: &Curve) -> Option<Panel> {
    let points = || curve.points.iter();
    let training: Vec<(f64, f64)> = points().map(|point| (point.step as f64, point.loss)).collect();
    let validation: Vec<(f64, f64)> =
        points().filter_map(|point| Some((point.step as f64, point.validation?))).collect();
    let finite = training.iter().chain(&validation).filter(|(_, loss)| loss.is_finite());
    let last_step = finite.clone().map(|(step, _)| *step).reduce(f64::max)?;
    let losses = Axis::around(finite.map(|(_, loss)| *loss), 0.05, "loss");
    let mut panel = Panel::new(label, Axis::new(0.0, last_step.max(1.0), "step"), losses);
    // Validation last, since it has fewer points.
    for (points, name) in [(training, BLUE), (validation, RED)] {
        let stretches = points.split(|(_, loss)| !loss.is_finite()).filter(|stretch| !stretch.is_empty());
        panel.items.extend(stretches.map(|stretch| Item::curve(stretch.to_vec(), Stroke::new(colour(name), LINE_PT))));
    }
    Some(panel)
}

#[cfg(test)]
mod tests;
