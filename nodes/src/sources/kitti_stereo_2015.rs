//! `kitti/stereo2015`: the KITTI stereo 2015 benchmark, as unpacked.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{DataPath, Frame, FrameSelection, SourceDeclaration};
use depthloom_graphs::values::{Calibration, Depth, Mask, Pixels, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use depthloom_kernels::depth::truth_from_disparity_png;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::asked::Asked;
use super::kitti_stems::{Stems, number, unread_files};
use super::{image_file, kitti_calibration};
use crate::shape::filled;

const KIND: &str = "kitti/stereo2015";
const VERSION: u32 = 1;
pub(super) const LAYOUT: &str = "root holds `training` (with truth) or `testing` (without), each with image_2 (left) and image_3 (right) of 000000_10.png ...; \
    in training also disp_noc_0 or disp_occ_0, unless `truth: none`";

/// True disparities that both cameras see, and all.
const NOC: &str = "disp_noc_0";
const OCC: &str = "disp_occ_0";
/// The folder of object maps.
const OBJECTS: &str = "obj_map";
/// The folders of what `score/disparity` takes.
const EVALUATION: [&str; 3] = [NOC, OCC, OBJECTS];

/// The folder of calibration files.
const CALIBRATION: &str = "calib_cam_to_cam";

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
    /// Its folder.
    pub const fn folder(self) -> &'static str {
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
            Self::Noc => Some(NOC),
            Self::Occ => Some(OCC),
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
    /// Whether the truth of training frames is given as disparities too (`disp_noc`, `disp_occ`, `occluded`), with the map of objects
    /// (`obj_map`), as far as their folders are there: for `score/disparity`.
    pub disparities: bool,
    /// Which frames, by KITTI's number: `1..=40`, `0..48`, `[3, 7]` or a file of ids, in the order asked for, each once. All of them
    /// must be there; `1..=40 available` takes those that are. By default (`available`) all there are.
    pub frames: FrameSelection,
}

/// The kind `kitti/stereo2015`.
pub struct KittiStereo2015 {
    folder: PathBuf,
    truth: Option<&'static str>,
    /// The folders of what `score/disparity` takes.
    evaluation: Vec<&'static str>,
    has_calibration: bool,
    frames: Vec<Frame>,
    warnings: Vec<String>,
    /// A run asks for a frame's key and reads it at once: its files are read and hashed once.
    asked: Asked<(FrameFiles, Key)>,
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
`f * B / (v / 256)` of the 16-bit disparity `v`, NaN where `v` is 0; with `disparities: true` the disparities are given too, and where `obj_map` \
is there, the objects.\n\n\
With calibration files `f = P_rect_02[0,0]` and `B` is the distance of both projections' centres. Without them the focal length goes by the image's \
width (1242: 721.5377 px, 1241: 718.856, 1238: 718.3351, 1226: 707.0912, 1224: 707.0493) and `B = 0.532725` m, and a run says so.\n\n\
Pairs of one's own, rectified, take the same layout: frame 150 is `training/image_2/000150_10.png` and `training/image_3/000150_10.png`, 8-bit PNG, and \
`training/calib_cam_to_cam/000150.txt` with two lines, `P_rect_02: f 0 cx 0 0 f cy 0 0 0 1 0` and `P_rect_03: f 0 cx -f*B 0 f cy 0 0 0 1 0` (px; the \
baseline `B` in metres). Truth is optional: 16-bit grey PNG of disparity * 256, 0 = unknown, in `disp_noc_0` or `disp_occ_0`; without any, `truth: none`.",
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
                Port::frame(
                    "disp_noc",
                    ValueType::TrueDisparity,
                    "True disparity where both cameras see it (`disp_noc_0`), 1/256 px, 0 = unknown; with `disparities: true`.",
                )
                .optional(),
                Port::frame(
                    "disp_occ",
                    ValueType::TrueDisparity,
                    "True disparity of all true pixels (`disp_occ_0`), likewise; with `disparities: true`.",
                )
                .optional(),
                Port::frame(
                    "occluded",
                    ValueType::Mask,
                    "255 where `disp_occ_0` knows a disparity and `disp_noc_0` does not; with `disparities: true`.",
                )
                .optional(),
                Port::frame("obj_map", ValueType::Mask, "255 on objects (`obj_map`); with `disparities: true`.").optional(),
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
        let listed = Stems::of(&folder, "image_2")?;
        let lefts = &listed.stems;
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
        let has_calibration = folder.join(CALIBRATION).is_dir();
        let given = params.disparities && params.split == Split::Training;
        let evaluation = EVALUATION.into_iter().filter(|name| given && folder.join(name).is_dir()).collect();
        let warnings = params.frames.left_out(&known).into_iter().collect();
        let asked = Asked::default();
        let mut source = Self { truth, evaluation, has_calibration, frames, folder, warnings, asked };
        let unread = source.check_companions(&listed)?;
        source.warnings.extend(unread_files(&unread));
        Ok(Box::new(source))
    }
}

