//! `kitti/raw`: against the oracle's projection, against monodepth2's rules in NumPy, and messages about broken
//! drives.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_graphs::Value;
use depthloom_test_needs::{python, shared, workspace};
use image::{DynamicImage, RgbImage};
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::call::{metres, open, png_u16};

const DRIVE: &str = "2011_09_26_drive_0002_sync";

/// A camera of KITTI's size in small, half a metre of baseline; the second and third colour camera stand left and
/// right.
const CAMERA: &str = "calib_time: 09-Jan-2012 13:57:47
S_rect_02: 4.0e+01 3.0e+01
R_rect_00: 1 0 0 0 1 0 0 0 1
P_rect_02: 20 0 20 0 0 20 15 0 0 0 1 0
P_rect_03: 20 0 20 -10 0 20 15 0 0 0 1 0
";

/// The scanner looks along the camera's axis: camera x = -y, y = -z, z = x.
const SCANNER: &str = "calib_time: 15-Mar-2012 11:37:16
R: 0 -1 0 0 0 -1 1 0 0
T: 0 0 0
";

/// Two drives: one of three frames whose second has no scan, one of a single frame.
struct Raw {
    root: PathBuf,
    _folder: Option<TempDir>,
}

/// What breaks a drive.
type Breaks<'a> = dyn Fn(&Raw) + 'a;

/// A small set in a folder, as parameters.
pub(crate) fn small(root: &Path) -> Json {
    Raw { root: root.to_owned(), _folder: None }.filled().params(&json!({}))
}

impl Raw {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { root: folder.path().to_owned(), _folder: Some(folder) }.filled()
    }

    fn filled(self) -> Self {
        let raw = self;
        for (drive, frames) in [(DRIVE, 3), ("2011_09_26_drive_0005_sync", 1)] {
            for frame in 0..frames {
                for camera in ["image_02", "image_03"] {
                    raw.save(&format!("{drive}/{camera}/data/{frame:010}.png"), 40, 30);
                }
                if frame != 1 {
                    raw.write(&format!("{drive}/velodyne_points/data/{frame:010}.bin"), scan(frame));
                }
            }
        }
        // One time more than there are frames, as in the data.
        let times = "2011-09-26 13:02:44.000000001\n2011-09-26 13:02:44.100000002\n2011-09-26 13:02:44.200000003\n2011-09-26 13:02:44.3\n";
        raw.write(&format!("{DRIVE}/image_02/timestamps.txt"), times);
        raw.write("calib_cam_to_cam.txt", CAMERA);
        raw.write("calib_velo_to_cam.txt", SCANNER);
        raw
    }

    fn path(&self, file: &str) -> PathBuf {
        self.root.join("2011_09_26").join(file)
    }

    fn write(&self, file: &str, content: impl AsRef<[u8]>) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    fn save(&self, file: &str, width: u32, height: u32) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let image = RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 7]));
        DynamicImage::ImageRgb8(image).save(path).unwrap();
    }

    fn params(&self, more: &Json) -> Json {
        let mut params = json!({ "root": self.root });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    }

    /// The message at opening or at the first frame, with the temporary folder called ROOT.
    fn report(&self, more: &Json) -> String {
        let fault = open("kitti/raw", &self.params(more)).and_then(|source| source.read(FrameIndex(0)).map(drop));
        let fault = fault.expect_err("it is refused");
        let remedy = fault.remedy_text().map_or_else(String::new, |text| format!("\n  remedy: {text}"));
        format!("{}{remedy}", fault.chain()).replace(&self.root.display().to_string(), "ROOT")
    }
}

/// Points all over a small image and beyond its edges, several a pixel; many at the edge columns.
fn scan(seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_add(0x9E37_79B9);
    let mut below = |n: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % n
    };
    let mut bytes = Vec::new();
    for point in 0..4000 {
        let depth = 2.0 + below(6000) as f32 / 100.0;
        let column = match point % 4 {
            0 => [-1.0, 0.0, 1.0, 39.0, 40.0, 41.0][below(6) as usize],
            _ => below(4400) as f32 / 100.0 - 2.0,
        };
        let row = below(3400) as f32 / 100.0 - 2.0;
        let x = if below(20) == 0 { -depth } else { depth };
        for number in [x, -(column - 20.0) / 20.0 * depth, -(row - 15.0) / 20.0 * depth, 0.3] {
            bytes.extend(number.to_le_bytes());
        }
    }
    bytes
}

