//! `kitti/stereo2015`: the KITTI stereo 2015 benchmark, as unpacked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{DataPath, Frame, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::values::{Mask, Pixels, TrueDisparity};
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use crate::sources::dataset::{
    CALIBRATION, Files, Gathered, LEFT, Layout, Listing, Part, RIGHT, at_file, no_file, survey,
};
use crate::sources::evaluation::Evaluation;
use crate::sources::files::image_file;
use crate::sources::kitti::calibration;
use crate::sources::kitti::stems::{Stems, number, unread_files};
use crate::sources::true_disparity;

const KIND: &str = "kitti/stereo2015";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds `training` (with truth) or `testing` (without), each with image_2 (left) and image_3 (right) of 000000_10.png ...; \
    in training also disp_noc_0 or disp_occ_0, unless `truth: none`";

const NOC: Part = "disp_noc_0";
const OCC: Part = "disp_occ_0";
const OBJECTS: Part = "obj_map";
const EVALUATION: [Part; 3] = [NOC, OCC, OBJECTS];

const CALIBRATIONS: &str = "calib_cam_to_cam";

/// Which half of the benchmark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Split {
    /// Frames with truth.
    #[default]
    Training,
    /// Frames without truth.
    Testing,
}

impl Split {
    pub(crate) const fn folder(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Testing => "testing",
        }
    }
}

/// Which true pixels of a training frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KittiTruth {
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
pub(crate) struct KittiStereo2015Params {
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

pub(crate) struct KittiStereo2015 {
    folder: PathBuf,
    truth: Option<Part>,
    evaluation: Vec<Part>,
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
            ]
            .into_iter()
            .chain(Evaluation::asked())
            .chain([Port::frame("obj_map", ValueType::Mask, "255 on objects (`obj_map`); with `disparities: true`.")
                .optional()])
            .collect(),
        }
    }

    fn check(params: &KittiStereo2015Params) -> Result<(), (&'static str, String)> {
        match params.root.path().as_os_str().is_empty() {
            true => Err(("root", format!("root is missing: {LAYOUT}"))),
            false => Ok(()),
        }
    }

    fn open(params: KittiStereo2015Params) -> Result<Box<dyn Source>, Fault> {
        let (listing, layout) = Self::listed(&params)?;
        listing.open(layout)
    }

    fn survey(params: KittiStereo2015Params) -> Survey {
        survey(Self::listed(&params))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        halves(root, "KITTI stereo 2015", [NOC, OCC], |half| {
            let pair = half.join("image_2").is_dir() && half.join("image_3").is_dir();
            pair.then(|| json!({}))
        })
    }
}

/// `params` returns the parameters of an existing half, except root, split and truth. `root` may be a half.
pub(crate) fn halves(
    root: &Path,
    name: &str,
    [noc, occ]: [Part; 2],
    params: impl Fn(&Path) -> Option<Json>,
) -> Vec<Recognised> {
    let is_half = |split: Split| root.ends_with(split.folder()) && params(root).is_some();
    let root = if is_half(Split::Training) || is_half(Split::Testing) { root.parent().unwrap_or(root) } else { root };
    let one = |split: Split| {
        let half = root.join(split.folder());
        let mut params = params(&half)?;
        let truth = match split {
            Split::Testing => None,
            Split::Training if half.join(noc).is_dir() => Some("noc"),
            Split::Training if half.join(occ).is_dir() => Some("occ"),
            Split::Training => Some("none"),
        };
        params["root"] = json!(root);
        params["split"] = json!(split.folder());
        if let Some(truth) = truth {
            params["truth"] = json!(truth);
        }
        Some(Recognised::new(format!("{name}, {}", split.folder()), params))
    };
    [Split::Training, Split::Testing].into_iter().filter_map(one).collect()
}

impl KittiStereo2015 {
    fn listed(params: &KittiStereo2015Params) -> Result<(Listing, Self), Fault> {
        let root = params.root.path();
        if !root.is_dir() {
            return Err(Fault::new(format!("there is no folder {}", root.display())).remedy(LAYOUT));
        }
        let folder = root.join(params.split.folder());
        let listed = Stems::of(&folder, "image_2", LAYOUT)?;
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
        let given = params.disparities && params.split == Split::Training;
        let evaluation = EVALUATION.into_iter().filter(|name| given && folder.join(name).is_dir()).collect();
        let layout = Self { truth, evaluation, folder };
        let mut listing = Listing::default();
        let unread = layout.list(&frames, &listed, &mut listing)?;
        listing.warnings.extend(params.frames.left_out(&known));
        listing.warnings.extend(unread_files(&unread));
        Ok((listing, layout))
    }

