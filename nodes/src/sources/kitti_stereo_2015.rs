//! `kitti/stereo2015`: the KITTI stereo 2015 benchmark, as unpacked.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, Frame, FrameSelection, SourceDeclaration};
use depthloom_graphs::values::{Calibration, Depth};
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use depthloom_kernels::depth::truth_from_disparity_png;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{kitti_calibration, png};
use crate::shape::filled;

const KIND: &str = "kitti/stereo2015";
const VERSION: u32 = 1;
const LAYOUT: &str = "root holds `training` and `testing` as KITTI unpacks them: image_2 and image_3 with 000000_10.png ..., disp_noc_0 and disp_occ_0 in training";

/// Which half of the benchmark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Frames with truth.
    #[default]
    Training,
    /// Frames without truth.
    Testing,
}

impl Split {
    const fn folder(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Testing => "testing",
        }
    }
}

/// Which true pixels of a training frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum KittiTruth {
    /// Those that the right camera sees too: `disp_noc_0`.
    #[default]
    Noc,
    /// All of them: `disp_occ_0`.
    Occ,
    /// None: truth is not read, even where there is some.
    None,
}

impl KittiTruth {
    const fn folder(self) -> Option<&'static str> {
        match self {
            Self::Noc => Some("disp_noc_0"),
            Self::Occ => Some("disp_occ_0"),
            Self::None => None,
        }
    }
}

/// Parameters of `kitti/stereo2015`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct KittiStereo2015Params {
    /// The folder that holds `training` and `testing`.
    pub root: DataPath,
    /// Which half: `training` or `testing`.
    pub split: Split,
    /// Which true pixels: `noc` (seen by both cameras), `occ` (all) or `none`. Testing frames have none.
    pub truth: KittiTruth,
    /// Which frames, by KITTI's number: `1..=40`, `0..48`, `[3, 7]` or a file of ids, in the order asked for, each once. All of them
    /// must be there; `1..=40 available` takes those that are. By default (`available`) all there are.
    pub frames: FrameSelection,
}

/// The kind `kitti/stereo2015`.
pub struct KittiStereo2015 {
    folder: PathBuf,
    truth: Option<&'static str>,
    has_calibration: bool,
    frames: Vec<Frame>,
}

impl SourceKind for KittiStereo2015 {
    type Params = KittiStereo2015Params;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "KITTI stereo 2015: rectified colour pairs with sparse laser truth.",
            doc: "\
Layout (Menze and Geiger, *Object Scene Flow for Autonomous Vehicles*, 2015): `<root>/training` and `<root>/testing` with `image_2` (left), `image_3` \
(right), names `%06d_10.png`; `disp_noc_0` and `disp_occ_0` in `training`; optionally `calib_cam_to_cam/%06d.txt`. The second time step, `_11`, is not \
read.\n\n\
A frame's id is its file's stem (`000150_10`), its index the number (150). Images keep their own PNG bytes. Truth is depth: \
`f * B / (v / 256)` of the 16-bit disparity `v`, NaN where `v` is 0.\n\n\
With calibration files `f = P_rect_02[0,0]` and `B` is the distance of both projections' centres. Without them the focal length goes by the image's \
width (1242: 721.5377 px, 1241: 718.856, 1238: 718.3351, 1226: 707.0912, 1224: 707.0493) and `B = 0.532725` m.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left colour image, 8 bit, with its PNG bytes."),
                Port::frame("right", ValueType::Image, "Right colour image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline."),
                Port::frame(
                    "depth",
                    ValueType::Depth,
                    "Sparse true depth, metres, NaN = unknown; absent in `testing`.",
                )
                .optional(),
            ],
        }
    }

    fn check(params: &KittiStereo2015Params) -> Result<(), (&'static str, String)> {
        match params.root.path().as_os_str().is_empty() {
            true => Err(("root", format!("root is missing: {LAYOUT}"))),
            false => Ok(()),
        }
    }

    fn open(params: KittiStereo2015Params) -> Result<Box<dyn Source>, Fault> {
        let root = params.root.path();
        if !root.is_dir() {
            return Err(Fault::new(format!("there is no folder {}", root.display())).remedy(LAYOUT));
        }
        let folder = root.join(params.split.folder());
        let lefts = stems(&folder.join("image_2"))?;
        let known: Vec<(u64, &str)> = lefts.iter().map(|stem| (number(stem), stem.as_str())).collect();
        if known.is_empty() {
            let empty = folder.join("image_2");
            return Err(
                Fault::new(format!("{} holds no image named like 000000_10.png", empty.display())).remedy(LAYOUT)
            );
        }
        let chosen = params.frames.select(&known)?;
        let frames: Vec<Frame> = chosen.iter().map(|&i| Frame::at_10_hz(known[i].1, known[i].0)).collect();

        let truth = match params.split {
            Split::Training => params.truth.folder(),
            Split::Testing => None,
        };
        let calibration = folder.join("calib_cam_to_cam");
        let source = Self { truth, has_calibration: calibration.is_dir(), frames, folder };
        source.check_companions()?;
        Ok(Box::new(source))
    }
}