impl KittiStereo2015 {
    /// That every chosen frame has all of its files; gives the files that belong to no frame.
    fn check_companions(&self, lefts: &Stems) -> Result<Vec<String>, Fault> {
        let mut unread = lefts.others.clone();
        let rights = Stems::of(&self.folder, "image_3")?;
        let remedy = "each left image needs its right one, of the same name (KITTI: unpack data_scene_flow.zip again)";
        self.check_stems("image_3", &rights.stems, remedy)?;
        unread.extend(rights.without(lefts));
        if let Some(truth) = self.truth {
            let folder = self.folder.join(truth);
            let remedy = "without truth, or with another, say so: `truth: noc`, `occ` or `none` (KITTI: unpack data_scene_flow.zip again)";
            if !folder.is_dir() {
                return Err(Fault::new(format!("there is no folder {}", folder.display())).remedy(remedy));
            }
            let truths = Stems::of(&self.folder, truth)?;
            self.check_stems(truth, &truths.stems, remedy)?;
            unread.extend(truths.without(lefts));
        }
        for name in self.evaluation.iter().copied().filter(|name| Some(*name) != self.truth) {
            let remedy = "each frame needs its files, or the whole folder away: what is not there is not given";
            let maps = Stems::of(&self.folder, name)?;
            self.check_stems(name, &maps.stems, remedy)?;
            unread.extend(maps.without(lefts));
        }
        if self.has_calibration
            && let Some(missing) =
                self.frames.iter().map(|frame| self.calibration_path(frame)).find(|path| !path.is_file())
        {
            return Err(Fault::new(format!("there is no file {}", missing.display())).remedy(
                "each frame needs its calibration, 000150.txt for 000150_10.png (KITTI: unpack data_scene_flow_calib.zip again); without the \
                 whole folder calib_cam_to_cam KITTI's own goes by the image's width",
            ));
        }
        Ok(unread)
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
        self.folder.join(CALIBRATION).join(format!("{:06}.txt", frame.index))
    }
}

/// The files of a frame, whole and not decoded.
struct FrameFiles {
    left: (PathBuf, Arc<[u8]>),
    right: (PathBuf, Arc<[u8]>),
    calibration: Option<(PathBuf, Arc<[u8]>)>,
    truth: Option<(PathBuf, Arc<[u8]>)>,
    /// What `score/disparity` takes, by folder; without the truth's own, which is there already.
    evaluation: Vec<(&'static str, PathBuf, Arc<[u8]>)>,
    /// Whether disparities are given: a frame that gives more is another, though the same files were read.
    gives_disparities: bool,
}

impl FrameFiles {
    fn key(&self) -> Key {
        let mut key = Key::build(KIND).number(VERSION.into()).bytes(&self.left.1).bytes(&self.right.1);
        for (name, file) in [("calibration", &self.calibration), ("truth", &self.truth)] {
            if let Some((_, bytes)) = file {
                key = key.text(name).bytes(bytes);
            }
        }
        if self.gives_disparities {
            key = key.text("disparities");
        }
        for (folder, _, bytes) in &self.evaluation {
            key = key.text(folder).bytes(bytes);
        }
        key.finish()
    }
}

impl KittiStereo2015 {
    /// The files of a frame, and their key.
    fn files(&self, position: usize) -> Result<(FrameFiles, Key), Fault> {
        let frame = &self.frames[position];
        let read = |path: PathBuf| image_file::read(&path).map(|bytes| (path, bytes));
        let files = FrameFiles {
            left: read(self.image_path("image_2", frame))?,
            right: read(self.image_path("image_3", frame))?,
            calibration: self.has_calibration.then(|| read(self.calibration_path(frame))).transpose()?,
            truth: self.truth.map(|folder| read(self.image_path(folder, frame))).transpose()?,
            evaluation: self
                .evaluation
                .iter()
                .filter(|folder| Some(**folder) != self.truth)
                .map(|folder| read(self.image_path(folder, frame)).map(|(path, bytes)| (*folder, path, bytes)))
                .collect::<Result<_, _>>()?,
            gives_disparities: !self.evaluation.is_empty(),
        };
        let key = files.key();
        Ok((files, key))
    }
}

impl Source for KittiStereo2015 {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: usize) -> Result<Key, Fault> {
        let (files, key) = self.files(position)?;
        self.asked.keep(position, (files, key));
        Ok(key)
    }