#[test]
fn scans_are_the_oracles() {
    let Some(shared) = shared("scans_are_the_oracles") else { return };
    let source = open("kitti/raw", &json!({ "root": shared.join("data/kitti_raw") })).unwrap();
    assert_eq!(source.source.frames().len(), 3);
    for (position, frame) in source.source.frames().iter().enumerate() {
        let (values, _) = source.read(FrameIndex(position)).unwrap();
        let golden = png_u16(&shared.join(format!("oracle/golden/velodyne/{:010}.png", frame.index)));
        assert_eq!(&*frame.id, format!("{DRIVE}_{:010}", frame.index));
        let known = metres(&values["depth"]).iter().filter(|metres| metres.is_finite()).count();
        assert_eq!(known, golden.iter().filter(|metres| **metres > 0).count());
        for (ours, theirs) in metres(&values["depth"]).iter().zip(golden.iter()) {
            let ours = if ours.is_nan() { 0.0 } else { (f64::from(*ours) * 256.0).round_ties_even() };
            assert!((ours - f64::from(*theirs)).abs() <= 1.0, "{ours} and {theirs} 256ths of a metre");
        }
        let Value::Calibration(calibration) = &values["calibration"] else { panic!() };
        assert!((calibration.baseline_m - 0.532_719).abs() < 1e-5, "{}", calibration.baseline_m);
        assert!(frame.time_ns > 1_317_042_164_000_000_000, "the left camera's clock");
    }
}

#[test]
fn with_monodepth2s_rules_ground_truth_equals_its_transcription() {
    const TEST: &str = "with_monodepth2s_rules_ground_truth_equals_its_transcription";
    let Some(python) = python(TEST) else { return };
    let raw = Raw::new();
    let mut drives = vec![raw.root.clone()];
    drives.extend(shared(TEST).map(|shared| shared.join("data/kitti_raw")));
    for root in drives {
        for (compat, argument) in [("monodepth2", None), ("monodepth2-eigen", Some("--scanner-depth"))] {
            let params = json!({ "root": root, "drives": [DRIVE], "frames": [0, 2], "compat": compat });
            let source = open("kitti/raw", &params).unwrap();
            for (position, frame) in source.source.frames().iter().enumerate() {
                let (values, _) = source.read(FrameIndex(position)).unwrap();
                let Value::Image(left) = &values["left"] else { panic!() };
                let (width, height) = left.dimensions();
                let date = root.join("2011_09_26");
                let scan = date.join(DRIVE).join(format!("velodyne_points/data/{:010}.bin", frame.index));
                let mut command = Command::new(&python);
                command.arg(workspace().join("nodes/tests/monodepth2.py")).arg(date).arg(scan);
                command.args([width, height].map(|n| n.to_string())).args(argument);
                let theirs = command.output().unwrap();
                assert!(theirs.status.success(), "{}", String::from_utf8_lossy(&theirs.stderr));
                let theirs = theirs.stdout.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
                let ours = metres(&values["depth"]).iter().map(|m| if m.is_nan() { 0.0 } else { *m });
                let (ours, theirs): (Vec<f32>, Vec<f32>) = (ours.collect(), theirs.collect());
                assert_eq!(ours.len(), theirs.len());
                let width = width as usize;
                for (at, (ours, theirs)) in ours.iter().zip(&theirs).enumerate() {
                    let place = (at % width, at / width);
                    assert!((ours - theirs).abs() <= 1e-6 * theirs, "{compat}, {place:?}: {ours} and {theirs}");
                }
                for column in [0, width - 1] {
                    let known = ours.iter().skip(column).step_by(width).filter(|metres| **metres > 0.0).count();
                    assert!(known > 0 || ours.len() > 2000, "the edge columns have points");
                }
            }
        }
    }
}

