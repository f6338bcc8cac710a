//! The street as a whole: repeatable, geometrically true, and hard in the right places.

use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;

use crate::{Frame, Size, Street};

const SMALL: Size = Size { width: 320, height: 96 };

fn serial(tiles: usize, render: &(dyn Fn(usize) + Sync)) {
    (0..tiles).for_each(render);
}

fn threaded(tiles: usize, render: &(dyn Fn(usize) + Sync)) {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                loop {
                    let turn = next.fetch_add(1, Ordering::Relaxed);
                    if turn >= tiles {
                        break;
                    }
                    render(tiles - 1 - turn);
                }
            });
        }
    });
}

fn bits(depth: &[f32]) -> Vec<u32> {
    depth.iter().map(|d| d.to_bits()).collect()
}

fn assert_same(a: &Frame, b: &Frame) {
    assert!(a.left == b.left && a.right == b.right && a.occluded == b.occluded, "images and mask");
    assert!(a.cars == b.cars, "cars");
    assert!(bits(&a.depth) == bits(&b.depth) && bits(&a.sparse) == bits(&b.sparse), "depths");
}

fn grey(rgb: &[u8], pixel: usize) -> f64 {
    rgb[3 * pixel..3 * pixel + 3].iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn bits_do_not_depend_on_who_renders_which_tile() {
    let street = Street::new(11, SMALL);
    let frame = street.frame(3, &serial);
    assert_same(&frame, &street.frame(3, &threaded));
    assert_same(&frame, &Street::new(11, SMALL).frame(3, &serial));
}

#[test]
fn cars_stand_on_the_street_and_are_neither_all_nor_nothing() {
    let frames = (0..8).map(|index| Street::new(1, SMALL).frame(index, &serial));
    let (mut cars, mut sky) = (0, 0);
    for frame in frames {
        cars += frame.cars.iter().filter(|car| **car).count();
        sky += frame.cars.iter().zip(&frame.depth).filter(|(car, depth)| **car && depth.is_nan()).count();
    }
    let share = cars as f64 / (8 * SMALL.pixels()) as f64;
    assert!((0.005..0.5).contains(&share) && sky == 0, "{share} of the pixels show cars, {sky} of them in the sky");
}

#[test]
fn seeds_and_frames_show_different_places() {
    let frames = [(1, 0), (1, 1), (2, 0)].map(|(seed, index)| Street::new(seed, SMALL).frame(index, &serial));
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let differing =
            (0..SMALL.pixels()).filter(|&p| (grey(&frames[a].left, p) - grey(&frames[b].left, p)).abs() > 20.0).count();
        assert!(differing > SMALL.pixels() / 20, "{differing} pixels differ");
    }
}

#[test]
fn a_visible_pixel_is_found_in_the_right_image() {
    for seed in [1, 2, 3] {
        let frame = Street::new(seed, Size::KITTI).frame(5, &serial);
        let width = frame.size.width;
        let (mut matched, mut shifted) = (Vec::new(), Vec::new());
        for pixel in 0..frame.size.pixels() {
            if frame.depth[pixel].is_nan() || frame.occluded[pixel] {
                continue;
            }
            let disparity = frame.calibration.disparity_px(f64::from(frame.depth[pixel]));
            let column = (pixel % width) as f64 - disparity;
            assert!(column > -0.6, "a visible pixel is inside the right image");
            let (left, share) = (column.floor().max(0.0), column - column.floor());
            let at = |offset: f64| {
                let there = (left + offset).clamp(0.0, width as f64 - 1.0) as usize;
                grey(&frame.right, pixel - pixel % width + there)
            };
            let here = grey(&frame.left, pixel);
            matched.push((here - (at(0.0) * (1.0 - share) + at(1.0) * share)).abs());
            shifted.push((here - at(12.0)).abs());
        }
        let (matched, shifted) = (median(matched), median(shifted));
        // The cameras' noise and their difference of exposure; a wrong place differs more.
        assert!(
            matched < 4.5 && matched < 0.7 * shifted,
            "seed {seed}: {matched} at the right place, {shifted} beside it"
        );
    }
}

