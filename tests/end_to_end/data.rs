//! `depthloom check --data` and `depthloom inspect`: data sets are checked before anything is computed from them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use image::{DynamicImage, ImageBuffer, Luma};
use serde_json::Value as Json;

use crate::support::{depthloom, succeed};

/// An image folder `pairs/`: frames 0 to 5 of a street, with their calibration and ground truth.
struct Rig {
    folder: tempfile::TempDir,
}

const EXPERIMENT: &str = "experiment: own
sources:
  own:
    kind: images
    with:
      root: pairs
      left: \"cam0/*.png\"
      right: \"cam1/*.png\"
      calibration: CALIBRATION
      ground_truth: { files: \"truth/*.png\", unit: pixels, divide_by: 256 }
stages:
  look:
    source: own
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: { from: depth/depth } } }
";

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = Self { folder };
        let size = ["--width", "480", "--height", "144", "--frames", "6", "--quiet"];
        succeed(depthloom().arg("synth").arg(rig.path("kitti")).args(size));
        for (from, to) in [("image_2", "cam0"), ("image_3", "cam1"), ("disp_occ_0", "truth")] {
            fs::create_dir_all(rig.path("pairs").join(to)).expect("made");
            for frame in 0..6 {
                let from = rig.path(&format!("kitti/training/{from}/{frame:06}_10.png"));
                fs::copy(from, rig.path(&format!("pairs/{to}/{frame}.png"))).expect("copied");
            }
        }
        let calibration = fs::read_to_string(rig.path("kitti/training/calib_cam_to_cam/000000.txt")).expect("read");
        let numbers = |name: &str| -> Vec<f64> {
            let line = calibration.lines().find_map(|line| line.strip_prefix(name)).expect("a line");
            line.split_whitespace().map(|number| number.parse().expect("a number")).collect()
        };
        let (left, right) = (numbers("P_rect_02:"), numbers("P_rect_03:"));
        let known = format!("{{ focal_px: {:?}, baseline_m: {:?} }}", left[0], -right[3] / right[0]);
        fs::write(rig.path("own.yaml"), EXPERIMENT.replace("CALIBRATION", &known)).expect("written");
        rig
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    fn check(&self, arguments: &[&str]) -> Output {
        depthloom().arg("check").arg(self.path("own.yaml")).arg("--data").args(arguments).output().expect("it runs")
    }

    /// The printed text, with ROOT for the folder, and without the progress that is printed after five seconds:
    /// `own: 3/4 frames, 0 faults`.
    fn text_of(&self, bytes: &[u8]) -> String {
        let text = String::from_utf8_lossy(bytes).replace(&self.folder.path().display().to_string(), "ROOT");
        let is_progress = |line: &str| {
            let done = line.split_once(": ").and_then(|(_, rest)| rest.split_once('/')).map(|(done, _)| done);
            done.is_some_and(|done| done.parse::<u64>().is_ok()) && line.contains(" frame")
        };
        text.split_inclusive('\n').filter(|line| !is_progress(line)).collect()
    }
}

fn snapshot(name: &str, text: &str) {
    insta::with_settings!({ omit_expression => true }, { insta::assert_snapshot!(name, text); });
}

fn save(image: impl Into<DynamicImage>, path: &Path) {
    image.into().save(path).expect("written");
}

#[test]
fn valid_data_pass_the_check() {
    let rig = Rig::new();
    let output = succeed(depthloom().arg("check").arg(rig.path("own.yaml")).args(["--data", "-j", "2"]));
    let printed = rig.text_of(&output.stdout);
    assert_eq!(printed.lines().last(), Some("source `own` (images): 6 frames, nothing wrong"), "{printed}");
}

