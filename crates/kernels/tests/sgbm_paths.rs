//! Every implementation gives the bits of the plain twin, on any image, with any parameters and any number of threads.

use depthloom_kernels::sgbm::{Error, Maps, Mode, Params, Path, SgbmScratch, View, compute_maps, compute_on};
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use proptest::prelude::{Just, ProptestConfig, Strategy, any, prop_oneof, proptest};
use proptest::sample::select;
use proptest::{prop_assert_eq, prop_compose};
use support::{Backwards, images};

mod support;

#[derive(Clone, Debug)]
struct Case {
    params: Params,
    width: usize,
    height: usize,
    channels: usize,
    left: Vec<u8>,
    right: Vec<u8>,
}

prop_compose! {
    fn cases()(
        mode in select(vec![Mode::Sgbm, Mode::Hh, Mode::ThreeWay, Mode::Hh4]),
        vectors in select(if cfg!(miri) { vec![1] } else { vec![1, 2, 3, 4, 5, 6, 8] }),
        min_disparity in prop_oneof![Just(0), -40..40_i32],
        columns in if cfg!(miri) { 64..67_usize } else { 20..180 },
        height in if cfg!(miri) { 17..19_usize } else { 1..40 },
        channels in select(if cfg!(miri) { vec![1_usize] } else { vec![1, 3] }),
        block in select(if cfg!(miri) { vec![1, 3] } else { vec![1, 3, 5, 7, 9, 11, 31] }),
        (p1, p2) in penalties(),
        (disp12_max_diff, prefilter_cap, uniqueness) in (-1..4_i32, 0..200_i32, select(vec![0, 0, 5, 15, 60])),
        (speckle_window, speckle_range) in (select(vec![0, 0, 30]), 0..3_i32),
        extend_left in select(vec![false, false, true]),
        (shift, grain, seed) in (0..60_usize, select(vec![0_u32, 0, 4, 7]), any::<u64>()),
    ) -> Case {
        let disparities = 16 * vectors;
        let border = (min_disparity + disparities).max(0) as usize + min_disparity.min(0).unsigned_abs() as usize;
        let width = border + columns;
        let (left, right) = images(width * height * channels, shift * channels, grain, seed);
        let params = Params {
            min_disparity, disparities, block, p1, p2, disp12_max_diff, prefilter_cap, uniqueness, speckle_window,
            speckle_range, mode, extend_left,
        };
        Case { params, width, height, channels, left, right }
    }
}

fn penalties() -> impl Strategy<Value = (i32, i32)> {
    prop_oneof![
        8 => (1..400_i32, 1..2000_i32).prop_map(|(p1, more)| (p1, p1 + more)),
        1 => Just((0, 0)),
        1 => (1..20_000_i32, 1..12_000_i32).prop_map(|(p1, more)| (p1, p1 + more)),
    ]
}

/// Disparity of the left image and of the right one, and ambiguity (its bits).
type MapBits = (Vec<i16>, Vec<i16>, Vec<u32>);

fn run(case: &Case, path: Path, scratch: &mut SgbmScratch, tiles: &dyn Tiles) -> Result<MapBits, Error> {
    let view = |data| View { data, width: case.width, height: case.height, channels: case.channels };
    let pixels = case.width * case.height;
    let (mut disparity, mut right, mut ambiguity) =
        (vec![i16::MIN; pixels], vec![i16::MIN; pixels], vec![-1.0; pixels]);
    let maps = Maps { disparity: &mut disparity, right: Some(&mut right), ambiguity: Some(&mut ambiguity) };
    compute_maps(path, &view(&case.left), &view(&case.right), &case.params, scratch, tiles, maps)?;
    Ok((disparity, right, ambiguity.into_iter().map(f32::to_bits).collect()))
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: if cfg!(miri) { 2 } else { 300 },
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    fn every_path_equals_the_plain_twin(case in cases()) {
        let mut scratch = SgbmScratch::default();
        let plain = run(&case, Path::Plain, &mut scratch, &Serial);
        for path in Path::available().into_iter().filter(|&path| path != Path::Plain) {
            prop_assert_eq!(&run(&case, path, &mut scratch, &Serial), &plain, "{:?}", path);
            prop_assert_eq!(&run(&case, path, &mut scratch, &Backwards), &plain, "{:?} backwards", path);
        }
        let budget = Budget::new(3);
        let _own = budget.permit();
        let threaded = run(&case, Path::best(), &mut scratch, &budget);
        prop_assert_eq!(&threaded, &plain, "three threads");
        let view = |data| View { data, width: case.width, height: case.height, channels: case.channels };
        let mut alone = vec![i16::MIN; case.width * case.height];
        let (left, right) = (view(&case.left), view(&case.right));
        let result = compute_on(Path::best(), &left, &right, &case.params, &mut scratch, &budget, &mut alone);
        prop_assert_eq!(result.map(|()| alone), plain.map(|(disparity, ..)| disparity), "without other maps");
    }
}

