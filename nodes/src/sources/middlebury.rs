//! `middlebury`: the stereo data sets of Middlebury College, of every year, as unpacked.

pub(crate) mod scene;

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{DataPath, FrameSelection, Recognised, SourceDeclaration, SwitchedOff};
use depthloom_graphs::values::{Calibration, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Outputs, Port, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bounds::above_zero;
use crate::sources::calibration::rectified_pair::{check_plausible, middle};
use crate::sources::dataset::folders::{
    existing_folder, existing_with_ending, folders, missing_file, missing_folder, with_ending,
};
use crate::sources::dataset::frame_files::{CALIBRATION, Files, LEFT, Part, RIGHT};
use crate::sources::dataset::{DatasetKind, Listing, depth_port, image_port, recognised, required, truth_off};
use crate::sources::evaluation::Evaluation;
use crate::sources::files::{image_file, shortened};
use crate::sources::middlebury::scene::{TruePixels, with_truth};

const KIND: &str = "middlebury";
const VERSION: u32 = 2;
const LAYOUT: &str = "root holds a folder a scene, or is one: im0.png, im1.png, calib.txt and disp0.pfm (2014 and later), view1.png, view5.png and disp1.png \
(2005, 2006), or im2.png, im6.png and disp2.png (2001, 2003)";

/// Of images and ground truth of 2001 to 2006.
const ENDINGS: [&str; 3] = ["png", "ppm", "pgm"];

const OF_2001: Part = "disp2";
const OF_2005: Part = "disp1";
/// Disparity removed by cropping a scene of 2005 or 2006, px of the full size.
const DMIN: Part = "dmin";

/// Of 2005 and 2006, at full size.
const FOCAL_PX: f64 = 3740.0;
const BASELINE_M: f64 = 0.160;

/// Parameters of `middlebury`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Middlebury {
    /// Folder that contains one folder per scene, e.g. `MiddEval3/trainingQ`, or the folder of one scene.
    #[schemars(extend("mandatory" = true))]
    pub root: DataPath,
    /// Scenes to read, in this order. By default all, sorted by name.
    pub scenes: Vec<String>,
    /// Pixels of `depth`: `all` (all with ground truth), `noc` (seen by both cameras; needs `mask0nocc.png`) or
    /// `none` (ground truth is not read).
    pub ground_truth: TruePixels,
    /// Value that a disparity of 1 px has in the 8-bit maps of 2001 to 2006. The default depends on the size. 2003: 4
    /// at 450 columns, 2 at 900, 1 at 1800. 2005 and 2006: 1 at 1110 rows, 2 at 555, 3 at 370. 2001: 8.
    #[schemars(range(min = 1, max = 255))]
    pub factor: Option<u32>,
    /// Left and right view of scenes of 2001 and 2003, which have `im0` to `im8` at equal distances. The default is 2
    /// and 6.
    pub views: Option<[u32; 2]>,
    /// Focal length of scenes of 2001 and 2003, px of the images as they are; requires `baseline_m`. Their
    /// calibration is not published.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub focal_px: Option<f64>,
    /// Distance between the cameras of scenes of 2001 and 2003, metres; requires `focal_px`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub baseline_m: Option<f64>,
    /// Selected frames, by the position of the scene among the selected scenes, from 0. All by default.
    pub frames: FrameSelection,
}

impl DatasetKind for Middlebury {
    type Params = Self;

