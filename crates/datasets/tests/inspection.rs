//! What a frame's images, calibration and truth say of each other: nothing of right data, and the mistake of wrong
//! ones.
#![expect(clippy::unwrap_used, reason = "a test that cannot continue panics")]

use depthloom_graphs::plan::FrameIndex;
use std::path::Path;

use depthloom_datasets::inspection::{Contradiction, inspect};
use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::values::{Calibration, Depth, Image, Pixels, Raster, TrueDisparity};
use depthloom_graphs::{Context, Port, Scratch, Value};
use depthloom_test_needs::{shared, workspace};
use serde_json::{Value as Json, json};

/// The ports and values of the frames of a source.
fn frames(kind: &str, params: &Json) -> Vec<(Vec<Port>, Vec<Option<Value>>)> {
    let registry = depthloom_nodes::registry();
    let kind = registry.source_kind(kind).unwrap();
    let resolved = kind.resolve(params).unwrap();
    let ports = kind.outputs(&resolved).unwrap();
    let source = kind.open(&resolved).unwrap();
    let read = |position| {
        let mut scratch = Scratch::default();
        let read = source.read(position, &mut Context::new(&InlineHost, &mut scratch)).unwrap();
        (ports.clone(), read.outputs.in_order_of(&ports).unwrap())
    };
    FrameIndex::all(source.frames().len()).map(read).collect()
}

fn road() -> (Vec<Port>, Vec<Option<Value>>) {
    frames("synthetic/road", &json!({ "frames": [5], "width": 620, "height": 188 })).remove(0)
}

fn image_of(grey: image::GrayImage) -> Image {
    Image::new(Pixels::Grey(grey))
}

fn grey_of(image: &Image) -> image::GrayImage {
    image.grey_with(image::imageops::grayscale).clone()
}

/// What is found where one value is another.
fn with(port: &str, change: impl Fn(&Value) -> Value) -> Vec<Contradiction> {
    let (ports, mut values) = road();
    let at = ports.iter().position(|known| known.name == port).unwrap();
    values[at] = values[at].as_ref().map(change);
    inspect(&ports, &values)
}

fn calibration(change: impl Fn(&mut Calibration)) -> Vec<Contradiction> {
    with("calibration", |value| {
        let Value::Calibration(calibration) = value else { panic!() };
        let mut calibration = (**calibration).clone();
        change(&mut calibration);
        calibration.into()
    })
}

fn depth(factor: f32) -> Vec<Contradiction> {
    with("depth", |value| {
        let Value::Depth(depth) = value else { panic!() };
        let mut metres = depth.metres.clone();
        metres.iter_mut().for_each(|value| *value *= factor);
        Depth { metres }.into()
    })
}

#[test]
fn faults_of_a_frame_are_reported() {
    assert_eq!(inspect(&road().0, &road().1), []);
    let (ports, mut values) = road();
    values.swap(0, 1);
    let exchanged = inspect(&ports, &values);
    assert!(exchanged.len() == 1 && exchanged[0].what.starts_with("left and right look exchanged"), "{exchanged:?}");
    let one = |found: Vec<Contradiction>, port: &str, what: &str| {
        assert!(found.len() == 1 && found[0].port == port && found[0].what.contains(what), "{found:?}");
    };
    one(calibration(|numbers| numbers.cx_px = 900.0), "calibration", "the principal point (900.0, ");
    one(
        calibration(|numbers| numbers.width = 1242),
        "calibration",
        "the calibration is of 1242x188, and the image is 620x188",
    );
    one(depth(1000.0), "depth", "the ground truth does not fit the images");
    one(depth(0.1), "depth", "times as far as their disparity states");
    let millimetres = calibration(|numbers| numbers.baseline_m *= 1000.0);
    assert!(
        millimetres.iter().all(|problem| problem.what.contains("the ground truth does not fit the images")),
        "{millimetres:?}"
    );
    let focal = calibration(|numbers| numbers.focal_px = 3.6);
    assert!(focal[0].what.starts_with("with a focal length of 3.6 px an image 620 px wide sees 178."), "{focal:?}");
}