#[test]
fn occluded_is_where_the_right_camera_sees_something_nearer() {
    let street = Street::new(2, SMALL);
    let frame = street.frame(4, &serial);
    let scene = street.scene(4);
    let width = SMALL.width;
    let (mut hidden, mut visible) = (0, 0);
    for pixel in 0..SMALL.pixels() {
        let depth = f64::from(frame.depth[pixel]);
        if depth.is_nan() {
            continue;
        }
        let column = (pixel % width) as f64 - frame.calibration.disparity_px(depth);
        if column < 0.0 || column > width as f64 - 1.0 {
            assert!(frame.occluded[pixel] || column > -0.51, "outside the right image");
            continue;
        }
        // What the right camera sees at the pixels around that place, by separate rays.
        let around = [column.floor(), column.floor() + 1.0].map(|c| {
            let (_, hit) = scene.first_hit(&scene.right, c as f32, (pixel / width) as f32);
            hit.map_or(f64::INFINITY, |hit| f64::from(hit.depth))
        });
        if around.iter().all(|seen| *seen < depth * 0.9) {
            // A gap narrower than a pixel may lie between; it is rare.
            hidden += if frame.occluded[pixel] { 1 } else { -20 };
        }
        if around.iter().all(|seen| (seen / depth - 1.0).abs() < 0.01) {
            visible += if frame.occluded[pixel] { -20 } else { 1 };
        }
    }
    assert!(hidden > 200, "{hidden}");
    assert!(visible > 10_000, "{visible}");
}

#[test]
fn the_scanner_samples_the_dense_depth_and_leaves_the_top_out() {
    let frame = Street::new(1, Size::KITTI).frame(2, &serial);
    let mut scanned = 0;
    for (pixel, (&sparse, &dense)) in frame.sparse.iter().zip(&frame.depth).enumerate() {
        if sparse.is_nan() {
            continue;
        }
        scanned += 1;
        assert_eq!(sparse.to_bits(), dense.to_bits());
        assert!(sparse < 120.0);
        assert!(pixel / frame.size.width > 120, "no beam points at the sky");
    }
    let share = f64::from(scanned) / frame.size.pixels() as f64;
    assert!((0.02..0.06).contains(&share), "a scan covers a few percent: {share}");
    let visible = frame.sparse_visible();
    let known = visible.iter().filter(|d| !d.is_nan()).count() as f64;
    assert!(known > 0.8 * f64::from(scanned) && known < f64::from(scanned), "{known} of {scanned}");
}

#[test]
fn the_road_is_at_the_height_of_the_camera() {
    // Straight down the lane, ahead of the car: the lowest row sees the carriageway, as far away as the camera is high.
    let frame = Street::new(1, Size::KITTI).frame(0, &serial);
    let calibration = frame.calibration;
    let (row, column) = (370_usize, 620_usize);
    let level = calibration.focal_px * 1.65 / (row as f64 - calibration.cy_px);
    let depth = f64::from(frame.depth[row * frame.size.width + column]);
    assert!((depth / level - 1.0).abs() < 0.05, "{depth} against {level}: the car nods only a little");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_size_seed_and_index_give_a_whole_frame(
        seed: u64,
        index: u64,
        width in 1_usize..70,
        height in 1_usize..40,
    ) {
        let size = Size { width, height };
        let frame = Street::new(seed, size).frame(index, &serial);
        prop_assert_eq!(frame.left.len(), 3 * size.pixels());
        prop_assert_eq!(frame.right.len(), 3 * size.pixels());
        prop_assert_eq!(frame.occluded.len(), size.pixels());
        prop_assert_eq!(frame.sparse.len(), size.pixels());
        prop_assert_eq!(frame.depth.len(), size.pixels());
        for (pixel, depth) in frame.depth.iter().enumerate() {
            prop_assert!(depth.is_nan() || (*depth > 0.0 && *depth < 400.0), "{}", depth);
            prop_assert!(!depth.is_nan() || (!frame.occluded[pixel] && frame.sparse[pixel].is_nan()), "sky is neither hidden nor scanned");
        }
        let again = Street::new(seed, size).frame(index, &threaded);
        prop_assert!(frame.left == again.left && bits(&frame.depth) == bits(&again.depth));
    }
}