#[test]
fn a_missing_baseline_and_whole_metres_of_8_bits_are_found() {
    let rig = Rig::new();
    let experiment = "experiment: own
sources:
  own:
    kind: images
    with:
      root: pairs
      left: \"cam0/*.png\"
      calibration: { focal_px: 500 }
      ground_truth: { files: \"truth/*.png\" }
stages:
  look:
    source: own
    nodes:
      read: { kind: disparity/files, inputs: { image: source/left }, with: { files: \"pairs/truth/{frame}.png\" } }
      depth: { kind: depth/from-disparity, inputs: { disparity: read/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { read: { from: depth/depth } } }
";
    fs::write(rig.path("own.yaml"), experiment).expect("written");
    for frame in 0..6 {
        let file = rig.path(&format!("pairs/truth/{frame}.png"));
        save(image::open(&file).expect("a map").into_luma8(), &file);
    }
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    let stderr = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    let baseline =
        "its `calibration` is that of a single camera, and node `look.depth` (depth/from-disparity) needs a baseline";
    assert!(stderr.contains(baseline) && stderr.contains("set `baseline_m`"), "{stderr}");
    assert_eq!(stderr.matches("the ground truth has 8 bits and is read as whole metres").count(), 1, "{stderr}");
    // A divisor states what the numbers are.
    let stated = experiment
        .replace("truth/*.png\" }", "truth/*.png\", divide_by: 3 }")
        .replace("focal_px: 500", "focal_px: 500, baseline_m: 0.5");
    fs::write(rig.path("own.yaml"), stated).expect("written");
    let output = rig.check(&[]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("8 bits") && !stderr.contains("baseline"), "{stderr}");
}

#[test]
fn every_fault_of_the_data_is_reported_in_one_pass() {
    let rig = Rig::new();
    let pairs = |file: &str| rig.path("pairs").join(file);
    // Frame 0: no right image. 1: both truncated. 2: sizes differ. 3: exchanged. 4: ground truth at another scale.
    // 5: ground truth with 8 bits.
    fs::remove_file(pairs("cam1/0.png")).expect("removed");
    for side in ["cam0", "cam1"] {
        let file = pairs(&format!("{side}/1.png"));
        let bytes = fs::read(&file).expect("read");
        fs::write(&file, &bytes[..bytes.len() / 2]).expect("written");
    }
    let right = image::open(pairs("cam1/2.png")).expect("an image");
    save(right.crop_imm(0, 0, 400, 144), &pairs("cam1/2.png"));
    fs::rename(pairs("cam0/3.png"), pairs("x.png")).expect("renamed");
    fs::rename(pairs("cam1/3.png"), pairs("cam0/3.png")).expect("renamed");
    fs::rename(pairs("x.png"), pairs("cam1/3.png")).expect("renamed");
    let truth = image::open(pairs("truth/4.png")).expect("a map").into_luma16();
    let tenth = ImageBuffer::from_fn(480, 144, |x, y| Luma([truth.get_pixel(x, y).0[0] / 10]));
    save(DynamicImage::ImageLuma16(tenth), &pairs("truth/4.png"));
    save(image::open(pairs("truth/5.png")).expect("a map").into_luma8(), &pairs("truth/5.png"));
    let output = rig.check(&["-j", "2"]);
    assert_eq!(output.status.code(), Some(2));
    snapshot("every_fault_of_the_data", &format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr)));

    let output = rig.check(&["--json"]);
    assert_eq!(output.status.code(), Some(2));
    let checked: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let faults = checked["data"][0]["faults"].as_array().expect("faults");
    let frames: Vec<Option<&str>> = faults.iter().map(|fault| fault["frame"].as_str()).collect();
    assert_eq!(frames, [None, Some("1"), Some("1"), Some("2"), Some("3"), Some("4"), Some("5")]);
    assert_eq!(checked["error"]["exit_code"], 2);
    assert_eq!(checked["error"]["diagnostics"].as_array().map(Vec::len), Some(7));
}

#[test]
fn implausible_pairs_and_faults_of_all_frames_are_reported() {
    let rig = Rig::new();
    let pairs = |file: &str| rig.path("pairs").join(file);
    // Frame 0: right equals left. 1: both black. 2: right is 6 rows off. 3: ground truth without a valid pixel.
    fs::copy(pairs("cam0/0.png"), pairs("cam1/0.png")).expect("copied");
    for side in ["cam0", "cam1"] {
        save(DynamicImage::new_rgb8(480, 144), &pairs(&format!("{side}/1.png")));
    }
    let right = image::open(pairs("cam1/2.png")).expect("an image").into_rgb8();
    let lower = ImageBuffer::from_fn(480, 144, |x, y| *right.get_pixel(x, (y + 6).min(143)));
    save(DynamicImage::ImageRgb8(lower), &pairs("cam1/2.png"));
    save(DynamicImage::new_luma16(480, 144), &pairs("truth/3.png"));
    let output = rig.check(&["-j", "2"]);
    assert_eq!(output.status.code(), Some(2));
    snapshot("implausible_pairs", &format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr)));

    // Disparities declared as metres: a fault of all frames, reported once.
    let rig = Rig::new();
    let text = fs::read_to_string(rig.path("own.yaml")).expect("read");
    fs::write(rig.path("own.yaml"), text.replace("unit: pixels", "unit: metres")).expect("written");
    let output = rig.check(&["-j", "2"]);
    assert_eq!(output.status.code(), Some(2));
    snapshot("a_fault_of_all_frames", &format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr)));
}

