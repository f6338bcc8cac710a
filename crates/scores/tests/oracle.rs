//! The metrics against numbers from outside of this project.

use std::collections::HashMap;
use std::path::Path;

use depthloom_scores::{PixelSet, Preset, score};
use depthloom_test_needs::shared;

/// Two sets on eight pixels. The expectations are `oracle.py`'s `score` (NumPy) on the same eight pairs; those of
/// `kitti-depth` are NumPy's `((y - t)**2 / t**2).mean()` and `100 * (np.log(y) - np.log(t)).std()` with `y = clip(y,
/// 1e-3, 256)`, 1e-4 where it is NaN.
#[test]
fn eight_pixels_score_as_with_numpy() {
    let truth = [5.0, 12.5, f32::NAN, 33.25, 79.5, 80.0, 0.5, 20.0];
    let estimate = [5.5, 10.0, 3.0, f32::NAN, 200.0, 50.0, 0.0, 26.0];
    let sets = [PixelSet::All, PixelSet::Valid];
    let rows = score(&estimate, &truth, 4, 2, &sets, &Preset::Martins2018.settings());
    let expected = [EXPECTED_ALL, EXPECTED_VALID];
    for (row, (pixels, scores)) in rows.iter().zip(expected) {
        assert_eq!(row.pixels, pixels);
        assert_eq!((row.truth, row.valid, row.scores.len()), (6, 5, 8));
        for ((metric, ours), theirs) in row.scores.iter().zip(scores) {
            assert!((ours - theirs).abs() <= 1e-13 * theirs, "{}: {ours}, not {theirs}", metric.name);
        }
    }
    let kitti = &score(&estimate, &truth, 4, 2, &[PixelSet::All], &Preset::KittiDepth.settings())[0];
    assert_eq!(kitti.pixels, 7);
    let value = |name: &str| kitti.score(name).unwrap_or_else(|| panic!("{name} is there"));
    assert!(
        (value("sq_rel") - KITTI_SQ_REL).abs() < 1e-13 && (value("silog") - KITTI_SILOG).abs() < 1e-10,
        "{kitti:?}"
    );
}

const EXPECTED_ALL: (u64, [f64; 8]) = (
    6,
    [
        0.333_333_333_333_333_3,
        0.666_666_666_666_666_6,
        0.666_666_666_666_666_6,
        0.434_047_716_776_217_3,
        6.016_824_442_398_132,
        13.835_671_595_613_515,
        5.779_344_671_035_671,
        11.797_682_387_188_72,
    ],
);
const EXPECTED_VALID: (u64, [f64; 8]) = (
    5,
    [
        0.4,
        0.8,
        0.8,
        0.320_857_861_635_220_1,
        0.570_229_330_817_610_1,
        2.932_541_593_907_919_4,
        2.783_850_039_321_767_8,
        3.137_087_747_313_599,
    ],
);
const KITTI_SQ_REL: f64 = 0.653_434_288_217_934_7;
const KITTI_SILOG: f64 = 468.151_520_394_708_5;

fn sixteen_bit(path: &Path) -> (usize, usize, Vec<u16>) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_luma16();
    (image.width() as usize, image.height() as usize, image.into_raw())
}

/// The focal lengths of KITTI stereo 2015 by width (conventions.md), and the baseline, as the oracle has them.
fn focal_times_baseline(width: usize) -> f32 {
    let focal_px = match width {
        1242 => 721.5377,
        1224 => 707.0493,
        1226 => 707.0912,
        1238 => 718.3351,
        other => panic!("no focal length for a width of {other}"),
    };
    (focal_px * 0.532_725_f64) as f32
}

/// The golden disparities are exact (16-bit fixed point), so stereo's golden scores follow from them to the last
/// digits. The golden depth maps are rounded to 1/256 m: their scores follow to about that.
#[test]
fn golden_maps_score_as_the_oracle_scored_them() {
    let Some(shared) = shared("golden_maps_score_as_the_oracle_scored_them") else { return };
    let mut compared = 0;
    for mono in ["ground_plane", "ssl_unet"] {
        let golden = shared.join("oracle/golden").join(mono);
        let csv = std::fs::read_to_string(golden.join("scores.csv")).unwrap();
        let rows: HashMap<[String; 3], Vec<f64>> = csv.lines().skip(1).map(row_of_csv).collect();
        for frame in ["000150_10", "000155_10"] {
            let truth_png = shared.join(format!("data/kitti_stereo_2015/training/disp_noc_0/{frame}.png"));
            let (width, height, disparity) = sixteen_bit(&truth_png);
            let fb = focal_times_baseline(width);
            let truth: Vec<f32> =
                disparity.iter().map(|&d| if d == 0 { f32::NAN } else { fb / (f32::from(d) / 256.0) }).collect();
            let check = |name: &str, estimate: &[f32], sets: &[PixelSet], tolerance: f64| {
                for row in score(estimate, &truth, width, height, sets, &Preset::Martins2018.settings()) {
                    let set = if row.set == PixelSet::Valid { "answered" } else { row.set.name() };
                    let key = [frame.to_owned(), name.to_owned(), set.to_owned()];
                    let expected = &rows[&key];
                    assert_eq!(row.pixels as f64, expected[0], "{key:?}");
                    for ((metric, ours), theirs) in row.scores.iter().zip(&expected[1..]) {
                        let score = metric.name;
                        assert!((ours - theirs).abs() <= tolerance * theirs, "{key:?} {score}: {ours}, not {theirs}");
                    }
                }
            };
            let stereo = shared.join(format!("oracle/golden/ground_plane/{frame}.disparity.png"));
            let stereo = sixteen_bit(&stereo).2.into_iter();
            let stereo = stereo.map(|d| if d == 0 { f32::NAN } else { (fb / (f32::from(d) / 16.0)).min(80.0) });
            check("stereo", &stereo.collect::<Vec<_>>(), &[PixelSet::All, PixelSet::Valid], 1e-12);
            for variant in ["full", "no_weighting", "mean", "no_scaling", "average_scaling"] {
                let fused = sixteen_bit(&golden.join(format!("{frame}.fused.{variant}.png"))).2;
                let fused: Vec<f32> = fused.into_iter().map(|v| f32::from(v) / 256.0).collect();
                check(&format!("{variant}/fused"), &fused, &[PixelSet::All], 1e-3);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 20);
}

fn row_of_csv(line: &str) -> ([String; 3], Vec<f64>) {
    let cells: Vec<&str> = line.split(',').collect();
    (std::array::from_fn(|i| cells[i].to_owned()), cells[3..].iter().map(number).collect())
}

fn number(cell: &&str) -> f64 {
    cell.parse().unwrap_or_else(|error| panic!("`{cell}` of the golden scores: {error}"))
}