    const KIND: (&'static str, u32) = (KIND, VERSION);

    fn declaration() -> SourceDeclaration {
        let depth = "Ground-truth depth, metres, NaN = unknown; absent without ground truth or calibration.";
        let calibration =
            "Focal length, principal points, baseline; absent for scenes without calibration (2001, 2003).";
        let ports = [
            image_port("left", "Left image, 8 bit, with the bytes of its file."),
            image_port("right", "Right image, 8 bit, with the bytes of its file."),
            Port::frame("calibration", ValueType::Calibration, calibration).optional(),
            depth_port(depth).optional(),
        ];
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "Middlebury stereo, 2001 to 2021 and the training set of its benchmark: indoor scenes with dense ground truth.",
            doc: "\
Layout (Scharstein et al., vision.middlebury.edu/stereo/data): one folder per scene. The files in it determine the \
year.\n\n\
**2014, 2021 and MiddEval3:** `im0.png` (left), `im1.png`, `calib.txt`, `disp0.pfm` or `disp0GT.pfm` (px, infinite = \
unknown), and in MiddEval3 `mask0nocc.png`. Depth is `f * B / (d + doffs)`. `doffs` (px) is the column of the right \
camera's principal point minus that of the left.\n\n\
**2005 and 2006:** `view1.png` (left), `view5.png`, `disp1.png` (8 bit, 0 = unknown), `dmin.txt`. At half and third \
size, the values of the map are two and three times the disparity. `f` = 3740 px at full size and `B` = 0.16 m are \
published; the principal point is not, so depthloom uses the centre of the image. Cropping removed `dmin` px (full \
size) from each disparity, which becomes `doffs`. A scene without `dmin.txt` has neither calibration nor depth.\n\n\
**2001 and 2003:** `im2` (left), `im6` and `disp2` (8 bit, 0 = unknown), PNG, PPM or PGM. `views: [2, 4]` selects a \
nearer right view, with proportionally smaller disparities. There is no calibration, and no depth unless you set \
`focal_px` and `baseline_m`. Disparities can be scored without them.\n\n\
The id of a frame is the name of its scene, its index the position of the scene. Pixel centres have integer \
coordinates.",
            outputs: ports.into_iter().chain(Evaluation::always()).collect(),
        }
    }

    fn check(params: &Self) -> Result<(), (&'static str, String)> {
        required("root", &params.root, LAYOUT)?;
        if params.factor.is_some_and(|factor| !(1..=255).contains(&factor)) {
            return Err(("factor", "factor is what 1 px is in a map of 8 bits: 1 to 255".to_owned()));
        }
        if let Some([left, right]) = params.views
            && !(left < right && right <= 8)
        {
            return Err(("views", format!("views is [{left}, {right}]: the left and a view right of it, of 0 to 8")));
        }
        above_zero("focal_px", params.focal_px, "px")?;
        above_zero("baseline_m", params.baseline_m, "m")?;
        match (params.focal_px, params.baseline_m) {
            (Some(_), None) => Err(("focal_px", "focal_px wants baseline_m: depth needs both".to_owned())),
            (None, Some(_)) => Err(("baseline_m", "baseline_m wants focal_px: depth needs both".to_owned())),
            _ => Ok(()),
        }
    }

    fn switched_off(params: &Self) -> Vec<SwitchedOff> {
        truth_off(params.ground_truth == TruePixels::None, "all", &["depth", "disp_noc", "disp_occ", "occluded"])
    }

    fn list(params: &Self) -> Result<(Listing, Self), Fault> {
        let root = params.root.path();
        existing_folder(root, LAYOUT)?;
        let scenes = scenes(root, &params.scenes, |folder| Year::detect(folder).is_some())?;
        if scenes.is_empty() {
            return Err(Fault::new(format!("{} holds no scene", root.display())).remedy(LAYOUT));
        }
        let known: Vec<(u64, &str)> = (0..).zip(&scenes).map(|(index, (name, _))| (index, name.as_str())).collect();
        let mut listing = Listing::default();
        listing.add_selected(&params.frames, &known, |at| params.files(&scenes[at].1))?;
        let without_dmin = listing.ids_where(is_uncalibrated_2005);
        if let Some(first) = without_dmin.first() {
            let (count, are) = (without_dmin.len(), if without_dmin.len() == 1 { "scene has" } else { "scenes have" });
            let what = format!("{count} {are} no dmin.txt, and so neither calibration nor depth: {first}");
            listing.warnings.insert(0, what);
        }
        Ok((listing, params.clone()))
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        // ETH3D's scenes have nearly the same files.
        let is_eth3d = |folder: &Path| folder.join("disp0GT.pfm").is_file();
        if scenes(root, &[], is_eth3d).is_ok_and(|scenes| !scenes.is_empty()) {
            return Vec::new();
        }
        let params = Self { root: DataPath(root.to_owned()), ..Self::default() };
        recognised::<Self>(&params, "Middlebury", root)
    }