#[test]
fn all_independent_faults_of_a_frame_or_a_source_are_reported_in_one_pass() {
    let rig = Rig::new();
    let pairs = |file: &str| rig.path("pairs").join(file);
    let halve = |file: &str| {
        let bytes = fs::read(pairs(file)).expect("read");
        fs::write(pairs(file), &bytes[..bytes.len() / 2]).expect("written");
    };
    // Frame 0: no right image, and left truncated. 1: left and ground truth truncated. 2: sizes differ, and the ground
    // truth has 8 bits.
    fs::remove_file(pairs("cam1/0.png")).expect("removed");
    ["cam0/0.png", "cam0/1.png", "truth/1.png"].iter().for_each(|file| halve(file));
    save(image::open(pairs("cam1/2.png")).expect("an image").crop_imm(0, 0, 400, 144), &pairs("cam1/2.png"));
    save(image::open(pairs("truth/2.png")).expect("a map").into_luma8(), &pairs("truth/2.png"));
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    let mut errors = rig.text_of(&output.stderr);

    let kitti = |file: &str| rig.path("kitti/training").join(file);
    for file in ["image_3/000001_10.png", "disp_noc_0/000001_10.png", "calib_cam_to_cam/000001.txt"] {
        fs::remove_file(kitti(file)).expect("removed");
    }
    let bytes = fs::read(kitti("image_2/000001_10.png")).expect("read");
    fs::write(kitti("image_2/000001_10.png"), &bytes[..bytes.len() / 2]).expect("written");
    let text = fs::read_to_string(rig.path("own.yaml")).expect("read");
    let (head, rest) = text.split_once("sources:").expect("it has some");
    let rest = rest.split_once("stages:").expect("it has some").1;
    let source = "sources: { own: { kind: kitti/stereo2015, with: { root: kitti } } }\nstages:";
    fs::write(rig.path("own.yaml"), format!("{head}{source}{rest}")).expect("written");
    errors.push_str(&rig.text_of(&rig.check(&[]).stderr));

    // Faults on opening the source: no right images, no ground truth, and no calibration file.
    let wrong = text.replace("cam1/", "cam7/").replace("truth/", "depth/");
    let at = wrong.find("calibration:").expect("it has one");
    let end = at + wrong[at..].find('\n').expect("a line");
    let wrong = format!("{}calibration: {{ files: [left.yaml, right.yaml] }}{}", &wrong[..at], &wrong[end..]);
    fs::write(rig.path("own.yaml"), wrong).expect("written");
    errors.push_str(&rig.text_of(&rig.check(&[]).stderr));
    snapshot("every_independent_fault", &errors);
}