#[test]
fn a_drives_frames_have_its_numbers_and_times_and_several_are_counted() {
    let raw = Raw::new();
    let one =
        open("kitti/raw", &raw.params(&json!({ "drives": ["2011_09_26_drive_0002"], "frames": [2, 1] }))).unwrap();
    let frames: Vec<_> = one.source.frames().iter().map(|f| (f.index, &*f.id, f.time_ns % 1_000_000_000)).collect();
    assert_eq!(
        frames,
        [
            (2, "2011_09_26_drive_0002_sync_0000000002", 200_000_003),
            (1, "2011_09_26_drive_0002_sync_0000000001", 100_000_002)
        ]
    );
    assert_eq!(one.source.warnings(), ["1 of 2 frames have no laser scan, and so no ground truth"]);
    assert!(one.read(FrameIndex(0)).unwrap().0.contains_key("depth"));
    assert!(!one.read(FrameIndex(1)).unwrap().0.contains_key("depth"));

    let all = open("kitti/raw", &raw.params(&json!({}))).unwrap();
    let indices: Vec<_> = all.source.frames().iter().map(|f| f.index).collect();
    assert_eq!((indices, &*all.source.frames()[3].id), (vec![0, 1, 2, 3], "2011_09_26_drive_0005_sync_0000000000"));
    // A date's own folder is a root, too.
    let date = open("kitti/raw", &json!({ "root": raw.path("") })).unwrap();
    assert_eq!(date.source.frames(), all.source.frames());
}

#[test]
fn fault_14_frames_come_in_the_order_of_their_numbers_whatever_the_length_of_their_names() {
    let raw = Raw::new();
    let renamed = |names: [&str; 3]| {
        for camera in ["image_02", "image_03"] {
            let data = raw.path(&format!("{DRIVE}/{camera}/data"));
            fs::remove_dir_all(&data).unwrap();
            names.iter().for_each(|name| raw.save(&format!("{DRIVE}/{camera}/data/{name}.png"), 40, 30));
        }
    };
    fs::remove_file(raw.path(&format!("{DRIVE}/image_02/timestamps.txt"))).unwrap();
    let found = |frames: Json| -> Vec<(u64, String, u64)> {
        let source = open("kitti/raw", &raw.params(&json!({ "drives": [DRIVE], "frames": frames }))).unwrap();
        let frames = source.source.frames();
        frames.iter().map(|frame| (frame.index, frame.id[DRIVE.len() + 1..].to_owned(), frame.time_ns)).collect()
    };
    let is = |index: u64, name: &str| (index, name.to_owned(), index * 100_000_000);
    renamed(["9", "10", "11"]);
    assert_eq!(found(json!("9..=11")), [is(9, "9"), is(10, "10"), is(11, "11")]);
    assert_eq!(found(json!("9..=10 available")), [is(9, "9"), is(10, "10")]);
    // Time stamps are names, not numbers of frames (fault 15).
    renamed(["999999999999999999", "1317042164317412775", "1317042164417412775"]);
    let stamps = [is(0, "999999999999999999"), is(1, "1317042164317412775"), is(2, "1317042164417412775")];
    assert_eq!(found(json!("0..3")), stamps);
}

#[test]
fn fault_41_a_drive_is_recognised_without_the_folder_of_its_date() {
    let raw = Raw::new();
    let registry = depthloom_nodes::registry();
    let recognised = |root: &Path| registry.source_kind("kitti/raw").unwrap().recognise(root);
    // The drive's own folder is a drive of the folder above.
    let found = recognised(&raw.path(DRIVE));
    assert_eq!(found[0].params, json!({ "root": raw.root.join("2011_09_26"), "drives": [DRIVE], "cameras": "color" }));
    assert_eq!(open("kitti/raw", &found[0].params).unwrap().source.frames().len(), 3);
    // Without a calibration the check is skipped, and this is reported.
    fs::remove_file(raw.path("calib_cam_to_cam.txt")).unwrap();
    let found = recognised(&raw.path(""));
    assert_eq!(found.len(), 1);
    let fault = open("kitti/raw", &found[0].params).map(drop).expect_err("there is no calibration");
    assert!(
        fault.chain().contains("there is no file") && fault.chain().contains("calib_cam_to_cam.txt"),
        "{}",
        fault.chain()
    );
}