    fn read(&self, position: usize, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let (files, key) = self.asked.take(position).map_or_else(|| self.files(position), Ok)?;
        let ((left_path, left), (right_path, right)) = (files.left, files.right);
        let left = image_file::image(&left_path, left)?;
        let right = image_file::image(&right_path, right)?;
        let size = left.dimensions();
        same_size_as_left((&left_path, size), (&right_path, right.dimensions()))?;

        let calibration = match files.calibration {
            Some((path, bytes)) => kitti_calibration::from_text(&path, &String::from_utf8_lossy(&bytes), size)?,
            None => {
                let assumed = kitti_calibration::by_width(size).map_err(|fault| at_file(&left_path, fault))?;
                ctx.host.warn(&kitti_calibration::assumption(&self.folder, &assumed));
                assumed
            }
        };
        let mut outputs = Outputs::one("left", left).with("right", right);
        let mut maps = Evaluation::default();
        if let (Some((path, bytes)), Some(folder)) = (files.truth, self.truth) {
            let raw = disparities(&path, &bytes, (&left_path, size))?;
            outputs = outputs.with("depth", true_depth(&raw, &calibration));
            if self.evaluation.contains(&folder) {
                maps.take(folder, raw);
            }
        }
        for (folder, path, bytes) in files.evaluation {
            match folder {
                OBJECTS => maps.objects = Some(objects(&path, bytes, (&left_path, size))?),
                _ => maps.take(folder, disparities(&path, &bytes, (&left_path, size))?),
            }
        }
        outputs = maps.outputs(outputs);
        Ok(SourceOutputs { outputs: outputs.with("calibration", calibration), key })
    }
}

fn disparities(path: &Path, bytes: &[u8], left: (&Path, (u32, u32))) -> Result<Raster<u16>, Fault> {
    let raw = image_file::map_u16(path, bytes, "disparity")?;
    same_size_as_left(left, (path, raw.dimensions()))?;
    Ok(raw)
}

fn true_depth(raw: &Raster<u16>, calibration: &Calibration) -> Depth {
    let metres = filled(raw.dimensions(), |out| {
        truth_from_disparity_png(raw, calibration.focal_px, calibration.baseline_m, out);
    });
    Depth { metres }
}

/// Set where the map has an object, of whatever number.
fn objects(path: &Path, bytes: Arc<[u8]>, left: (&Path, (u32, u32))) -> Result<Mask, Fault> {
    let image = image_file::image(path, bytes)?;
    same_size_as_left(left, (path, image.dimensions()))?;
    let Pixels::Grey(numbers) = image.pixels() else {
        let what = format!("{} is a colour image: KITTI's object maps have one channel", path.display());
        return Err(Fault::new(what).remedy("write the objects' numbers as 8-bit grey, 0 = background"));
    };
    let mut set = numbers.clone();
    set.iter_mut().for_each(|number| *number = if *number > 0 { 255 } else { 0 });
    Ok(Mask { set })
}

/// What `score/disparity` takes of a frame, as far as it is there.
#[derive(Default)]
struct Evaluation {
    noc: Option<Raster<u16>>,
    occ: Option<Raster<u16>>,
    objects: Option<Mask>,
}

impl Evaluation {
    fn take(&mut self, folder: &str, raw: Raster<u16>) {
        *if folder == NOC { &mut self.noc } else { &mut self.occ } = Some(raw);
    }

    fn outputs(self, mut outputs: Outputs) -> Outputs {
        if let (Some(noc), Some(occ)) = (&self.noc, &self.occ) {
            let hidden = occ.iter().zip(noc.iter()).map(|(&occ, &noc)| if occ > 0 && noc == 0 { 255 } else { 0 });
            let set = Raster::from_raw(occ.width(), occ.height(), hidden.collect());
            outputs = outputs.with("occluded", Mask { set: set.expect("both maps are of the left image's size") });
        }
        for (port, raw) in [("disp_noc", self.noc), ("disp_occ", self.occ)] {
            if let Some(px_256) = raw {
                outputs = outputs.with(port, TrueDisparity { px_256 });
            }
        }
        match self.objects {
            Some(objects) => outputs.with("obj_map", objects),
            None => outputs,
        }
    }
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
    .remedy("the files of a frame belong together: make or unpack the frame's again"))
}

fn at_file(path: &Path, fault: Fault) -> Fault {
    match fault {
        Fault::Failed { what, remedy, source } => {
            Fault::Failed { what: format!("{}: {what}", path.display()), remedy, source }
        }
        Fault::Cancelled => Fault::Cancelled,
    }
}