#[test]
fn scores_without_ground_truth_are_reported_by_check_and_fail_a_run() {
    let rig = Rig::new();
    for frame in 1..6 {
        fs::remove_file(rig.path(&format!("pairs/truth/{frame}.png"))).expect("removed");
    }
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(0));
    let stderr = rig.text_of(&output.stderr);
    assert!(stderr.contains("5 of 6 frames have no `depth`, against which stage `look` scores"), "{stderr}");
    let text = fs::read_to_string(rig.path("own.yaml")).expect("read");
    let with_frames = |frames: &str| text.replace("left: \"cam0", &format!("frames: {frames}\n      left: \"cam0"));
    fs::write(rig.path("own.yaml"), with_frames("[2, 3]")).expect("written");
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    let mut printed = format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr));
    let run = |out: &str| {
        let mut run = depthloom();
        run.args(["run", "--no-page"])
            .arg(rig.path("own.yaml"))
            .arg("--out")
            .arg(rig.path(out))
            .output()
            .expect("it runs")
    };
    let output = run("none");
    assert_eq!(output.status.code(), Some(3));
    let stderr = rig.text_of(&output.stderr);
    let warnings = stderr.lines().filter(|line| line.starts_with("warning: ") || line.starts_with("no pixel"));
    printed.extend(warnings.map(|line| format!("{line}\n")));
    let stdout = rig.text_of(&output.stdout);
    printed.extend(stdout.lines().filter(|line| line.starts_with("note: ")).map(|line| format!("{line}\n")));
    snapshot("scores_without_ground_truth", &printed);
    let report = depthloom().arg("report").arg(rig.path("none")).output().expect("it runs");
    assert_eq!(report.status.code(), Some(3));

    // Disparities are scored, but have no error against distance, which is not reported as missing.
    let disparity = with_frames("[0]").replace(
        "ground_truth: source/depth, estimates: { stereo: { from: depth/depth } }",
        "ground_truth: source/disparity, estimates: { stereo: { from: stereo/disparity } }",
    );
    fs::write(rig.path("own.yaml"), disparity).expect("written");
    let output = run("disparity");
    assert_eq!(output.status.code(), Some(0), "{}", rig.text_of(&output.stderr));
    let printed = rig.text_of(&output.stdout);
    assert!(printed.contains("epe") && !printed.contains("no error against distance"), "{printed}");
}

#[test]
fn a_calibration_that_contradicts_the_images_is_reported() {
    let rig = Rig::new();
    let wrong = EXPERIMENT.replace("CALIBRATION", "{ focal_px: 3.6, baseline_m: 0.5, cx_px: 640, cy_px: 70 }");
    fs::write(rig.path("own.yaml"), wrong.replace("right: \"cam1/*.png\"", "right: \"cam1/*.png\"\n      frames: [2]"))
        .expect("written");
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    snapshot("a_calibration_that_contradicts_the_images", &rig.text_of(&output.stderr));
}

#[test]
fn a_source_that_does_not_open_still_lists_everything() {
    let rig = Rig::new();
    for file in
        ["image_3/000001_10.png", "image_3/000002_10.png", "disp_noc_0/000004_10.png", "calib_cam_to_cam/000003.txt"]
    {
        fs::remove_file(rig.path("kitti/training").join(file)).expect("removed");
    }
    fs::write(rig.path("kitti/training/image_2/000005_10.png"), "").expect("written");
    let source = "sources: { own: { kind: kitti/stereo2015, with: { root: kitti } } }\nstages:";
    let (head, rest) = EXPERIMENT.split_once("sources:").expect("it has some");
    let rest = rest.split_once("stages:").expect("it has some").1;
    fs::write(rig.path("own.yaml"), format!("{head}{source}{rest}")).expect("written");
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    snapshot("a_source_that_does_not_open", &rig.text_of(&output.stderr));
}

/// Checks an experiment that uses the first source of the printed `sources:`.
fn check_pasted(rig: &Rig, stanza: &str) {
    let name = stanza.lines().nth(1).expect("a source").trim().trim_end_matches(':');
    let stages = format!(
        "stages:\n  look:\n    source: {name}\n    nodes:\n      stereo: {{ kind: stereo/bm, inputs: {{ left: source/left, right: source/right }} }}\n"
    );
    fs::write(rig.path("pasted.yaml"), format!("experiment: pasted\n{stanza}{stages}")).expect("written");
    succeed(depthloom().arg("check").arg(rig.path("pasted.yaml")));
}

