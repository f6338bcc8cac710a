//! The 36 disparity maps of OpenCV 5.0 in `../shared/oracle/golden/sgbm`: every pixel equal, on the fastest path; in
//! the full suite on every path.

use depthloom_kernels::sgbm::{Mode, Params, Path, SgbmScratch, View, compute_on};
use depthloom_kernels::tiles::Serial;
use depthloom_test_needs::{is_full, shared};

#[derive(serde::Deserialize)]
struct Golden {
    cases: Vec<Case>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct Case {
    file: String,
    left: String,
    right: String,
    min_disparity: i32,
    num_disparities: i32,
    block_size: i32,
    #[serde(rename = "P1")]
    p1: i32,
    #[serde(rename = "P2")]
    p2: i32,
    disp12_max_diff: i32,
    pre_filter_cap: i32,
    uniqueness_ratio: i32,
    speckle_window_size: i32,
    speckle_range: i32,
    mode: String,
}

fn grey(path: &std::path::Path) -> (Vec<u8>, usize, usize) {
    let image = image::open(path).unwrap_or_else(|error| panic!("failed to read {}: {error}", path.display()));
    let rgb = image.into_rgb8();
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    let weigh = |p: &[u8]| (9798 * u32::from(p[0]) + 19235 * u32::from(p[1]) + 3735 * u32::from(p[2]) + 16384) >> 15;
    (rgb.as_raw().chunks_exact(3).map(|p| weigh(p) as u8).collect(), width, height)
}

#[test]
fn every_pixel_equals_opencv() {
    let Some(shared) = shared("every_pixel_equals_opencv") else { return };
    let folder = shared.join("oracle/golden/sgbm");
    let golden: Golden = serde_json::from_slice(&std::fs::read(folder.join("cases.json")).unwrap()).unwrap();
    assert_eq!(golden.cases.len(), 36);
    // `sgbm_paths` compares the others with it.
    let paths = if is_full() { Path::available() } else { vec![Path::best()] };
    let mut scratch = SgbmScratch::default();
    for case in &golden.cases {
        let (left, width, height) = grey(&shared.join(&case.left));
        let (right, ..) = grey(&shared.join(&case.right));
        let params = Params {
            min_disparity: case.min_disparity,
            disparities: case.num_disparities,
            block: case.block_size,
            p1: case.p1,
            p2: case.p2,
            disp12_max_diff: case.disp12_max_diff,
            prefilter_cap: case.pre_filter_cap,
            uniqueness: case.uniqueness_ratio,
            speckle_window: case.speckle_window_size,
            speckle_range: case.speckle_range,
            mode: match case.mode.as_str() {
                "sgbm" => Mode::Sgbm,
                "hh" => Mode::Hh,
                "3way" => Mode::ThreeWay,
                "hh4" => Mode::Hh4,
                other => panic!("unknown mode {other}"),
            },
            extend_left: false,
        };
        let expected = image::open(folder.join(&case.file)).unwrap().into_luma16().into_raw();
        let [left, right] = [&left, &right].map(|data| View { data, width, height, channels: 1 });
        for &path in &paths {
            let mut out = vec![0; width * height];
            compute_on(path, &left, &right, &params, &mut scratch, &Serial, &mut out).unwrap();
            // The files hold the disparity above the invalid value, so that 0 is invalid.
            let differing = out
                .iter()
                .zip(&expected)
                .filter(|&(&ours, &theirs)| i32::from(ours) - i32::from(params.invalid()) != i32::from(theirs))
                .count();
            assert_eq!(differing, 0, "{} on {path:?}: pixels that differ of {}", case.file, out.len());
        }
    }
}