    fn meaning(&self) -> String {
        let camera = self.focal_px.zip(self.baseline_m);
        format!("{:?} {:?} {:?} {camera:?}", self.ground_truth, self.factor, self.views())
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        if files.get(CALIBRATION).is_some() {
            return scene::values(files, self.ground_truth, ctx);
        }
        let (left, right) = files.pair(ctx)?;
        let size = left.dimensions();
        let outputs = Outputs::one("left", left).with("right", right);
        let is_2005 = files.get(DMIN).is_some() || files.get(OF_2005).is_some();
        let part = if is_2005 { OF_2005 } else { OF_2001 };
        let encoded = "disparity maps before 2014 have 8 bits, one channel (px times a factor, 0 = unknown)";
        let map = files.map_u8(part, encoded, size)?;
        let calibration = match files.get(DMIN) {
            Some(_) => Some(self.calibration_2005(files, size, ctx)?),
            None if is_2005 => None,
            None => self.focal_px.zip(self.baseline_m).map(|(focal_px, baseline_m)| given(focal_px, baseline_m, size)),
        };
        let mut maps = Evaluation::default();
        if let Some(map) = map {
            // Between views 2 and 6, or 1 and 5, a disparity is four times that between neighbours.
            let steps = if is_2005 { 4 } else { self.views()[1] - self.views()[0] };
            let scale = (4 * self.factor(files, size, ctx)?) as f32;
            let px = |&value: &u8| if value > 0 { (u32::from(value) * steps) as f32 / scale } else { f32::NAN };
            let px = Raster::from_raw(size.0, size.1, map.iter().map(px).collect());
            maps.occ = Some(TrueDisparity { px: px.expect("the map is of the left image's size") });
        }
        if let Some(Err(wrong)) = calibration.as_ref().map(check_plausible) {
            let remedy = "`focal_px` is in pixels of the images as they are, `baseline_m` in metres";
            return Err(Fault::new(wrong.what).remedy(remedy));
        }
        Ok(with_truth(outputs, self.ground_truth, maps, calibration))
    }
}

#[derive(Clone, Copy)]
enum Year {
    From2014,
    Of2005,
    Of2001,
}

impl Year {
    /// `None` if the folder has no file of a scene.
    fn detect(folder: &Path) -> Option<Self> {
        let has =
            |stems: &[&str], endings: &[&str]| stems.iter().any(|stem| with_ending(folder, stem, endings).is_some());
        let old = has(&["im2", "im6", "disp2", "disp6"], &ENDINGS);
        // Other data sets have a file of that name as well (fault 62).
        let is_calibrated = || {
            let text = image_file::read(&folder.join("calib.txt"));
            text.is_ok_and(|text| String::from_utf8_lossy(&text).contains("cam0")) || has(&["im0", "im1"], &["png"])
        };
        if has(&["disp0", "disp0GT"], &["pfm"]) || has(&["calib"], &["txt"]) && is_calibrated() {
            Some(Self::From2014)
        } else if old || (2..=8).any(|view| has(&[&format!("im{view}")], &ENDINGS)) {
            Some(Self::Of2001)
        } else if has(&["view1", "view5", "disp1", "disp5"], &ENDINGS) {
            Some(Self::Of2005)
        } else {
            has(&["im0", "im1"], &["png"]).then_some(Self::From2014)
        }
    }
}

impl Middlebury {
    fn views(&self) -> [u32; 2] {
        self.views.unwrap_or([2, 6])
    }

    fn files(&self, folder: &Path) -> Result<Vec<(Part, PathBuf)>, Fault> {
        let (stem, [left, right], truth, span) = match Year::detect(folder) {
            Some(Year::Of2005) => ("view", [1, 5], OF_2005, "view1.png, view5.png and disp1.png"),
            Some(Year::Of2001) => ("im", self.views(), OF_2001, "im2, im6 and disp2, PNG, PPM or PGM"),
            Some(Year::From2014) => return scene::files(folder, folder, self.ground_truth),
            None => return Err(Fault::new(format!("{} holds no scene", folder.display())).remedy(LAYOUT)),
        };
        let remedy = format!("a scene of this year has {span}; without ground truth, set `ground_truth: none`");
        let there = |stem: &str| existing_with_ending(folder, stem, &ENDINGS, &remedy);
        let mut files = vec![(LEFT, there(&format!("{stem}{left}"))?), (RIGHT, there(&format!("{stem}{right}"))?)];
        if self.ground_truth == TruePixels::Noc {
            let mask = folder.join("mask0nocc.png");
            let remedy = "`ground_truth: noc` needs a mask, which scenes before 2014 lack; use `ground_truth: all`";
            return Err(missing_file(&mask, remedy));
        }
        if self.ground_truth == TruePixels::All {
            if truth == OF_2001 && left != 2 {
                let what = format!("{} has no ground truth for view {left}", folder.display());
                return Err(
                    Fault::new(what).remedy("ground truth exists for view 2: `views: [2, 6]`, or `ground_truth: none`")
                );
            }
            files.push((truth, there(truth)?));
        }
        let dmin = folder.join("dmin.txt");
        if stem == "view" && dmin.is_file() {
            files.push((DMIN, dmin));
        }
        Ok(files)
    }