    fn list(&self, frames: &[Frame], lefts: &Stems, listing: &mut Listing) -> Result<Vec<String>, Fault> {
        let mut unread = lefts.others.clone();
        let mut companions = vec![(
            RIGHT,
            Stems::of(&self.folder, "image_3", LAYOUT)?,
            "each left image needs its right one, of the same name (KITTI: unpack data_scene_flow.zip again)",
        )];
        if let Some(truth) = self.truth {
            let folder = self.folder.join(truth);
            let remedy = "without truth, or with another, say so: `truth: noc`, `occ` or `none` (KITTI: unpack data_scene_flow.zip again)";
            if !folder.is_dir() {
                return Err(Fault::new(format!("there is no folder {}", folder.display())).remedy(remedy));
            }
            companions.push((truth, Stems::of(&self.folder, truth, LAYOUT)?, remedy));
        }
        for name in self.evaluation.iter().copied().filter(|name| Some(*name) != self.truth) {
            let remedy = "each frame needs its files, or the whole folder away: what is not there is not given";
            companions.push((name, Stems::of(&self.folder, name, LAYOUT)?, remedy));
        }
        unread.extend(companions.iter().flat_map(|(_, stems, _)| stems.without(lefts)));
        let has_calibration = self.folder.join(CALIBRATIONS).is_dir();
        for frame in frames {
            listing.gather(frame.clone(), self.files(frame, &companions, has_calibration));
        }
        Ok(unread)
    }

    fn files(&self, frame: &Frame, companions: &[(Part, Stems, &'static str)], has_calibration: bool) -> Gathered {
        let path = |folder: &str| self.folder.join(folder).join(format!("{}.png", frame.id));
        let mut files = Gathered::default();
        files.take(LEFT, Ok(path("image_2")));
        for (part, stems, remedy) in companions {
            let path = path(stems.folder);
            let is_there = stems.stems.contains(&*frame.id);
            files.take(part, if is_there { Ok(path) } else { Err(no_file(&path, remedy)) });
        }
        if has_calibration {
            let path = self.folder.join(CALIBRATIONS).join(format!("{:06}.txt", frame.index));
            let remedy = "each frame needs its calibration, 000150.txt for 000150_10.png (KITTI: unpack data_scene_flow_calib.zip again); \
                without the whole folder calib_cam_to_cam KITTI's own goes by the image's width";
            files.take(CALIBRATION, if path.is_file() { Ok(path) } else { Err(no_file(&path, remedy)) });
        }
        files
    }
}

impl Layout for KittiStereo2015 {
    const KIND: (&'static str, u32) = (KIND, VERSION);

    /// Unlike other kinds, so that keys of older recordings stay valid.
    fn key(&self, files: &Files) -> Key {
        let bytes = |part: Part| files.get(part).map(|file| &*file.bytes);
        let mut key = Key::build(KIND).number(VERSION.into());
        for part in [LEFT, RIGHT] {
            key = key.bytes(bytes(part).unwrap_or_default());
        }
        for (name, bytes) in [("calibration", bytes(CALIBRATION)), ("truth", self.truth.and_then(bytes))] {
            if let Some(bytes) = bytes {
                key = key.text(name).bytes(bytes);
            }
        }
        // A frame that gives more is another, though the same files were read.
        if !self.evaluation.is_empty() {
            key = key.text("disparities");
        }
        for part in self.evaluation.iter().filter(|part| Some(**part) != self.truth) {
            key = key.text(part).bytes(bytes(part).unwrap_or_default());
        }
        key.finish()
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let calibration = match files.get(CALIBRATION) {
            Some(file) => calibration::from_text(&file.path, &file.text(), size)?,
            None => {
                let left = files.the(LEFT)?;
                let assumed = calibration::by_width(size).map_err(|fault| at_file(&left.path, fault))?;
                ctx.host.warn(&calibration::assumption(&self.folder));
                assumed
            }
        };
        let map =
            |part| Ok::<_, Fault>(files.map_u16(part, "disparity", size)?.as_ref().map(TrueDisparity::from_px_256));
        let maps = Evaluation { noc: map(NOC)?, occ: map(OCC)?, objects: objects(files, size)? };
        let truth = if self.truth == Some(OCC) { maps.occ.as_ref() } else { maps.noc.as_ref() };
        let mut outputs = Outputs::one("left", left).with("right", right);
        if let (Some(truth), Some(_)) = (truth, self.truth) {
            outputs = outputs.with("depth", true_disparity::depth(truth, &calibration));
        }
        if !self.evaluation.is_empty() {
            outputs = maps.outputs(outputs);
        }
        Ok(outputs.with("calibration", calibration))
    }
}

fn objects(files: &Files, size: (u32, u32)) -> Result<Option<Mask>, Fault> {
    let Some(file) = files.get(OBJECTS) else { return Ok(None) };
    let image = image_file::image(&file.path, Arc::clone(&file.bytes))?;
    files.same_size_as_left(size, file, image.dimensions())?;
    let Pixels::Grey(numbers) = image.pixels() else {
        let what = format!("{} is a colour image: KITTI's object maps have one channel", file.path.display());
        return Err(Fault::new(what).remedy("write the objects' numbers as 8-bit grey, 0 = background"));
    };
    let mut set = numbers.clone();
    set.iter_mut().for_each(|number| *number = if *number > 0 { 255 } else { 0 });
    Ok(Some(Mask { set }))
}
