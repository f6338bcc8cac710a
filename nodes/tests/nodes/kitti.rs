//! `kitti/stereo2015`: reading, and messages about data that differ from KITTI.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::{Context, Fault, Host, Scratch, Value};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, Rgb, RgbImage};
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::call::{metres, open};

const CALIBRATION: &str = "calib_time: 09-Jan-2012 13:57:47
P_rect_02: 5.0e+02 0 32 0 0 5.0e+02 16 0 0 0 1 0
P_rect_03: 5.0e+02 0 32 -2.5e+02 0 5.0e+02 16 0 0 0 1 0
";

/// A small data set of frames 3 and 7, complete.
struct DataSet {
    root: TempDir,
}

impl DataSet {
    fn new() -> Self {
        let set = Self { root: tempfile::tempdir().unwrap() };
        for number in ["000003", "000007"] {
            for folder in ["image_2", "image_3"] {
                set.save(&format!("{folder}/{number}_10.png"), &colour(64, 32));
                set.save(&format!("{folder}/{number}_11.png"), &colour(64, 32));
            }
            for folder in ["disp_noc_0", "disp_occ_0"] {
                set.save(&format!("{folder}/{number}_10.png"), &truth(64, 32));
            }
            set.write(&format!("calib_cam_to_cam/{number}.txt"), CALIBRATION);
        }
        set
    }

    fn path(&self, file: &str) -> PathBuf {
        self.root.path().join("training").join(file)
    }

    fn write(&self, file: &str, content: impl AsRef<[u8]>) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    fn save(&self, file: &str, image: &DynamicImage) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image.save(path).unwrap();
    }

    fn remove(&self, file: &str) {
        let path = self.path(file);
        if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }.unwrap();
    }

    fn params(&self, more: &Json) -> Json {
        let mut params = json!({ "root": self.root.path() });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    }

    fn at_opening(&self, more: &Json) -> Fault {
        open("kitti/stereo2015", &self.params(more)).err().expect("found when the source is opened")
    }

    fn at_frame(&self, more: &Json) -> Fault {
        let source = open("kitti/stereo2015", &self.params(more)).unwrap_or_else(|fault| panic!("{}", fault.chain()));
        source.read(FrameIndex(0)).expect_err("found at the frame")
    }

    /// The message, with the temporary folder called ROOT.
    fn report(&self, fault: &Fault) -> String {
        let remedy = fault.remedy_text().map_or_else(String::new, |text| format!("\n  remedy: {text}"));
        format!("{}{remedy}", fault.chain()).replace(&self.root.path().display().to_string(), "ROOT")
    }
}

fn colour(width: u32, height: u32) -> DynamicImage {
    RgbImage::from_fn(width, height, |x, y| Rgb([(x * 3) as u8, (y * 5) as u8, (x * y) as u8])).into()
}

fn truth(width: u32, height: u32) -> DynamicImage {
    let map = ImageBuffer::from_fn(width, height, |x, _| Luma([if x % 2 == 0 { 0 } else { (256 * x) as u16 }]));
    DynamicImage::ImageLuma16(map)
}

#[test]
fn a_frame_has_images_with_their_bytes_calibration_and_ground_truth() {
    let set = DataSet::new();
    let source = open("kitti/stereo2015", &set.params(&json!({}))).unwrap();
    let ids: Vec<(&str, u64, u64)> = source.source.frames().iter().map(|f| (&*f.id, f.index, f.time_ns)).collect();
    assert_eq!(ids, [("000003_10", 3, 300_000_000), ("000007_10", 7, 700_000_000)]);
    let (values, _) = source.read(FrameIndex(1)).unwrap();
    let Value::Image(left) = &values["left"] else { panic!("image") };
    assert_eq!(left.encoded().unwrap().bytes[..], fs::read(set.path("image_2/000007_10.png")).unwrap()[..]);
    let Value::Calibration(calibration) = &values["calibration"] else { panic!("calibration") };
    assert_eq!((calibration.focal_px, calibration.baseline_m, calibration.width), (500.0, 0.5, 64));
    let depth = metres(&values["depth"]);
    assert!(depth[0].is_nan());
    assert_eq!(depth[5], 50.0);
}