#[test]
fn a_data_set_is_recognised_and_its_sources_can_be_pasted() {
    let rig = Rig::new();
    let output = succeed(depthloom().arg("inspect").arg(rig.path("kitti")));
    let printed = rig.text_of(&output.stdout);
    snapshot("data_of_kitti", &printed);
    let stdout = String::from_utf8(output.stdout).expect("UTF-8");
    check_pasted(&rig, &stdout[stdout.find("sources:\n").expect("a stanza")..]);
    // Its folder `training` is recognised as that half of the data set.
    let half = succeed(depthloom().arg("inspect").arg(rig.path("kitti/training")));
    assert_eq!(rig.text_of(&half.stdout), printed);

    let sheet = rig.path("sheet.png");
    let output =
        succeed(depthloom().arg("inspect").arg(rig.path("pairs")).args(["--json", "--contact-sheet"]).arg(&sheet));
    let data: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    let found = &data["found"][0];
    assert_eq!((&found["kind"], &found["frames"]), (&"images".into(), &6.into()));
    assert_eq!(found["sizes"][0]["width"], 480);
    check_pasted(&rig, data["stanza"].as_str().expect("text"));
    // Four frames across, two rows: 320x96 each.
    assert_eq!(image::image_dimensions(&sheet).expect("a PNG"), (4 * 326 + 6, 2 * (96 + 6) + 6));

    succeed(depthloom().arg("inspect").arg(rig.path("kitti")).arg("--contact-sheet").arg(&sheet));
    let sheet = image::open(&sheet).expect("a PNG").into_rgb8();
    assert_eq!(sheet.dimensions(), (4 * 326 + 6, 2 * (2 * 96 + 6) + 6), "ground truth below each image");
    let red = sheet.pixels().filter(|pixel| pixel.0[0] > 150 && pixel.0[2] < 60).count();
    assert!(red > 1000, "near points are red: {red}");
}

#[test]
fn an_unknown_folder_is_described_by_its_files() {
    let rig = Rig::new();
    for file in ["a/one.png", "a/two.png", "b/notes.txt", "readme.md"] {
        let path = rig.path("other").join(file);
        fs::create_dir_all(path.parent().expect("it has one")).expect("made");
        fs::write(path, "").expect("written");
    }
    let output = depthloom().arg("inspect").arg(rig.path("other")).output().expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    snapshot("data_of_an_unknown_folder", &format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr)));
    let output = depthloom().arg("inspect").arg(rig.path("nowhere")).output().expect("it runs");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_run_is_recognised_as_a_source() {
    let rig = Rig::new();
    let run = rig.path("run");
    succeed(depthloom().args(["run", "--no-page"]).arg(rig.path("own.yaml")).args(["--quiet", "--out"]).arg(&run));
    let output = succeed(depthloom().arg("inspect").arg(&run).arg("--as-source"));
    let printed = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(printed.starts_with("a recording of depthloom, stage look (mcap)\n"), "{printed}");
    check_pasted(&rig, &printed[printed.find("sources:\n").expect("a stanza")..]);
}

/// Exit code and printed text of `depthloom inspect`.
fn data_of(rig: &Rig, arguments: &[&str]) -> (Option<i32>, String) {
    let output = depthloom().arg("inspect").args(arguments).output().expect("it runs");
    (output.status.code(), format!("{}{}", rig.text_of(&output.stdout), rig.text_of(&output.stderr)))
}

#[test]
fn half_a_pair_is_not_a_data_set_and_damaged_bags_are_recognised() {
    let rig = Rig::new();
    let root = rig.path("kitti").display().to_string();
    fs::rename(rig.path("kitti/training/image_3"), rig.path("elsewhere")).expect("renamed");
    let (code, text) = data_of(&rig, &[&root]);
    assert_eq!(code, Some(2));
    snapshot("data_of_half_a_pair", &text);
    // Files with the extensions of bags.
    let bags = rig.path("bags");
    fs::create_dir(&bags).expect("made");
    fs::write(bags.join("drive.mcap"), b"\x89MCAP0\r\n").expect("written");
    fs::write(bags.join("empty.db3"), "").expect("written");
    let (code, text) = data_of(&rig, &[&bags.display().to_string()]);
    assert_eq!(code, Some(2));
    snapshot("data_of_damaged_bags", &text);
    let (code, _) = data_of(&rig, &[&root, "--json"]);
    assert_eq!(code, Some(2));
}

