//! Files of data sets, read by their sources.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::Path;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::{Context, Fault, Registry, Scratch};
use image::ImageFormat;
use serde_json::{Value as Json, json};

use crate::Target;
use crate::files::{grey, image, map};

/// A small data set, one file of which is the stranger's.
struct Set {
    name: &'static str,
    kind: &'static str,
    /// Parameters but `root`.
    with: fn(&Path) -> Json,
    files: Vec<(&'static str, Vec<u8>)>,
    /// The stranger's: its path, and valid contents.
    file: &'static str,
    seeds: Vec<Vec<u8>>,
}

impl Set {
    fn target(self) -> Target {
        let Self { name, kind, with, files, file, seeds } = self;
        Target::new(name, seeds, move |bytes, folder| {
            let is_first = !folder.join(file).exists();
            let write = |file: &str, bytes: &[u8]| {
                let path = folder.join(file);
                fs::create_dir_all(path.parent().expect("it is in the folder")).expect("folders can be made");
                fs::write(path, bytes).expect("the folder takes a file");
            };
            if is_first {
                files.iter().for_each(|(file, bytes)| write(file, bytes));
            }
            write(file, bytes);
            let mut params = with(folder);
            params["root"] = json!(folder);
            read_all(&depthloom_nodes::registry(), kind, &params)
        })
    }
}

/// Opens a source, and takes key and values of its first frames.
pub(crate) fn read_all(registry: &Registry, kind: &str, params: &Json) -> Result<(), String> {
    let report = |fault: Fault| fault.chain();
    let entry = registry.source_kind(kind).expect("it is registered");
    let resolved = entry.resolve(params).map_err(|error| format!("{}: {}", error.path.join("."), error.what))?;
    entry.outputs(&resolved).map_err(report)?;
    let source = entry.open(&resolved).map_err(report)?;
    for position in FrameIndex::all(source.frames().len().min(3)) {
        let key = source.key(position).map_err(report)?;
        let read = source.read(position, &mut Context::new(&InlineHost, &mut Scratch::default())).map_err(report)?;
        assert_eq!(key, read.key, "a key is known before the frame is read");
    }
    Ok(())
}

const CAM_TO_CAM: &str = "calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.95e-02
R_rect_00: 1 0 0 0 1 0 0 0 1
S_rect_02: 1.6e+01 8
P_rect_02: 2.0e+01 0 8 0 0 2.0e+01 4 0 0 0 1 0
S_rect_03: 1.6e+01 8
P_rect_03: 2.0e+01 0 8 -1.0e+01 0 2.0e+01 4 0 0 0 1 0
";
const VELO_TO_CAM: &str = "calib_time: 15-Mar-2012 11:37:16
R: 0 -1 0 0 0 -1 1 0 0
T: -0.004 -0.076 -0.27
delta_f: 0 0
";
const DRIVE: &str = "2011_09_26/2011_09_26_drive_0001_sync";

fn stereo_2015() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("training/image_2/000000_10.png", image(ImageFormat::Png)),
        ("training/image_3/000000_10.png", image(ImageFormat::Png)),
        ("training/disp_noc_0/000000_10.png", map(ImageFormat::Png)),
        ("training/disp_occ_0/000000_10.png", map(ImageFormat::Png)),
        ("training/calib_cam_to_cam/000000.txt", CAM_TO_CAM.into()),
    ]
}

fn raw() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("2011_09_26/calib_cam_to_cam.txt", CAM_TO_CAM.into()),
        ("2011_09_26/calib_velo_to_cam.txt", VELO_TO_CAM.into()),
        ("2011_09_26/2011_09_26_drive_0001_sync/image_02/data/0000000000.png", image(ImageFormat::Png)),
        ("2011_09_26/2011_09_26_drive_0001_sync/image_03/data/0000000000.png", image(ImageFormat::Png)),
        ("2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin", scan()),
        ("split.txt", split().into()),
    ]
}

/// Points ahead, one at the sensor, one behind.
fn scan() -> Vec<u8> {
    let points = [[10.0_f32, 0.5, -1.0, 0.3], [5.0, -1.0, 0.2, 0.0], [0.0; 4], [-3.0, 1.0, 1.0, 1.0]];
    points.iter().flatten().flat_map(|number| number.to_le_bytes()).collect()
}

fn split() -> String {
    format!("{DRIVE} 0 l\n")
}