#[test]
fn wrong_pairs_are_reported() {
    let (ports, values) = road();
    let grey = |at: usize| match &values[at] {
        Some(Value::Image(image)) => grey_of(image),
        _ => panic!("{} is an image", ports[at].name),
    };
    let (left, right) = (grey(0), grey(1));
    let found = |left: &image::GrayImage, right: &image::GrayImage| {
        let mut values = values.clone();
        (values[0], values[1]) = (Some(image_of(left.clone()).into()), Some(image_of(right.clone()).into()));
        let found = inspect(&ports, &values);
        found.iter().map(|problem| format!("{}: {}", problem.port, problem.what)).collect::<Vec<_>>().join("; ")
    };
    assert_eq!(found(&left, &right), "");
    let black = image::GrayImage::new(620, 188);
    let nothing = "the image shows nothing: its pixels are all of grey level 0";
    assert_eq!(found(&black, &black), format!("left: {nothing}; right: {nothing}"));
    assert_eq!(found(&left, &black), format!("right: {nothing}"));
    assert_eq!(found(&left, &left), "right: left and right are one picture, equal in every pixel");
    let lower = image::GrayImage::from_fn(620, 188, |x, y| *right.get_pixel(x, (y + 4).min(187)));
    assert!(found(&left, &lower).contains("are found about 4 px above or below their row"), "{}", found(&left, &lower));
    // Half as bright and a level up: another exposure is still the same scene.
    let darker = image::GrayImage::from_fn(620, 188, |x, y| {
        image::Luma([(u16::from(right.get_pixel(x, y).0[0]) * 3 / 4 + 20) as u8])
    });
    assert_eq!(found(&left, &darker), "");
    let other =
        frames("synthetic/road", &json!({ "frames": [90], "width": 620, "height": 188, "seed": 77 })).remove(0).1;
    let Some(Value::Image(other)) = &other[1] else { panic!() };
    let problem = found(&left, &grey_of(other));
    assert!(problem.starts_with("right: left and right do not show the same: of "), "{problem}");
}

#[test]
fn ground_truth_in_the_wrong_unit_or_without_pixels_is_reported() {
    let problem = |change: &dyn Fn(f32, &Calibration) -> f32| {
        let (ports, values) = road();
        let calibration = values.iter().flatten().find_map(|value| match value {
            Value::Calibration(numbers) => Some((**numbers).clone()),
            _ => None,
        });
        let calibration = calibration.unwrap();
        let changed = values.iter().map(|value| match value {
            Some(Value::Depth(depth)) => {
                let mut metres = depth.metres.clone();
                metres.iter_mut().for_each(|at| *at = change(*at, &calibration));
                Some(Depth { metres }.into())
            }
            other => other.clone(),
        });
        let found = inspect(&ports, &changed.collect::<Vec<_>>());
        // The street has truths of two kinds.
        let mut problems: Vec<String> = found.into_iter().map(|problem| problem.what).collect();
        problems.dedup();
        problems.first().cloned().unwrap_or_default()
    };
    assert_eq!(problem(&|metres, _| metres), "");
    assert_eq!(problem(&|_, _| f32::NAN), "the ground truth has no known pixel");
    // Disparities read as metres, and depths read as pixels.
    for wrong in [
        problem(&|m, numbers| numbers.disparity_px(f64::from(m)) as f32),
        problem(&|m, numbers| numbers.depth_m(f64::from(m)) as f32),
    ] {
        assert!(
            wrong.starts_with("the ground truth contradicts the images: at ") && wrong.contains("look like"),
            "{wrong}"
        );
    }
}

#[test]
fn ground_truth_without_images_must_have_plausible_depths() {
    let (ports, values) = road();
    let rows = |from: u32| image_of(image::GrayImage::from_fn(620, 188, |_, y| image::Luma([(from + y) as u8])));
    let found = |factor: f32| {
        let mut values = values.clone();
        for (port, value) in ports.iter().zip(&mut values) {
            match value {
                Some(Value::Image(_)) => *value = Some(rows(u32::from(port.name == "left")).into()),
                Some(Value::Depth(depth)) if port.name == "depth" => {
                    let mut metres = depth.metres.clone();
                    metres.iter_mut().for_each(|value| *value *= factor);
                    *value = Some(Depth { metres }.into());
                }
                _ => {}
            }
        }
        inspect(&ports, &values)
    };
    assert_eq!(found(1.0), []);
    assert!(found(1000.0)[0].what.starts_with("half of the ground-truth depths are beyond "), "{:?}", found(1000.0));
    assert!(found(0.01)[0].what.contains("is a disparity of "), "{:?}", found(0.01));
}