/// Each row behind `columns` copies of its first pixel.
fn extended(data: &[u8], width: usize, channels: usize, columns: usize) -> Vec<u8> {
    let row = |row: &[u8]| [row[..channels].repeat(columns), row.to_vec()].concat();
    data.chunks_exact(width * channels).flat_map(row).collect()
}

fn cut<T: Copy>(map: &[T], width: usize, columns: usize) -> Vec<T> {
    map.chunks_exact(width).flat_map(|row| &row[columns..]).copied().collect()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: if cfg!(miri) { 1 } else { 100 },
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    fn an_extended_border_gives_what_extended_images_give(case in cases()) {
        let columns = (case.params.min_disparity + case.params.disparities).max(0) as usize;
        let wide = |data| extended(data, case.width, case.channels, columns);
        let by_hand = Case {
            params: Params { extend_left: false, ..case.params.clone() },
            width: case.width + columns,
            left: wide(&case.left),
            right: wide(&case.right),
            ..case.clone()
        };
        let ours = Case { params: Params { extend_left: true, ..case.params.clone() }, ..case.clone() };
        let mut scratch = SgbmScratch::default();
        let found = run(&ours, Path::best(), &mut scratch, &Serial).unwrap();
        let expected = run(&by_hand, Path::best(), &mut scratch, &Serial).unwrap();
        prop_assert_eq!(found.0, cut(&expected.0, by_hand.width, columns));
        prop_assert_eq!(found.1, cut(&expected.1, by_hand.width, columns));
        prop_assert_eq!(found.2, cut(&expected.2, by_hand.width, columns));
    }
}

#[test]
fn images_that_do_not_match_each_other_or_the_parameters_are_refused() {
    let data = [0; 30 * 4];
    let view = |width, height, channels| View { data: &data[..width * height * channels], width, height, channels };
    let try_it = |left: &View<'_>, right: &View<'_>, params: &Params, len: usize| {
        compute_on(Path::best(), left, right, params, &mut SgbmScratch::default(), &Serial, &mut vec![0; len])
    };
    let small = Params { disparities: 16, ..Params::default() };
    assert_eq!(try_it(&view(30, 4, 1), &view(30, 4, 1), &small, 120), Ok(()));
    assert_eq!(try_it(&view(30, 4, 1), &view(30, 3, 1), &small, 120), Err(Error::Unequal((30, 4, 1), (30, 3, 1))));
    assert_eq!(try_it(&view(30, 2, 2), &view(30, 2, 2), &small, 60), Err(Error::Shape((30, 2, 2))));
    assert_eq!(
        try_it(&view(30, 4, 1), &view(30, 4, 1), &small, 119),
        Err(Error::Length { buffer: "out", len: 119, expected: 120 })
    );
    // OpenCV: "Your input images are too small for your window size and max disparity"
    assert_eq!(try_it(&view(18, 4, 1), &view(18, 4, 1), &small, 72), Err(Error::Narrow { width: 18, needed: 19 }));
    let extend = Params { extend_left: true, ..small.clone() };
    assert_eq!(try_it(&view(3, 4, 1), &view(3, 4, 1), &extend, 12), Ok(()));
    assert_eq!(try_it(&view(2, 4, 1), &view(2, 4, 1), &extend, 8), Err(Error::Narrow { width: 2, needed: 3 }));
    let hh4 = Params { mode: Mode::Hh4, ..small };
    assert_eq!(try_it(&view(1, 1, 1), &view(1, 1, 1), &hh4, 1), Ok(()));
}
