use super::*;
use crate::simd::every_level;
use crate::tiles::Serial;
use depthloom_threads::Budget;
use proptest::prelude::*;

const NO: i16 = -16;

fn filtered(smoother: &Smoother, map: &[i16], guide: &Guide<'_>, right: Option<&Right<'_>>, fill: bool) -> Vec<i16> {
    let mut out = map.to_vec();
    smoother.filter(&mut out, NO, guide, right, fill, &mut SmootherScratch::default(), &Serial);
    out
}

fn grey(samples: &[u8], width: usize) -> Guide<'_> {
    Guide { samples, width, height: samples.len() / width, channels: 1 }
}

/// Solves `(I + lambda L) u = f` in `f64` by Gaussian elimination with pivots.
fn solved(values: &[f64], affinities: &[f64], lambda: f64) -> Vec<f64> {
    let n = values.len();
    let mut rows = vec![vec![0.0; n + 1]; n];
    for i in 0..n {
        rows[i][i] += 1.0;
        rows[i][n] = values[i];
        if i + 1 < n {
            let weight = lambda * affinities[i];
            rows[i][i] += weight;
            rows[i + 1][i + 1] += weight;
            rows[i][i + 1] -= weight;
            rows[i + 1][i] -= weight;
        }
    }
    for pivot in 0..n {
        let best = (pivot..n).max_by(|&a, &b| rows[a][pivot].abs().total_cmp(&rows[b][pivot].abs())).unwrap();
        rows.swap(pivot, best);
        for i in 0..n {
            if i != pivot {
                let used = rows[pivot].clone();
                let factor = rows[i][pivot] / used[pivot];
                rows[i].iter_mut().zip(used).for_each(|(entry, used)| *entry -= factor * used);
            }
        }
    }
    (0..n).map(|i| rows[i][n] / rows[i][i]).collect()
}

#[test]
fn rows_and_columns_solve_the_papers_equations() {
    let guide: Vec<u8> = (0..23_u32).map(|i| (i * i * 7 % 11) as u8).collect();
    let map: Vec<i16> = (0..23_i32).map(|i| (i * 577 % 1009) as i16).collect();
    let affinities: Vec<f64> =
        guide.windows(2).map(|pair| (-f64::from(pair[0].abs_diff(pair[1])) / 3.0).exp()).collect();
    let values: Vec<f64> = map.iter().map(|&pixel| f64::from(pixel)).collect();
    let smoother = Smoother::new(Params { lambda: 40.0, sigma: 3.0, attenuation: 1.0, iterations: 1 });
    let expected = solved(&values, &affinities, 40.0);
    for width in [23, 1] {
        let found = filtered(&smoother, &map, &grey(&guide, width), None, true);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((f64::from(*found) - expected).abs() < 0.501, "width {width}: {found} is not {expected}");
        }
    }
}

#[test]
fn gaps_are_filled_from_their_side_of_an_edge() {
    let (width, height) = (40, 12);
    let guide: Vec<u8> = (0..width * height).map(|i| if i % width < 20 { 30 } else { 200 }).collect();
    let truth = |i: usize| if i % width < 20 { 100 } else { 700 };
    let gappy: Vec<i16> =
        (0..width * height).map(|i| if (10..25).contains(&(i % width)) { NO } else { truth(i) }).collect();
    let smoother = Smoother::new(Params::default());
    let found = filtered(&smoother, &gappy, &grey(&guide, width), None, true);
    assert!(found.iter().enumerate().all(|(i, &found)| (found - truth(i)).abs() <= 1), "{:?}", &found[..width]);
    let unfilled = filtered(&smoother, &gappy, &grey(&guide, width), None, false);
    assert!(unfilled.iter().zip(&gappy).all(|(&unfilled, &before)| (unfilled == NO) == (before == NO)));
}

#[test]
fn pixels_contradicted_by_the_right_view_are_replaced() {
    let (width, height) = (60, 20);
    let guide = vec![77; width * height];
    let mut left = vec![160_i16; width * height];
    for y in 8..11 {
        left[y * width + 30..][..4].fill(480);
    }
    let right = vec![-160_i16; width * height];
    let right = Right { disparity: &right, invalid: -1040, max_difference: 24, radius: 5 };
    let smoother = Smoother::new(Params::default());
    let found = filtered(&smoother, &left, &grey(&guide, width), Some(&right), true);
    assert!(found.iter().all(|&pixel| (pixel - 160).abs() <= 1), "{found:?}");
    let trusted = filtered(&smoother, &left, &grey(&guide, width), None, true);
    assert!(trusted[9 * width + 31] > 162, "without it they count: {}", trusted[9 * width + 31]);
}

#[test]
fn outside_the_valid_rectangle_and_beyond_reach_pixels_are_invalid() {
    let empty = vec![NO; 20];
    let guide: Vec<u8> = (0..20).map(|i| if i % 5 == 2 { 255 } else { 0 }).collect();
    let smoother = Smoother::new(Params::default());
    assert_eq!(filtered(&smoother, &empty, &grey(&guide, 5), None, true), empty);
    // Row 1 of 4, columns 1 to 3 of 5; the middle one is walled in by edges of 255.
    let mut lone = empty;
    (lone[6], lone[8]) = (80, 96);
    let found = filtered(&smoother, &lone, &grey(&guide, 5), None, true);
    assert_eq!(found, lone);
}

prop_compose! {
    fn frames()(
        (width, height) in (1..150_usize, 1..40_usize),
        channels in prop::sample::select(vec![1_usize, 3]),
        (gaps, flat, seed) in (0..3_u64, 0..8_u32, any::<u64>()),
    ) -> (usize, usize, usize, Vec<u8>, Vec<i16>, Vec<i16>) {
        let mut state = seed | 1;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state >> 32
        };
        let guide = (0..width * height * channels).map(|_| random() as u8 >> flat).collect();
        let mut map = |sign: i16, invalid: i16| -> Vec<i16> {
            (0..width * height)
                .map(|_| if random() % 10 < gaps { invalid } else { sign * (random() % 64) as i16 })
                .collect()
        };
        let (left, right) = (map(1, NO), map(-1, -1040));
        (width, height, channels, guide, left, right)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: if cfg!(miri) { 2 } else { 60 }, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_level_and_any_number_of_threads_give_the_same_bits(
        (width, height, channels, guide, left, right) in frames(),
        consistent in any::<bool>(),
        radius in 0..9_usize,
    ) {
        let guide = Guide { samples: &guide, width, height, channels };
        let right = Right { disparity: &right, invalid: -1040, max_difference: 24, radius };
        let right = consistent.then_some(&right);
        let smoother = Smoother::new(Params::default());
        let expected = every_level(|level| {
            let mut out = left.clone();
            smoother.filter_at(level, &mut out, NO, &guide, right, true, &mut SmootherScratch::default(), &Serial);
            out
        });
        let budget = Budget::new(3);
        let _own = budget.permit();
        let (mut scratch, mut threaded) = (SmootherScratch::default(), left.clone());
        // What another frame has left behind must not matter.
        smoother.filter(&mut right.map_or(left.clone(), |right| right.disparity.to_vec()), NO, &guide, None, true, &mut scratch, &budget);
        smoother.filter(&mut threaded, NO, &guide, right, true, &mut scratch, &budget);
        prop_assert_eq!(threaded, expected);
    }
}