    /// Map value per pixel of disparity, in 8-bit maps.
    fn factor(&self, files: &Files, size: (u32, u32), ctx: &mut Context<'_>) -> Result<u32, Fault> {
        let unknown = |of: &str| {
            let what = format!("{} is {}x{}: {of}", files.required(LEFT)?.path.display(), size.0, size.1);
            Err(Fault::new(what).remedy("set the value that 1 px has in the disparity map, e.g. `factor: 4`"))
        };
        if let Some(factor) = self.factor {
            return Ok(factor);
        }
        if files.get(OF_2001).is_none() {
            return match size.1 {
                1110 => Ok(1),
                555 => Ok(2),
                370 => Ok(3),
                _ => unknown("scenes of 2005 and 2006 have 1110, 555 or 370 rows"),
            };
        }
        match size.0 {
            450 => Ok(4),
            900 => Ok(2),
            1800 => Ok(1),
            // Those of 2001 have sizes of their own.
            width if width < 450 => {
                ctx.host
                    .warn("disparity maps are read as those of 2001, with 8 per pixel: set `factor` for another value");
                Ok(8)
            }
            _ => unknown("scenes of 2003 have 450, 900 or 1800 columns"),
        }
    }
}

fn is_uncalibrated_2005(files: &[(Part, PathBuf)]) -> bool {
    let is_view =
        |(part, path): &(Part, PathBuf)| *part == LEFT && path.file_stem().is_some_and(|stem| stem == "view1");
    files.iter().any(is_view) && !files.iter().any(|(part, _)| *part == DMIN)
}

pub(super) fn scenes(
    root: &Path,
    selected: &[String],
    is_scene: impl Fn(&Path) -> bool,
) -> Result<Vec<(String, PathBuf)>, Fault> {
    let named = |name: &String| (name.clone(), root.join(name));
    if !selected.is_empty() {
        let missing = selected.iter().find(|name| !root.join(name).is_dir());
        return match missing {
            Some(name) => Err(missing_folder(&root.join(name), "`scenes` names folders of root")),
            None => Ok(selected.iter().map(named).collect()),
        };
    }
    if is_scene(root) {
        let name = root.canonicalize().unwrap_or_else(|_| root.to_owned());
        let name = name.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        return Ok(vec![(name, root.to_owned())]);
    }
    Ok(folders(root, LAYOUT)?.iter().map(named).filter(|(_, folder)| is_scene(folder)).collect())
}

impl Middlebury {
    fn calibration_2005(&self, files: &Files, size: (u32, u32), ctx: &mut Context<'_>) -> Result<Calibration, Fault> {
        let dmin = files.required(DMIN)?;
        let text = dmin.text();
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let number = number.ok_or_else(|| {
            let remedy = "dmin.txt holds one number, the part of each disparity that cropping removed, px at full size: take it from the scene's archive";
            dmin.fault(format!("`{}` is not a number", shortened(text.trim()))).remedy(remedy)
        })?;
        let factor = f64::from(self.factor(files, size, ctx)?);
        Ok(Calibration { doffs_px: number / factor, ..given(FOCAL_PX / factor, BASELINE_M, size) })
    }
}

fn given(focal_px: f64, baseline_m: f64, (width, height): (u32, u32)) -> Calibration {
    let (cx_px, cy_px) = middle((width, height));
    Calibration { width, height, focal_px, cx_px, cy_px, baseline_m, doffs_px: 0.0 }
}
