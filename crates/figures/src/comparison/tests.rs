use super::*;

#[test]
fn twelve_variants_of_one_method_have_twelve_lines() {
    let place = |at: usize| Place {
        name: "fused".to_owned(),
        group: String::new(),
        variant: Some(format!("v{at}")),
        ..Place::default()
    };
    let places: Vec<Place> = (0..12).map(place).collect();
    let all = Comparison(places.iter().collect(), Layout::Overlaid);
    let lines = distinct((0..12).map(|at| {
        let stroke = all.stroke(at);
        (stroke.colour, stroke.dashes)
    }));
    assert_eq!(lines.len(), 12);
}
