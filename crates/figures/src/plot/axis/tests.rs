use super::*;

#[test]
fn fault_37_ticks_have_the_digits_they_need() {
    let ticks = [20.0, 1.0, 0.1 + 0.2, 0.000_6 * 8.0, 4.800_000_000_000_000_4e-3, 5e-7, 2e6, 0.0, -0.0, -1.5, 12_345.0];
    let short = ticks.map(short);
    assert_eq!(short, ["20", "1", "0.3", "0.0048", "0.0048", "5e−7", "2e6", "0", "0", "−1.5", "12345"]);
}

#[test]
fn ticks_are_round_and_few() {
    assert_eq!(steps(0.0, 80.0, 9.0), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0]);
    assert_eq!(steps(-0.3, 0.7, 5.0), [-0.2, 0.0, 0.2, 0.4, 0.6000000000000001]);
    assert_eq!(ratios(1.0, 80.0, 9.0), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]);
    assert_eq!(ratios(0.001, 1000.0, 7.0).len(), 7);
    assert_eq!(ratios(3.1, 4.4, 5.0), [3.5, 4.0]);
}

#[test]
fn values_lie_where_they_belong() {
    assert_eq!(Axis::new(0.0, 10.0, "").place(5.0), 0.5);
    assert!((Axis::log(1.0, 100.0, "").place(10.0) - 0.5).abs() < 1e-12);
    assert!(Axis::new(3.0, 3.0, "").high > 3.0, "an axis has a length");
}