#[test]
fn the_bytes_behind_a_key_are_the_bytes_read() {
    let set = DataSet::new();
    let source = open("kitti/stereo2015", &set.params(&json!({}))).unwrap().source;
    let read = || source.read(FrameIndex(0), &mut Context::new(&InlineHost, &mut Scratch::default())).unwrap().key;
    let before = source.key(FrameIndex(0)).unwrap();
    set.save("image_2/000003_10.png", &colour(64, 32).rotate180());
    assert_eq!(read(), before, "the files were read for the key");
    let after = read();
    assert_ne!(after, before);
    assert_eq!(source.key(FrameIndex(0)).unwrap(), after);
}

#[test]
fn testing_frames_have_no_ground_truth() {
    let set = DataSet::new();
    fs::rename(set.root.path().join("training"), set.root.path().join("testing")).unwrap();
    let source = open("kitti/stereo2015", &set.params(&json!({ "split": "testing" }))).unwrap();
    let (values, _) = source.read(FrameIndex(0)).unwrap();
    assert_eq!(values.keys().copied().collect::<Vec<_>>(), ["calibration", "left", "right"]);
}

#[test]
fn without_calibration_files_the_focal_length_follows_from_the_width() {
    let set = DataSet::new();
    set.remove("calib_cam_to_cam");
    for folder in ["image_2", "image_3"] {
        set.save(&format!("{folder}/000003_10.png"), &colour(1224, 20));
    }
    set.save("disp_noc_0/000003_10.png", &truth(1224, 20));
    let source = open("kitti/stereo2015", &set.params(&json!({ "frames": [3] }))).unwrap();
    let host = Listening::default();
    let (values, _) = source.read_on(&host, FrameIndex(0)).unwrap();
    let Value::Calibration(calibration) = &values["calibration"] else { panic!("calibration") };
    assert_eq!((calibration.focal_px, calibration.baseline_m), (707.0493, 0.532_725));
    // Recorded with the values, so without the way to the folder, which differs between machines.
    let reports = "no calibration files in training: depthloom uses KITTI's focal lengths by the width of the image (707 to 722 px) and its baseline of 0.5327 m";
    assert_eq!(*host.0.lock().unwrap(), [reports]);
}

/// A host that stores warnings.
#[derive(Default)]
struct Listening(Mutex<Vec<String>>);

impl Host for Listening {
    fn cancelled(&self) -> bool {
        false
    }