const OF_A_SCENE: &str = "cam0=[20 0 8; 0 20 4; 0 0 1]
cam1=[20 0 9.5; 0 20 4; 0 0 1]
doffs=1.5
baseline=200
width=16
height=8
ndisp=8
";
const OF_A_DRIVE: &str = "calib_time: 09-Jan-2018
T_103: -0.5 0.0 0.0
P_rect_101: 20 0 8 0 0 20 4 0 0 0 1 0
P_rect_103: 20 0 8 -10 0 20 4 0 0 0 1 0
";
const LIST: &str = "left,right,ground_truth,frame\ncam0/1.png,\"cam1/1.png\",truth.png,first\n";
const KALIBR: &str = "cam0:
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [20.0, 20.0, 8.0, 4.0]
  resolution: [16, 8]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.5]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [20.0, 20.0, 8.0, 4.0]
  resolution: [16, 8]
";

/// A file of the pair that OpenCV rectified: images, and its calibration in all syntaxes.
macro_rules! golden {
    ($file:literal) => {
        include_bytes!(concat!("../../../tests/fixtures/golden/rectify/", $file))
    };
}

/// A scene as Middlebury's of 2014.
fn scene() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("scene/im0.png", image(ImageFormat::Png)),
        ("scene/im1.png", image(ImageFormat::Png)),
        ("scene/calib.txt", OF_A_SCENE.into()),
        ("scene/disp0.pfm", pfm()),
    ]
}

fn driving() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("left-image-half-size/2018-10-19-09-30-39_2018-10-19-09-31-36-438.jpg", image(ImageFormat::Jpeg)),
        ("right-image-half-size/2018-10-19-09-30-39_2018-10-19-09-31-36-438.jpg", image(ImageFormat::Jpeg)),
        ("disparity-map-half-size/2018-10-19-09-30-39_2018-10-19-09-31-36-438.png", map(ImageFormat::Png)),
        ("half-image-calib/2018-10-19-09-30-39.txt", OF_A_DRIVE.into()),
    ]
}

/// The numbers of a map, some unknown.
fn numbers() -> impl Iterator<Item = f32> {
    (0..16 * 8).map(|at| if at % 5 == 0 { f32::INFINITY } else { 1.0 + at as f32 / 16.0 })
}

fn pfm() -> Vec<u8> {
    b"Pf\n16 8\n-1.0\n".iter().copied().chain(numbers().flat_map(f32::to_le_bytes)).collect()
}

fn npy() -> Vec<u8> {
    let header = format!("{:<117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (8, 16), }");
    let magic = b"\x93NUMPY\x01\x00".iter().copied().chain((header.len() as u16).to_le_bytes());
    magic.chain(header.into_bytes()).chain(numbers().flat_map(f32::to_le_bytes)).collect()
}

/// One pair of one's own, truth and calibrations.
fn pair() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("cam0/1.png", image(ImageFormat::Png)),
        ("cam1/1.png", image(ImageFormat::Png)),
        ("truth.png", map(ImageFormat::Png)),
        ("left.yaml", ros(0.0)),
        ("right.yaml", ros(-10.0)),
    ]
}

fn unrectified() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("cam0/1.png", golden!("left.png").to_vec()),
        ("cam1/1.png", golden!("right.png").to_vec()),
        ("extrinsics.yml", golden!("extrinsics.yml").to_vec()),
    ]
}

/// `camera_info` of a camera; `p3` is the fourth number of its projection.
fn ros(p3: f64) -> Vec<u8> {
    let matrix = |name: &str, rows: usize, columns: usize, data: &str| {
        format!("{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{data}]\n")
    };
    let texts = [
        "image_width: 16\nimage_height: 8\ncamera_name: stereo\ndistortion_model: plumb_bob\n".to_owned(),
        matrix("camera_matrix", 3, 3, "20, 0, 8, 0, 20, 4, 0, 0, 1"),
        matrix("distortion_coefficients", 1, 5, "0.01, 0, 0, 0, 0"),
        matrix("rectification_matrix", 3, 3, "1, 0, 0, 0, 1, 0, 0, 0, 1"),
        matrix("projection_matrix", 3, 4, &format!("20, 0, 8, {p3}, 0, 20, 4, 0, 0, 0, 1, 0")),
    ];
    texts.concat().into()
}