/// Frames in which something is found, of all.
fn suspicious(kind: &str, params: &Json) -> (usize, Vec<Contradiction>) {
    let frames = frames(kind, params);
    (frames.len(), frames.iter().flat_map(|(ports, values)| inspect(ports, values)).collect())
}

#[test]
fn correct_real_frames_give_no_warnings() {
    let of_this = |root: &Path| suspicious("kitti/stereo2015", &json!({ "root": root }));
    assert_eq!(of_this(&workspace().join("tests/fixtures/road")).1, []);
    let Some(shared) = shared("correct_real_frames_give_no_warnings") else { return };
    let (count, found) = of_this(&shared.join("data/kitti_stereo_2015"));
    assert_eq!((count, found), (46, vec![]));
    let raw = json!({ "root": shared.join("data/kitti_raw") });
    assert_eq!(suspicious("kitti/raw", &raw), (3, vec![]));
    let middlebury = json!({ "root": shared.join("data/middlebury") });
    let (count, found) = suspicious("middlebury", &middlebury);
    assert!(count > 0 && found.is_empty(), "{count} {found:?}");
    // Exchanged, each of them is found out.
    let frames = frames("kitti/stereo2015", &json!({ "root": shared.join("data/kitti_stereo_2015") }));
    let reported = frames.into_iter().filter(|(ports, values)| {
        let mut values = values.clone();
        values.swap(0, 1);
        inspect(ports, &values).iter().any(|found| found.what.starts_with("left and right look exchanged"))
    });
    assert_eq!(reported.count(), 46);
}

/// Values with ground truth in the other unit: disparities for depths, depths for disparities, up to a factor.
fn of_the_other_unit(values: &[Option<Value>]) -> Vec<Option<Value>> {
    let inverse = |map: &Raster<f32>| {
        let mut map = map.clone();
        map.iter_mut().for_each(|value| *value = 400.0 / *value);
        map
    };
    let other = |value: &Option<Value>| match value {
        Some(Value::Depth(depth)) => Some(Depth { metres: inverse(&depth.metres) }.into()),
        Some(Value::TrueDisparity(truth)) => Some(TrueDisparity { px: inverse(&truth.px) }.into()),
        other => other.clone(),
    };
    values.iter().map(other).collect()
}

#[test]
fn real_frames_of_the_other_unit_or_of_two_scenes_are_found_out() {
    let Some(shared) = shared("real_frames_of_the_other_unit_or_of_two_scenes_are_found_out") else { return };
    for (kind, folder) in [("kitti/stereo2015", "kitti_stereo_2015"), ("middlebury", "middlebury")] {
        let frames = frames(kind, &json!({ "root": shared.join("data").join(folder) }));
        let (mut units, mut reported, mut scenes) = (0, 0, 0);
        for (at, (ports, values)) in frames.iter().enumerate() {
            let found = inspect(ports, &of_the_other_unit(values));
            units += usize::from(found.iter().any(|problem| problem.what.contains("contradicts the images")));
            let mut shuffled = values.clone();
            shuffled[1] = frames[(at + 1) % frames.len()].1[1].clone();
            let found = inspect(ports, &shuffled);
            reported += usize::from(!found.is_empty());
            scenes += usize::from(found.iter().any(|problem| problem.what.contains("do not show the same")));
        }
        // Streets can be alike enough to pass for one scene: what real pairs never meet, a few shuffled ones do not
        // meet either.
        let count = frames.len();
        let numbers = format!("{kind}: {units}, {reported} and {scenes} of {count}");
        assert!(10 * units >= 9 * count && 10 * reported >= 7 * count && 10 * scenes >= 6 * count, "{numbers}");
        println!("{numbers}");
    }
}