impl KittiStereo2015 {
    /// That every chosen frame has all of its files.
    fn check_companions(&self) -> Result<(), Fault> {
        let rights = stems(&self.folder.join("image_3"))?;
        self.check_stems("image_3", &rights, "each left image needs its right one: unpack data_scene_flow.zip again")?;
        if let Some(truth) = self.truth {
            let folder = self.folder.join(truth);
            let remedy = "unpack data_scene_flow.zip again, or choose another `truth`: noc, occ or none";
            if !folder.is_dir() {
                return Err(Fault::new(format!("there is no folder {}", folder.display())).remedy(remedy));
            }
            self.check_stems(truth, &stems(&folder)?, remedy)?;
        }
        if self.has_calibration
            && let Some(missing) =
                self.frames.iter().map(|frame| self.calibration_path(frame)).find(|path| !path.is_file())
        {
            return Err(Fault::new(format!("there is no file {}", missing.display()))
                .remedy("unpack data_scene_flow_calib.zip again, or remove the whole folder calib_cam_to_cam: the focal length then goes by the image's width"));
        }
        Ok(())
    }

    fn check_stems(&self, folder: &str, present: &BTreeSet<String>, remedy: &str) -> Result<(), Fault> {
        match self.frames.iter().find(|frame| !present.contains(&*frame.id)) {
            Some(frame) => {
                let path = self.image_path(folder, frame);
                Err(Fault::new(format!("there is no file {}", path.display())).remedy(remedy))
            }
            None => Ok(()),
        }
    }

    fn image_path(&self, folder: &str, frame: &Frame) -> PathBuf {
        self.folder.join(folder).join(format!("{}.png", frame.id))
    }

    fn calibration_path(&self, frame: &Frame) -> PathBuf {
        self.folder.join("calib_cam_to_cam").join(format!("{:06}.txt", frame.index))
    }
}

impl Source for KittiStereo2015 {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn read(&self, position: usize, _ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let frame = &self.frames[position];
        let (left_path, right_path) = (self.image_path("image_2", frame), self.image_path("image_3", frame));
        let (left_bytes, right_bytes) = (png::read(&left_path)?, png::read(&right_path)?);
        let mut key = Key::build(KIND).number(VERSION.into()).bytes(&left_bytes).bytes(&right_bytes);

        let left = png::image(&left_path, left_bytes)?;
        let right = png::image(&right_path, right_bytes)?;
        let size = left.dimensions();
        same_size_as_left((&left_path, size), (&right_path, right.dimensions()))?;

        let calibration = if self.has_calibration {
            let path = self.calibration_path(frame);
            let bytes = png::read(&path)?;
            key = key.text("calibration").bytes(&bytes);
            kitti_calibration::from_text(&path, &String::from_utf8_lossy(&bytes), size)?
        } else {
            kitti_calibration::by_width(size).map_err(|fault| at_file(&left_path, fault))?
        };
        let mut outputs = Outputs::one("left", left).with("right", right);
        if let Some(folder) = self.truth {
            let path = self.image_path(folder, frame);
            let bytes = png::read(&path)?;
            key = key.text("truth").bytes(&bytes);
            outputs = outputs.with("depth", true_depth(&path, &bytes, (&left_path, size), &calibration)?);
        }
        Ok(SourceOutputs { outputs: outputs.with("calibration", calibration), key: key.finish() })
    }
}

fn true_depth(path: &Path, bytes: &[u8], left: (&Path, (u32, u32)), calibration: &Calibration) -> Result<Depth, Fault> {
    let raw = png::map_u16(path, bytes)?;
    same_size_as_left(left, (path, raw.dimensions()))?;
    let metres = filled(raw.dimensions(), |out| {
        truth_from_disparity_png(&raw, calibration.focal_px, calibration.baseline_m, out);
    });
    Ok(Depth { metres })
}

fn same_size_as_left(left: (&Path, (u32, u32)), other: (&Path, (u32, u32))) -> Result<(), Fault> {
    if left.1 == other.1 {
        return Ok(());
    }
    let ((left, (lw, lh)), (other, (w, h))) = (left, other);
    Err(Fault::new(format!(
        "{} is {w}x{h}, and {} is {lw}x{lh}: they must be of one size",
        other.display(),
        left.display()
    ))
    .remedy("the files of a frame belong together: unpack the frame again"))
}

fn at_file(path: &Path, fault: Fault) -> Fault {
    match fault {
        Fault::Failed { what, remedy, source } => {
            Fault::Failed { what: format!("{}: {what}", path.display()), remedy, source }
        }
        Fault::Cancelled => Fault::Cancelled,
    }
}

/// The stems of the first time step's images in a folder, in order.
fn stems(folder: &Path) -> Result<BTreeSet<String>, Fault> {
    let listing = std::fs::read_dir(folder).map_err(|error| match error.kind() {
        ErrorKind::NotFound => Fault::new(format!("there is no folder {}", folder.display())).remedy(LAYOUT),
        _ => Fault::new(format!("failed to list {}", folder.display())).because(error),
    })?;
    let mut stems = BTreeSet::new();
    for entry in listing {
        let entry = entry.map_err(|error| Fault::new(format!("failed to list {}", folder.display())).because(error))?;
        let name = entry.file_name();
        if let Some(stem) = name.to_str().and_then(|name| name.strip_suffix(".png"))
            && let Some(digits) = stem.strip_suffix("_10")
            && digits.len() == 6
            && digits.bytes().all(|byte| byte.is_ascii_digit())
        {
            stems.insert(stem.to_owned());
        }
    }
    Ok(stems)
}

/// The number in `000150_10`.
fn number(stem: &str) -> u64 {
    stem[..6].parse().expect("stems() takes six digits only")
}