fn images(more: &Json) -> Json {
    let mut params = json!({ "calibration": { "focal_px": 20, "baseline_m": 0.5 } });
    params.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
    if params.get("list").is_none() {
        params["left"] = json!("cam0/*.png");
        params["right"] = json!("cam1/*.png");
    }
    params
}

fn with_files(files: &[&str]) -> Json {
    images(&json!({ "calibration": { "files": files } }))
}

fn truth(_: &Path) -> Json {
    images(&json!({ "ground_truth": { "files": "*.png", "unit": "pixels" } }))
}

pub(crate) fn targets() -> Vec<Target> {
    let set = |name, kind, with, files, file, seeds| Set { name, kind, with, files, file, seeds }.target();
    let plain: fn(&Path) -> Json = |_| json!({});
    let drive: fn(&Path) -> Json = |_| json!({ "drives": ["2011_09_26_drive_0001_sync"] });
    let times = "2011_09_26/2011_09_26_drive_0001_sync/image_02/timestamps.txt";
    let pictures = vec![
        image(ImageFormat::Png),
        image(ImageFormat::Jpeg),
        image(ImageFormat::WebP),
        image(ImageFormat::Tiff),
        image(ImageFormat::Pnm),
        grey(ImageFormat::Png),
        map(ImageFormat::Tiff),
    ];
    let maps = vec![map(ImageFormat::Png), map(ImageFormat::Tiff)];
    vec![
        set("image", "kitti/stereo2015", plain, stereo_2015(), "training/image_2/000000_10.png", pictures),
        set("map", "kitti/stereo2015", plain, stereo_2015(), "training/disp_noc_0/000000_10.png", maps),
        set(
            "kitti_calibration",
            "kitti/stereo2015",
            plain,
            stereo_2015(),
            "training/calib_cam_to_cam/000000.txt",
            vec![CAM_TO_CAM.into()],
        ),
        set(
            "kitti_velodyne_calibration",
            "kitti/raw",
            drive,
            raw(),
            "2011_09_26/calib_velo_to_cam.txt",
            vec![VELO_TO_CAM.into()],
        ),
        set(
            "kitti_scan",
            "kitti/raw",
            drive,
            raw(),
            "2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin",
            vec![scan()],
        ),
        set("kitti_times", "kitti/raw", drive, raw(), times, vec![b"2011-09-26 13:02:25.964389445\n".to_vec()]),
        set(
            "kitti_split",
            "kitti/raw",
            |folder| json!({ "split": folder.join("split.txt") }),
            raw(),
            "split.txt",
            vec![split().into()],
        ),
        set("float_map", "middlebury", plain, scene(), "scene/disp0.pfm", vec![pfm(), npy()]),
        set("middlebury_calibration", "middlebury", plain, scene(), "scene/calib.txt", vec![OF_A_SCENE.into()]),
        set(
            "drivingstereo_calibration",
            "drivingstereo",
            plain,
            driving(),
            "half-image-calib/2018-10-19-09-30-39.txt",
            vec![OF_A_DRIVE.into()],
        ),
        set("images_list", "images", |_| images(&json!({ "list": "list.csv" })), pair(), "list.csv", vec![LIST.into()]),
        set("images_truth", "images", truth, pair(), "truth.png", vec![map(ImageFormat::Png), npy(), pfm()]),
        set("ros_camera", "images", |_| with_files(&["left.yaml", "right.yaml"]), pair(), "left.yaml", vec![ros(0.0)]),
        set(
            "kalibr_cameras",
            "images",
            |_| with_files(&["camchain.yaml"]),
            pair(),
            "camchain.yaml",
            vec![KALIBR.into()],
        ),
        set(
            "opencv_yaml",
            "images",
            |_| with_files(&["intrinsics.yml", "extrinsics.yml"]),
            unrectified(),
            "intrinsics.yml",
            vec![golden!("intrinsics.yml").to_vec()],
        ),
        set(
            "opencv_xml",
            "images",
            |_| with_files(&["stereo.xml"]),
            unrectified(),
            "stereo.xml",
            vec![golden!("stereo.xml").to_vec()],
        ),
        set(
            "opencv_json",
            "images",
            |_| with_files(&["stereo.json"]),
            unrectified(),
            "stereo.json",
            vec![golden!("stereo.json").to_vec()],
        ),
    ]
}
