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
    Curve { points: (0..).zip(losses).map(point).collect() }
}

#[test]
fn a_loss_that_is_not_finite_interrupts_its_line_and_a_missing_validation_does_not() {
    let items = panel("", &curve(&[4.0, 3.0, f64::NAN, 2.0, 1.0])).unwrap().items;
    let points: Vec<&[(f64, f64)]> = items
        .iter()
        .map(|item| match item {
            Item::Line(points, _) | Item::Dots(points, ..) => points.as_slice(),
            _ => &[],
        })
        .collect();
    let (training, validation) = points.split_at(2);
    assert_eq!(training, [[(0.0, 4.0), (100.0, 3.0)], [(300.0, 2.0), (400.0, 1.0)]]);
    assert_eq!(validation, [[(0.0, 6.0)], [(400.0, 1.5)]]);
    assert!(items.iter().skip(2).all(|item| matches!(item, Item::Dots(..))), "a point alone is a dot");
    let complete = panel("", &curve(&[4.0, 3.0, 2.0])).unwrap().items;
    assert!(matches!(&complete[1], Item::Line(points, _) if *points == [(0.0, 6.0), (200.0, 3.0)]));
}

#[test]
fn losses_over_decades_have_a_logarithmic_axis_unless_one_is_not_positive() {
    let logarithmic = |losses: &[f64]| panel("", &curve(losses)).unwrap().y.scale == Scale::Log;
    assert!(logarithmic(&[40.0, 3.0, 0.2]));
    assert!(!logarithmic(&[4.0, 3.0, 2.0]));
    assert!(!logarithmic(&[40.0, 3.0, -0.2]));
    assert!(!logarithmic(&[40.0, 3.0, 0.0]));
}

#[test]
fn equal_numbers_give_equal_bytes() {
    let curves = [curve(&[40.0, 3.0, 0.2]), curve(&[1.0, f64::NAN, f64::INFINITY, 0.5]), curve(&[])];
    let render =
        |curves: &[Curve]| learning_curves(curves.iter().map(|curve| ("learn/train", curve))).drawing().unwrap().svg();
    let svg = render(&curves);
    assert!(svg == render(&curves), "two renderings of one figure differ");
    assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "no coordinate is missing");
    assert_eq!(svg, render(&curves[..2]), "a curve without points has no panel");
    assert!(render(&curves[2..]).trim_end().ends_with("</svg>"), "nothing to draw is an empty figure");
}
