//! Every instruction set gives the bits of the definition, on any image, with any parameters and any number of threads.

use depthloom_kernels::census::{Census, CensusScratch, Error, Pair, Params, compute, compute_at};
use depthloom_kernels::simd::Level;
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use proptest::prelude::{ProptestConfig, any, proptest};
use proptest::sample::select;
use proptest::{prop_assert_eq, prop_compose};
use support::{Backwards, images};

mod plain_census;
mod support;

#[derive(Clone, Debug)]
struct Case {
    params: Params,
    width: usize,
    height: usize,
    left: Vec<u8>,
    right: Vec<u8>,
}

prop_compose! {
    fn cases()(
        (width, height) in (1..170_usize, 1..40_usize),
        (vectors, min_disparity) in (select(vec![1, 2, 3, 4, 4, 5, 6, 8, 12, 16]), select(vec![0, 0, -7, 5, 40, -200])),
        census in select(vec![Census::Symmetric, Census::Full, Census::OffAxis]),
        paths in select(vec![4, 8]),
        (p1, p2) in (0..=224_i32, 0..=224_i32),
        (uniqueness, subpixel, lr_max_diff) in (select(vec![0, 5, 5, 20, 99]), any::<bool>(), -1..4_i32),
        (shift, grain, seed) in (0..40_usize, select(vec![0_u32, 0, 5, 7]), any::<u64>()),
    ) -> Case {
        let p2 = p2 % (256 - census.bits());
        let params = Params {
            min_disparity, disparities: 16 * vectors, p1: p1 % (p2 + 1), p2, uniqueness, subpixel, lr_max_diff, census, paths,
        };
        let (left, right) = images(width * height, shift, grain, seed);
        Case { params, width, height, left, right }
    }
}

impl Case {
    fn pair(&self) -> Pair<'_> {
        Pair { left: &self.left, right: &self.right, width: self.width, height: self.height }
    }

    fn run(&self, level: Level, scratch: &mut CensusScratch, tiles: &dyn Tiles) -> Vec<i16> {
        let mut out = vec![i16::MIN; self.width * self.height];
        compute_at(level, &self.pair(), &self.params, scratch, tiles, &mut out).expect("parameters are legal");
        out
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn every_level_equals_the_definition(case in cases(), other in cases()) {
        let mut scratch = CensusScratch::default();
        // What another frame has left behind must not matter.
        other.run(Level::best(), &mut scratch, &Serial);
        let mut plain = vec![i16::MIN; case.width * case.height];
        plain_census::compute(&case.pair(), &case.params, &mut plain);
        for level in Level::available() {
            prop_assert_eq!(&case.run(level, &mut scratch, &Serial), &plain, "{:?}", level);
            prop_assert_eq!(&case.run(level, &mut scratch, &Backwards), &plain, "{:?} backwards", level);
        }
        let budget = Budget::new(3);
        let _own = budget.permit();
        let threaded = case.run(Level::best(), &mut scratch, &budget);
        prop_assert_eq!(&threaded, &plain, "three threads");
    }
}

#[test]
fn a_shifted_texture_has_its_shift_as_disparity() {
    let (width, height) = (160, 30);
    let (left, _) = images(width * height, 0, 0, 5);
    let right: Vec<u8> = (0..left.len()).map(|i| left[(i + 23) % left.len()]).collect();
    for (paths, min_disparity) in [(4, 0), (8, -10), (8, 16)] {
        let params = Params { paths, min_disparity, ..Params::default() };
        let case = Case { params, width, height, left: left.clone(), right: right.clone() };
        for level in Level::available() {
            let out = case.run(level, &mut CensusScratch::default(), &Serial);
            for y in 4..height - 4 {
                for x in 100..width - 20 {
                    let px = f32::from(out[y * width + x]) / 16.0;
                    assert!((px - 23.0).abs() <= 0.5, "{level:?}, row {y}, column {x}: {px}");
                }
            }
        }
    }
}

#[test]
fn parameters_are_checked_before_anything_is_written() {
    let image = [7; 40];
    let pair = Pair { left: &image, right: &image, width: 10, height: 4 };
    let params = Params { p2: 250, ..Params::default() };
    let mut out = [3; 40];
    let error = compute(&pair, &params, &mut CensusScratch::default(), &Serial, &mut out).unwrap_err();
    assert!(matches!(&error, Error::Param(refused) if refused.name == "p2"), "{error:?}");
    assert_eq!(error.to_string(), "p2 is 250, outside 0..=224: with features of 31 bits, costs must fit a byte");
    assert_eq!(out, [3; 40]);
}
