use super::*;

fn place(group: &str, variant: Option<usize>, name: &str) -> Place {
    Place {
        name: name.to_owned(),
        group: group.to_owned(),
        variant: variant.map(|variant| format!("v{variant}")),
        ..Place::default()
    }
}

/// The colour and dashes of each series on one panel.
fn lines(places: &[Place]) -> Vec<(Colour, &'static [f64])> {
    let all = Comparison(places.iter().collect(), Layout::Overlaid);
    (0..places.len()).map(|at| all.stroke(at)).map(|stroke| (stroke.colour, stroke.dashes)).collect()
}

#[test]
fn overlaid_variants_of_one_estimate_have_different_hues() {
    let places: Vec<Place> = (0..12).map(|variant| place("", Some(variant), "fused")).collect();
    let lines = lines(&places);
    assert_eq!(distinct(lines.iter().map(|(colour, _)| *colour)).len(), 12);
    assert!(lines.iter().all(|(_, dashes)| dashes.is_empty()), "{lines:?}");
}

#[test]
fn overlaid_estimates_of_one_variant_differ_in_line_style() {
    let own = (0..30).flat_map(|variant| ["mono", "fused"].map(|name| place("", Some(variant), name)));
    let places: Vec<Place> = std::iter::once(place("", None, "stereo")).chain(own).collect();
    let lines = lines(&places);
    assert_eq!(distinct(lines.iter().copied()).len(), places.len(), "no two lines are alike");
    for pair in lines[1..].chunks(2) {
        assert!(pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1, "{pair:?}");
    }
}

#[test]
fn overlaid_runs_have_different_hues() {
    let places: Vec<Place> = ["first", "second", "third"].map(|run| place(run, None, "stereo")).to_vec();
    assert_eq!(distinct(lines(&places).iter().map(|(colour, _)| *colour)).len(), 3);
}
