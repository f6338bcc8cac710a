//! The whole chain on real frames, compared with the independent oracle's maps.
//!
//! The maps come from OpenCV and NumPy (`../shared/oracle/golden`), the settings from "Golden settings" of the
//! conventions.

use std::path::Path;

use depthloom_kernels::fuse::{Weighting, fuse};
use depthloom_kernels::{confidence, depth, edges, grey, median, scale};
use depthloom_test_needs::shared;

const BASELINE_METRES: f64 = 0.532725;

fn png16(path: &Path) -> Vec<u16> {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_luma16().into_raw()
}

/// Mono and stereo in, scaled mono out.
type Scaling = fn(&[f32], &[f32], &mut [f32]);

/// What stands before the fusion: width, height, grey, stereo and mono depth.
struct Frame {
    width: usize,
    height: usize,
    weight: Vec<f32>,
    stereo: Vec<f32>,
    mono: Vec<f32>,
}

fn frame(shared: &Path, name: &str) -> Frame {
    let left = shared.join("data/kitti_stereo_2015/training/image_2").join(format!("{name}.png"));
    let left = image::open(&left).unwrap_or_else(|error| panic!("{}: {error}", left.display())).into_rgb8();
    let (width, height) = (left.width() as usize, left.height() as usize);
    let focal_px = match width {
        1242 => 721.5377,
        1224 => 707.0493,
        _ => panic!("no focal length is known for images {width} pixels wide"),
    };
    let size = width * height;

    let mut grey = vec![0; size];
    grey::grey_from_rgb(&left, width, height, &mut grey);
    let mut mask = vec![0; size];
    edges::edges(&grey, width, height, 100.0, &mut mask);
    let mut weight = vec![0.0; size];
    confidence::confidence_from_edges(&mask, width, height, 10.0, &mut weight);

    let golden = shared.join("oracle/golden/ground_plane");
    let disparity: Vec<i16> =
        png16(&golden.join(format!("{name}.disparity.png"))).into_iter().map(|fixed| fixed as i16).collect();
    let mut stereo = vec![0.0; size];
    let geometry = depth::Geometry { focal_px, baseline_metres: BASELINE_METRES, doffs_px: 0.0 };
    depth::depth_from_disparity(&disparity, geometry, 80.0, &mut stereo);

    let plane = depth::GroundPlane {
        focal_px,
        camera_height_metres: 1.65,
        horizon_share: 0.461,
        nearest_metres: 1.0,
        farthest_metres: 80.0,
    };
    let mut mono = vec![0.0; size];
    plane.depth(width, height, &mut mono);
    Frame { width, height, weight, stereo, mono }
}

/// Metres as the oracle's PNGs hold them.
fn as_png(depth: &[f32]) -> Vec<u16> {
    depth.iter().map(|metres| (metres * 256.0).min(65535.0).round_ties_even() as u16).collect()
}

fn largest_difference(found: &[u16], golden: &[u16]) -> u16 {
    assert_eq!(found.len(), golden.len());
    found.iter().zip(golden).map(|(found, golden)| found.abs_diff(*golden)).max().expect("maps are not empty")
}

#[test]
fn confidence_maps_are_the_oracles() {
    let Some(shared) = shared("confidence_maps_are_the_oracles") else { return };
    for name in ["000150_10", "000155_10"] {
        let weight: Vec<u16> =
            frame(&shared, name).weight.iter().map(|weight| (weight * 65535.0).round_ties_even() as u16).collect();
        let golden = png16(&shared.join(format!("oracle/golden/ground_plane/{name}.confidence.png")));
        let difference = largest_difference(&weight, &golden);
        assert!(difference <= 1, "{name}: {difference}/65535");
    }
}

#[test]
fn the_ground_plane_is_the_oracles() {
    let Some(shared) = shared("the_ground_plane_is_the_oracles") else { return };
    for name in ["000150_10", "000155_10"] {
        let golden = png16(&shared.join(format!("oracle/golden/ground_plane/{name}.mono.png")));
        assert_eq!(as_png(&frame(&shared, name).mono), golden, "{name}");
    }
}

#[test]
fn fused_maps_are_the_oracles_to_a_256th_of_a_metre_at_every_pixel() {
    let Some(shared) = shared("fused_maps_are_the_oracles_to_a_256th_of_a_metre_at_every_pixel") else { return };
    let variants: [(&str, Option<Scaling>, Weighting); 5] = [
        ("full", Some(scale::minmax), Weighting::Full),
        ("no_weighting", Some(scale::minmax), Weighting::Confidence),
        ("mean", Some(scale::minmax), Weighting::Mean),
        ("no_scaling", None, Weighting::Full),
        ("average_scaling", Some(scale::average), Weighting::Full),
    ];
    for name in ["000150_10", "000155_10"] {
        let Frame { width, height, weight, stereo, mono } = frame(&shared, name);
        for (variant, scaling, weighting) in variants {
            let mut scaled = mono.clone();
            if let Some(scaling) = scaling {
                scaling(&mono, &stereo, &mut scaled);
            }
            let mut merged = vec![0.0; mono.len()];
            fuse(&stereo, &scaled, &weight, weighting, &mut merged);
            let mut fused = vec![0.0; mono.len()];
            median::median5(&merged, width, height, &mut fused);
            let golden = png16(&shared.join(format!("oracle/golden/ground_plane/{name}.fused.{variant}.png")));
            let fused = as_png(&fused);
            let differing = fused.iter().zip(&golden).filter(|(found, golden)| found != golden).count();
            println!("{name} {variant}: {differing} of {} pixels differ", golden.len());
            let difference = largest_difference(&fused, &golden);
            assert!(difference <= 1, "{name} {variant}: {difference}/256 m");
        }
    }
}
