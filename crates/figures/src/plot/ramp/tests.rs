use super::*;

#[test]
fn ends_are_the_ends_and_what_is_between_is_mixed() {
    let colour = |ramp, share| Bar { ramp, axis: Axis::new(0.0, 1.0, "") }.colour(share);
    assert_eq!(colour(SEQUENTIAL, -1.0), SEQUENTIAL[0]);
    assert_eq!(colour(SEQUENTIAL, 2.0), SEQUENTIAL[8]);
    assert_eq!(colour(DIVERGING, 0.5), [247; 3]);
    assert_eq!(colour(DIVERGING, 1.0 / 16.0), [50, 125, 184]);
}