#[test]
fn assumptions_and_contradictions_are_reported_together() {
    let rig = Rig::new();
    fs::remove_dir_all(rig.path("kitti/training/calib_cam_to_cam")).expect("removed");
    for frame in 0..6 {
        for side in ["image_2", "image_3", "disp_noc_0"] {
            let file = rig.path(&format!("kitti/training/{side}/{frame:06}_10.png"));
            // 1242 px wide, as the images whose focal length is known.
            let image = image::open(&file).expect("an image");
            save(image.resize_exact(1242, 144, image::imageops::FilterType::Nearest), &file);
        }
    }
    let pair = ["image_2", "image_3"].map(|side| rig.path(&format!("kitti/training/{side}/000002_10.png")));
    fs::rename(&pair[0], rig.path("x.png")).expect("renamed");
    fs::rename(&pair[1], &pair[0]).expect("renamed");
    fs::rename(rig.path("x.png"), &pair[1]).expect("renamed");
    let (code, text) = data_of(&rig, &[&rig.path("kitti").display().to_string()]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("baseline 0.5327 m (assumed: no file says it)\n"), "{text}");
    assert!(
        text.contains("  warning      no calibration files in training: depthloom uses KITTI's focal lengths"),
        "{text}"
    );
    assert!(
        text.contains("  wrong        ROOT/kitti/training/image_3/000002_10.png: left and right look exchanged"),
        "{text}"
    );
    assert!(text.contains("    help       a point lies further left in the right image"), "{text}");
}

#[test]
fn an_unwritable_sheet_does_not_suppress_the_report() {
    let rig = Rig::new();
    let (root, sheet) = (rig.path("kitti").display().to_string(), rig.path("nowhere/sheet.png").display().to_string());
    let (code, text) = data_of(&rig, &[&root, "--contact-sheet", &sheet]);
    assert_eq!(code, Some(1));
    assert!(text.starts_with("KITTI stereo 2015, training") && text.contains("\nsources:\n"), "{text}");
    assert!(
        text.contains("error: failed to write ROOT/nowhere/sheet.png: ")
            && text.contains("\n  help: name a file with --contact-sheet"),
        "{text}"
    );
    let output = depthloom().args(["inspect", &root, "--json", "--contact-sheet", &sheet]).output().expect("it runs");
    let data: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((output.status.code(), &data["error"]["exit_code"]), (Some(1), &1.into()));
    assert_eq!(data["found"][0]["frames"], 6);
}

#[test]
fn frames_missing_from_a_truncated_recording_are_a_fault() {
    let rig = Rig::new();
    let run = rig.path("run");
    succeed(depthloom().args(["run", "--no-page"]).arg(rig.path("own.yaml")).args(["--quiet", "--out"]).arg(&run));
    let recording = fs::read(run.join("recording.mcap")).expect("read");
    let cut = rig.path("cut.mcap");
    let root = cut.display().to_string();
    fs::write(&cut, &recording[..recording.len() / 2]).expect("written");
    let (code, text) = data_of(&rig, &[&root, "--as-source"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("  wrong        ROOT/cut.mcap is unfinished: its last "), "{text}");
    assert!(
        text.contains(" bytes are not part of a complete frame: frames of the run are missing\n    help       "),
        "{text}"
    );
    let source = format!("sources: {{ own: {{ kind: mcap, with: {{ path: {root:?} }} }} }}\nstages:");
    let (head, rest) = EXPERIMENT.split_once("sources:").expect("it has some");
    let rest = rest.split_once("stages:").expect("it has some").1;
    fs::write(rig.path("own.yaml"), format!("{head}{source}{rest}")).expect("written");
    let output = rig.check(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        rig.text_of(&output.stderr).contains("frames of the run are missing\n  help: "),
        "{}",
        rig.text_of(&output.stderr)
    );

    // Without a complete frame, and without the plan.
    for (bytes, message) in
        [(recording.len() / 40, "has no complete frame of stage `look`: it is unfinished"), (60, "it has no plan")]
    {
        fs::write(&cut, &recording[..bytes]).expect("written");
        let (code, text) = data_of(&rig, &[&root, "--as-source"]);
        assert_eq!(code, Some(2), "{text}");
        assert!(text.contains(message) && text.contains("    help       ") && !text.contains("sources:"), "{text}");
        assert!(text.contains("error: ROOT/cut.mcap: no frame can be read\n"), "{text}");
    }
}