    fn warn_n(&self, _count: u64, what: &str) {
        self.0.lock().unwrap().push(what.to_owned());
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}

#[test]
fn files_that_match_no_frame_are_reported_and_counted() {
    let set = DataSet::new();
    let reports = |more: Json| open("kitti/stereo2015", &set.params(&more)).unwrap().source.warnings().to_vec();
    for file in ["image_2/.DS_Store", "image_3/Thumbs.db", "image_2/000003_09.png"] {
        set.write(file, "");
    }
    assert_eq!(
        reports(json!({})),
        [""; 0],
        "other time steps and files of desktops are not reported as missing frames"
    );
    set.write("image_3/000151_10.png", "");
    assert!(
        reports(json!({}))[0]
            .starts_with("1 file belongs to no frame and is not read: image_3/000151_10.png (a frame is")
    );
    for file in ["image_2/151_10.png", "image_2/000152_10.jpg", "disp_noc_0/000153_10.png"] {
        set.write(file, "");
    }
    let named = "image_2/000152_10.jpg, image_2/151_10.png, image_3/000151_10.png";
    assert!(
        reports(json!({}))[0]
            .starts_with(&format!("4 files belong to no frame and are not read: {named} and 1 more (a frame")),
        "{:?}",
        reports(json!({}))
    );
    let without_truth = format!("3 files belong to no frame and are not read: {named} (a frame");
    assert!(reports(json!({ "ground_truth": "none" }))[0].starts_with(&without_truth));
}

#[test]
fn the_key_is_that_of_the_files_read_not_of_their_place() {
    let (set, moved) = (DataSet::new(), DataSet::new());
    let key = |set: &DataSet, more: Json| {
        let source = open("kitti/stereo2015", &set.params(&more)).unwrap();
        source.read(FrameIndex(source.source.frames().len() - 1)).unwrap().1
    };
    let here = key(&set, json!({}));
    assert_eq!(here, key(&moved, json!({ "frames": [7] })));
    assert_ne!(here, key(&set, json!({ "ground_truth": "none" })));
    moved.write("calib_cam_to_cam/000007.txt", CALIBRATION.replace("-2.5e+02", "-2.6e+02"));
    assert_ne!(here, key(&moved, json!({})));
}

/// A way to break the data, how the source is opened, and whether it is found then or at the frame.
type Breakage = (&'static str, fn(&DataSet), Json, bool);

#[test]
fn broken_data_are_named_with_their_remedy() {
    let breakages: Vec<Breakage> = vec![
        ("missing root", |set| fs::remove_dir_all(set.root.path()).unwrap(), json!({}), true),
        ("no split", |set| fs::remove_dir_all(set.root.path().join("training")).unwrap(), json!({}), true),
        (
            "empty folder",
            |set| {
                for file in ["000003_10.png", "000003_11.png", "000007_10.png", "000007_11.png"] {
                    set.remove(&format!("image_2/{file}"));
                }
            },
            json!({}),
            true,
        ),
        ("no frame selected", |_| {}, json!({ "frames": "8..12" }), true),
        ("frame not there", |_| {}, json!({ "frames": [4] }), true),
        ("missing right image", |set| set.remove("image_3/000003_10.png"), json!({}), true),
        ("missing right folder", |set| set.remove("image_3"), json!({}), true),
        ("missing truth folder", |set| set.remove("disp_occ_0"), json!({ "ground_truth": "occ" }), true),
        ("missing truth file", |set| set.remove("disp_noc_0/000007_10.png"), json!({}), true),
        ("missing calibration file", |set| set.remove("calib_cam_to_cam/000003.txt"), json!({}), true),
        (
            "truncated PNG",
            |set| {
                let bytes = fs::read(set.path("image_2/000003_10.png")).unwrap();
                set.write("image_2/000003_10.png", &bytes[..bytes.len() / 2]);
            },
            json!({}),
            false,
        ),
        ("empty PNG", |set| set.write("image_3/000003_10.png", ""), json!({}), false),
        ("no PNG at all", |set| set.write("image_3/000003_10.png", "<html>404</html>"), json!({}), false),
        (
            "image of floats",
            |set| {
                let floats = DynamicImage::ImageRgb32F(colour(64, 32).into_rgb32f());
                let path = set.path("image_2/000003_10.png");
                floats.save_with_format(path, image::ImageFormat::Tiff).unwrap();
            },
            json!({}),
            false,
        ),
        ("pair of two sizes", |set| set.save("image_3/000003_10.png", &colour(60, 32)), json!({}), false),
        ("truth of another size", |set| set.save("disp_noc_0/000003_10.png", &truth(64, 30)), json!({}), false),
        ("8-bit truth", |set| set.save("disp_noc_0/000003_10.png", &GrayImage::new(64, 32).into()), json!({}), false),
        (
            "calibration without a number",
            |set| set.write("calib_cam_to_cam/000003.txt", CALIBRATION.replace("-2.5e+02", "-2,5e+02")),
            json!({}),
            false,
        ),
        (
            "cameras that are not rectified",
            |set| {
                set.write(
                    "calib_cam_to_cam/000003.txt",
                    CALIBRATION.replace("P_rect_03: 5.0e+02", "P_rect_03: 4.5e+02"),
                );
            },
            json!({}),
            false,
        ),
        (
            "calibration cut short",
            |set| set.write("calib_cam_to_cam/000003.txt", &CALIBRATION[..120]),
            json!({}),
            false,
        ),
        (
            "calibration of another kind",
            |set| set.write("calib_cam_to_cam/000003.txt", "fx 500\nfy 500\n"),
            json!({}),
            false,
        ),
        ("unknown width, no calibration", |set| set.remove("calib_cam_to_cam"), json!({}), false),
    ];
    let mut reports = String::new();
    for (name, break_it, more, at_opening) in breakages {
        let set = DataSet::new();
        break_it(&set);
        let fault = if at_opening { set.at_opening(&more) } else { set.at_frame(&more) };
        assert!(fault.remedy_text().is_some(), "{name}: no remedy");
        reports +=
            &format!("{name}, {}\n  {}\n", if at_opening { "at opening" } else { "at the frame" }, set.report(&fault));
    }
    insta::assert_snapshot!(reports);
}

#[test]
fn a_missing_root_reports_which_folder_is_expected() {
    let fault = open("kitti/stereo2015", &json!({})).err().unwrap();
    assert!(fault.to_string().starts_with("root: root is missing: root contains `training`"), "{fault}");
    let unknown = open("kitti/stereo2015", &json!({ "root": Path::new("x"), "ground_truth": "ooc" })).err().unwrap();
    assert!(unknown.to_string().contains("expected one of `noc`, `occ`, `none`"), "{unknown}");
}

#[test]
fn ground_truth_disparities_are_read_on_request_if_they_exist() {
    let set = DataSet::new();
    let read = |params: Json| {
        let mut params = params;
        params["root"] = json!(set.root.path());
        open("kitti/stereo2015", &params).unwrap().read(FrameIndex(0)).unwrap()
    };
    let (plain, plain_key) = read(json!({}));
    assert!(["disp_noc", "disp_occ", "occluded", "obj_map"].iter().all(|port| !plain.contains_key(port)));
    let known = |x, y| if (x + y) % 3 == 0 { 256 * 10 } else { 0 };
    let noc = ImageBuffer::<Luma<u16>, _>::from_fn(64, 32, |x, y| Luma([if x > 20 { known(x, y) } else { 0 }]));
    let occ = ImageBuffer::<Luma<u16>, _>::from_fn(64, 32, |x, y| Luma([known(x, y)]));
    for number in ["000003", "000007"] {
        set.save(&format!("disp_noc_0/{number}_10.png"), &DynamicImage::ImageLuma16(noc.clone()));
        set.save(&format!("disp_occ_0/{number}_10.png"), &DynamicImage::ImageLuma16(occ.clone()));
        let objects = GrayImage::from_fn(64, 32, |x, _| Luma([if x < 10 { 7 } else { 0 }]));
        set.save(&format!("obj_map/{number}_10.png"), &DynamicImage::ImageLuma8(objects));
    }
    let (given, key) = read(json!({ "disparities": true }));
    let disparities = |port: &str| match &given[port] {
        Value::TrueDisparity(truth) => truth.px_256().unwrap().into_raw(),
        other => panic!("{port} is {}", other.value_type()),
    };
    assert_eq!((disparities("disp_noc"), disparities("disp_occ")), (noc.clone().into_raw(), occ.clone().into_raw()));
    let (Value::Mask(occluded), Value::Mask(objects)) = (&given["occluded"], &given["obj_map"]) else {
        panic!("masks")
    };
    for (x, y, hidden) in occluded.set.enumerate_pixels() {
        assert_eq!(hidden.0[0], if x <= 20 && known(x, y) > 0 { 255 } else { 0 });
    }
    assert!(objects.set.enumerate_pixels().all(|(x, _, set)| set.0[0] == if x < 10 { 255 } else { 0 }));
    // The depth is unchanged; the key covers the files that were read, and is the previous one if nothing more is read.
    let (other, other_key) = read(json!({ "disparities": true, "ground_truth": "occ" }));
    assert!(crate::stereo_sets::agree(&other) > 0);
    let (unread, unread_key) = read(json!({ "disparities": false }));
    assert_eq!(metres(&given["depth"]).len(), metres(&unread["depth"]).len());
    assert!(other.contains_key("disp_noc") && key != other_key && key != unread_key && unread_key != plain_key);
    set.remove("obj_map");
    set.remove("disp_occ_0");
    assert_ne!(read(json!({ "disparities": true })).1, unread_key, "the same files, but more is given");
    let (fewer, _) = read(json!({ "disparities": true }));
    let there = ["disp_noc", "disp_occ", "occluded", "obj_map"].map(|port| fewer.contains_key(port));
    assert_eq!(there, [true, false, false, false], "missing files have no outputs");
}