#[test]
fn a_split_gives_frames_in_its_order_and_each_pair_once() {
    let raw = Raw::new();
    let split = raw.path("eigen.txt");
    let lines = "2011_09_26/2011_09_26_drive_0005_sync 0000000000 l
2011_09_26/2011_09_26_drive_0002_sync 0000000002 r

2011_09_26/2011_09_26_drive_0002_sync/image_02/data/0000000000.png
2011_09_26/2011_09_26_drive_0002_sync 2 l
";
    fs::write(&split, lines).unwrap();
    let source = open("kitti/raw", &raw.params(&json!({ "split": split }))).unwrap();
    let ids: Vec<_> = source.source.frames().iter().map(|f| (f.index, &*f.id)).collect();
    let id = |drive, frame| format!("2011_09_26_drive_{drive:04}_sync_{frame:010}");
    assert_eq!(ids, [(0, &*id(5, 0)), (1, &*id(2, 2)), (2, &*id(2, 0))]);
    assert_eq!(source.source.warnings().len(), 1, "that a line names a frame again");
    fs::write(&split, "2011_09_26/2011_09_26_drive_0002_sync 0000000000 l\nnonsense\n").unwrap();
    let report = raw.report(&json!({ "split": split }));
    assert!(report.starts_with("ROOT/2011_09_26/eigen.txt:2: `nonsense` names no frame"), "{report}");
    fs::write(&split, "\n").unwrap();
    assert!(raw.report(&json!({ "split": split })).starts_with("ROOT/2011_09_26/eigen.txt names no frame"));
    fs::write(&split, "2011_09_26/2011_09_26_drive_0007_sync 0000000000 l\n").unwrap();
    let report = raw.report(&json!({ "split": split }));
    assert!(
        report.starts_with("ROOT/2011_09_26/eigen.txt:1: there is no drive 2011_09_26_drive_0007_sync"),
        "{report}"
    );
}

#[test]
fn broken_data_are_named_with_a_remedy() {
    let refused = |breaks: &Breaks<'_>| {
        let raw = Raw::new();
        breaks(&raw);
        raw.report(&json!({ "drives": [DRIVE] }))
    };
    let remove = |raw: &Raw, file: &str| fs::remove_file(raw.path(file)).unwrap();
    let cases: [(&str, &Breaks<'_>); 7] = [
        ("a right image is missing", &|raw| remove(raw, &format!("{DRIVE}/image_03/data/0000000002.png"))),
        ("no calibration", &|raw| remove(raw, "calib_cam_to_cam.txt")),
        ("no scanner", &|raw| remove(raw, "calib_velo_to_cam.txt")),
        ("another size", &|raw| {
            raw.save(&format!("{DRIVE}/image_02/data/0000000000.png"), 41, 30);
            raw.save(&format!("{DRIVE}/image_03/data/0000000000.png"), 41, 30);
        }),
        ("a right image of another size", &|raw| raw.save(&format!("{DRIVE}/image_03/data/0000000000.png"), 41, 30)),
        ("a truncated scan", &|raw| raw.write(&format!("{DRIVE}/velodyne_points/data/0000000000.bin"), [0; 30])),
        ("a wrong time", &|raw| raw.write(&format!("{DRIVE}/image_02/timestamps.txt"), "yesterday\n")),
    ];
    let report: Vec<String> = cases.iter().map(|(name, breaks)| format!("{name}:\n{}\n", refused(breaks))).collect();
    insta::assert_snapshot!(report.join("\n"));
}

#[test]
fn missing_data_are_reported_without_kitti() {
    let empty = tempfile::tempdir().unwrap();
    let report = |root: &Path| open("kitti/raw", &json!({ "root": root })).err().unwrap().to_string();
    assert!(report(&empty.path().join("not")).starts_with("there is no folder"));
    assert!(report(empty.path()).ends_with("holds no drive"));
}
