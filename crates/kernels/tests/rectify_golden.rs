//! Rectification compared with OpenCV (`tests/fixtures/rectify.py`).

use std::collections::BTreeMap;
use std::path::PathBuf;

use depthloom_kernels::rectify::{Camera, Interpolation, Lens, Map, View, remap, stereo_rectify};
use depthloom_test_needs::workspace;
use serde::Deserialize;

const SIZE: (u32, u32) = (WIDTH as u32, HEIGHT as u32);
const WIDTH: usize = 112;
const HEIGHT: usize = 84;

#[derive(Deserialize)]
struct Case {
    lens: String,
    alpha: f64,
    has_images: bool,
    k: [[[f64; 3]; 3]; 2],
    d: [Vec<f64>; 2],
    r: [[f64; 3]; 3],
    t: [f64; 3],
    r1: [[f64; 3]; 3],
    r2: [[f64; 3]; 3],
    p1: [[f64; 4]; 3],
    p2: [[f64; 4]; 3],
    /// Of every 19th column of every 17th row.
    places: [Vec<[f64; 2]>; 2],
}

impl Case {
    fn cameras(&self) -> [Camera; 2] {
        [0, 1].map(|of| {
            let (k, d) = (&self.k[of], |at: usize| self.d[of].get(at).copied().unwrap_or(0.0));
            let lens = match self.lens.as_str() {
                "equidistant" => Lens::Equidistant(std::array::from_fn(d)),
                _ => Lens::Polynomial(std::array::from_fn(d)),
            };
            Camera { focal_px: [k[0][0], k[1][1]], centre_px: [k[0][2], k[1][2]], lens }
        })
    }

    /// OpenCV's views.
    fn views(&self) -> [View; 2] {
        let view = |rotation, p: &[[f64; 4]; 3]| View {
            rotation,
            focal_px: [p[0][0], p[1][1]],
            centre_px: [p[0][2], p[1][2]],
        };
        [view(self.r1, &self.p1), view(self.r2, &self.p2)]
    }
}

fn golden(file: &str) -> PathBuf {
    workspace().join("tests/fixtures/golden/rectify").join(file)
}

fn cases() -> BTreeMap<String, Case> {
    let text = std::fs::read(golden("cases.json")).expect("the cases are there");
    let cases: BTreeMap<String, Case> = serde_json::from_slice(&text).expect("they are JSON");
    assert_eq!(cases.len(), 10);
    cases
}

fn rgb(file: &str) -> image::RgbImage {
    image::open(golden(file)).unwrap_or_else(|error| panic!("{file}: {error}")).into_rgb8()
}

#[test]
fn cameras_become_the_pair_that_opencvs_stereo_rectify_makes_of_them() {
    // Of some the rotations were rounded afterwards.
    for (name, case) in cases().into_iter().filter(|(name, _)| !name.ends_with("_rounded")) {
        let cameras = case.cameras();
        let alpha = (case.alpha >= 0.0).then_some(case.alpha);
        let found = stereo_rectify([&cameras[0], &cameras[1]], SIZE, &case.r, case.t, alpha);
        let found = found.unwrap();
        for (ours, theirs) in found.views.iter().zip(case.views()) {
            for (ours, theirs) in ours.rotation.as_flattened().iter().zip(theirs.rotation.as_flattened()) {
                assert!((ours - theirs).abs() < 1e-9, "{name}: {ours} {theirs}");
            }
            let numbers = |view: &View| [view.focal_px, view.centre_px].concat();
            for (ours, theirs) in numbers(ours).iter().zip(numbers(&theirs)) {
                // With `alpha` points are floats of 32 bits there, and not here.
                let most = if case.alpha < 0.0 { 1e-12 * theirs.abs() } else { 1e-4 };
                assert!((ours - theirs).abs() <= most, "{name}: {ours} {theirs}");
            }
        }
        let shift = found.translation * found.views[1].focal_px[0];
        assert!((shift / case.p2[0][3] - 1.0).abs() < 1e-6, "{name}: {shift} {}", case.p2[0][3]);
    }
}

#[test]
fn pixels_come_from_where_opencvs_maps_say() {
    for (name, case) in cases() {
        for ((camera, view), theirs) in case.cameras().iter().zip(case.views()).zip(&case.places) {
            let map = Map::new(camera, &view, SIZE, Interpolation::Float);
            let at = (0..HEIGHT).step_by(17).flat_map(|row| (0..WIDTH).step_by(19).map(move |column| (column, row)));
            for ((column, row), theirs) in at.zip(theirs) {
                let ours = map.place(column, row);
                for (ours, theirs) in ours.iter().zip(theirs) {
                    assert!((ours - theirs).abs() <= 1.6e-5, "{name} {column} {row}: {ours} {theirs}");
                }
            }
        }
    }
}

#[test]
fn images_are_opencvs_to_one_grey_level_and_nearly_all_pixels_to_the_bit() {
    for (name, case) in cases().into_iter().filter(|(_, case)| case.has_images) {
        for (side, (camera, view)) in ["left", "right"].into_iter().zip(case.cameras().iter().zip(case.views())) {
            let image = rgb(&format!("{side}.png"));
            for (interpolation, of) in [(Interpolation::Float, "float"), (Interpolation::Fixed, "fixed")] {
                let map = Map::new(camera, &view, SIZE, interpolation);
                let mut ours = vec![0; WIDTH * HEIGHT * 3];
                remap::<3>(&image, (WIDTH, HEIGHT), &map, &mut ours);
                let file = format!("{name}.{side}.{of}.png");
                let theirs = rgb(&file);
                let differences = ours.iter().zip(theirs.iter()).map(|(a, b)| a.abs_diff(*b));
                let (count, worst) =
                    differences.fold((0, 0), |(count, worst), d| (count + usize::from(d > 0), worst.max(d)));
                assert!(worst <= 1 && count <= 8, "{file}: {count} samples differ, by at most {worst}");
            }
        }
    }
}
