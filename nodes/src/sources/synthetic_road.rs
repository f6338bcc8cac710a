//! `synthetic/road`: a deterministic street, rendered.

use std::ops::Range;

use depthloom_graphs::contracts::{Frame, FrameSelection, SourceDeclaration, SwitchedOff};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::{Calibration, Depth, Image, Mask, Pixels, Raster, TrueDisparity};
use depthloom_graphs::{Context, Fault, Host, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use depthloom_road::{Size, Street};

use crate::sources::dataset::{calibration_port, depth_port, image_port};
use crate::sources::true_disparity;

const KIND: &str = "synthetic/road";
const VERSION: u32 = 1;
/// Ids have six digits, as KITTI's.
const FRAMES: Range<u64> = 0..1_000_000;

/// Pixels of the output `depth`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SyntheticTruth {
    /// Pixels that the right camera also sees, as in `disp_noc_0` of KITTI.
    #[default]
    Noc,
    /// All pixels that the scanner hit, as in `disp_occ_0` of KITTI.
    Occ,
}

/// Parameters of `synthetic/road`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SyntheticRoadParams {
    /// Selected frames, `0..16`, `1..=40` or a list of indices, each below 1,000,000; in this order, each once.
    pub frames: FrameSelection,
    /// Number of the street. Equal seeds give equal bits.
    pub seed: u64,
    /// Columns of the images, px.
    #[schemars(range(min = 16, max = 8192))]
    pub width: u32,
    /// Rows of the images, px.
    #[schemars(range(min = 16, max = 8192))]
    pub height: u32,
    /// Pixels of `depth`: `noc` (seen by both cameras) or `occ` (all that the scanner hit).
    pub ground_truth: SyntheticTruth,
    /// Whether frames also have ground-truth disparities (`disp_noc`, `disp_occ`) and the map of cars (`obj_map`).
    /// `score/disparity` uses them.
    pub disparities: bool,
}

impl Default for SyntheticRoadParams {
    fn default() -> Self {
        Self {
            frames: FrameSelection::Range(0..16),
            seed: 1,
            width: Size::KITTI.width as u32,
            height: Size::KITTI.height as u32,
            ground_truth: SyntheticTruth::Noc,
            disparities: false,
        }
    }
}

/// The street of some parameters.
pub struct Road {
    street: Street,
    street_key: Key,
}

/// A frame of a street, as values.
pub struct RoadFrame {
    /// The left image.
    pub left: Image,
    /// The right image.
    pub right: Image,
    /// Of both cameras.
    pub calibration: Calibration,
    /// Exact depth of every pixel that is not sky.
    pub dense: Depth,
    /// Set where the right camera does not see what the left one sees.
    pub occluded: Mask,
    /// What the scanner hit.
    pub sparse: Depth,
    /// What the scanner hit and the right camera sees.
    pub sparse_visible: Depth,
    /// Set where the left camera sees a car.
    pub cars: Mask,
}

impl RoadFrame {
    /// Depths of this frame as KITTI's disparities.
    #[must_use]
    pub fn disparity(&self, of: &Depth) -> TrueDisparity {
        true_disparity::from_depth(of, &self.calibration)
    }
}

impl Road {
    /// The street of these parameters.
    #[must_use]
    pub fn new(params: &SyntheticRoadParams) -> Self {
        let size = Size { width: params.width as usize, height: params.height as usize };
        let street_key = Key::build(KIND).number(VERSION.into()).number(params.seed);
        let street_key = street_key.number(params.width.into()).number(params.height.into());
        Self { street: Street::new(params.seed, size), street_key: street_key.finish() }
    }

    /// The frames of a selection.
    ///
    /// # Errors
    /// If the selection is empty or without end.
    pub fn frames(selection: &FrameSelection) -> Result<Vec<Frame>, Fault> {
        let indices: Vec<u64> = match selection {
            FrameSelection::Range(range) if range.end <= FRAMES.end => range.clone().collect(),
            FrameSelection::Available(range) => (range.start..range.end.min(FRAMES.end)).collect(),
            FrameSelection::List(list) if list.iter().all(|index| FRAMES.contains(index)) => list.clone(),
            FrameSelection::Range(_) | FrameSelection::List(_) => {
                return Err(Fault::new(format!("a synthetic street has the frames 0 to {}", FRAMES.end - 1)));
            }
            FrameSelection::All => {
                return Err(Fault::new("a synthetic street has no end")
                    .remedy("set `frames` to a range (0..16) or a list ([3, 7])"));
            }
            FrameSelection::File(_) => {
                return Err(Fault::new("the frames of a synthetic street have numbers, not names in a file")
                    .remedy("set `frames` to a range (0..16) or a list ([3, 7])"));
            }
        };
        if indices.is_empty() {
            return Err(Fault::new("no frame is selected").remedy("frames takes a range (0..16) or a list ([3, 7])"));
        }
        Ok(indices.into_iter().map(|index| Frame::at_10_hz(format!("{index:06}_10"), index)).collect())
    }

    /// Renders a frame.
    ///
    /// # Panics
    /// Never: the renderer gives as many pixels as the size has.
    #[must_use]
    pub fn frame(&self, index: u64, host: &dyn Host) -> RoadFrame {
        let frame = self.street.frame(index, &|n, tile| host.tiles(n, tile));
        let (width, height) = (frame.size.width as u32, frame.size.height as u32);
        let image = |rgb: Vec<u8>| {
            Image::new(Pixels::Rgb(RgbImage::from_raw(width, height, rgb).expect("three bytes per pixel")))
        };
        let depth =
            |metres: Vec<f32>| Depth { metres: Raster::from_raw(width, height, metres).expect("one depth a pixel") };
        let mask = |set: &[bool]| {
            let set = set.iter().map(|&set| if set { 255 } else { 0 }).collect();
            Mask { set: Raster::from_raw(width, height, set).expect("one byte per pixel") }
        };
        let calibration = Calibration {
            width,
            height,
            focal_px: frame.calibration.focal_px,
            cx_px: frame.calibration.cx_px,
            cy_px: frame.calibration.cy_px,
            baseline_m: frame.calibration.baseline_m,
            doffs_px: 0.0,
        };
        RoadFrame {
            sparse_visible: depth(frame.sparse_visible()),
            left: image(frame.left),
            right: image(frame.right),
            calibration,
            dense: depth(frame.depth),
            occluded: mask(&frame.occluded),
            cars: mask(&frame.cars),
            sparse: depth(frame.sparse),
        }
    }
}

pub(crate) struct SyntheticRoad {
    road: Road,
    truth: SyntheticTruth,
    disparities: bool,
    frames: Vec<Frame>,
}

impl SourceKind for SyntheticRoad {
    type Params = SyntheticRoadParams;

    fn declaration() -> SourceDeclaration {
        let occluded = "255 where the right camera does not see the surface that the left camera sees.";
        let noc = "Ground-truth disparity where the scanner hit and both cameras see, px, NaN = unknown; with `disparities: true`.";
        let occ = "Ground-truth disparity of all that the scanner hit, px, NaN = unknown; with `disparities: true`.";
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "Synthetic street: deterministic ray-cast rectified pairs with exact and laser-like ground truth. No download.",
            doc: "\
A street seen by KITTI's cameras: focal length 721.5 px at 1242 columns, baseline 0.533 m, 1.65 m above the road. It \
shows façades with repeated windows, plain walls, cars, poles, trees and sky. The images have sensor noise, and the \
cameras differ in exposure. It needs no download and contains the difficulties that real streets have for stereo.\n\n\
A frame is a function of `seed`, size and index: it has the same bits on every machine, with any number of threads. \
Ids are `000000_10`, as in KITTI.\n\n\
Score against `depth`, which has the sparse pixels of a laser scanner and corresponds to KITTI's ground truth. \
`dense` has the exact depth of every pixel.",
            outputs: vec![
                image_port("left", "Left image, RGB, 8 bit."),
                image_port("right", "Right image, RGB, 8 bit."),
                calibration_port(),
                depth_port(
                    "Sparse ground-truth depth of a simulated 64-beam laser scanner, metres, NaN = unknown. Use it for metrics.",
                ),
                Port::frame("dense", ValueType::Depth, "Exact depth of every pixel, metres; NaN in the sky."),
                Port::frame("occluded", ValueType::Mask, occluded),
                Port::frame("disp_noc", ValueType::TrueDisparity, noc).optional(),
                Port::frame("disp_occ", ValueType::TrueDisparity, occ).optional(),
                Port::frame("obj_map", ValueType::Mask, "255 on cars; with `disparities: true`.").optional(),
            ],
        }
    }

    fn check(params: &SyntheticRoadParams) -> Result<(), (&'static str, String)> {
        Road::frames(&params.frames).map(drop).map_err(|fault| {
            let remedy = fault.remedy_text().map_or_else(String::new, |remedy| format!(": {remedy}"));
            ("frames", format!("{fault}{remedy}"))
        })?;
        for (name, pixels) in [("width", params.width), ("height", params.height)] {
            if !(16..=8192).contains(&pixels) {
                return Err((name, format!("{name} is {pixels} px, which is not in 16 to 8192")));
            }
        }
        Ok(())
    }

    fn switched_off(params: &SyntheticRoadParams) -> Vec<SwitchedOff> {
        let outputs: &[_] = if params.disparities { &[] } else { &["disp_noc", "disp_occ", "obj_map"] };
        SwitchedOff::by("disparities", "false", "true", outputs)
    }

    fn open(params: SyntheticRoadParams) -> Result<Box<dyn Source>, Fault> {
        let frames = Road::frames(&params.frames)?;
        Ok(Box::new(Self {
            road: Road::new(&params),
            truth: params.ground_truth,
            disparities: params.disparities,
            frames,
        }))
    }
}

impl Source for SyntheticRoad {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let truth = match self.truth {
            SyntheticTruth::Noc => "noc",
            SyntheticTruth::Occ => "occ",
        };
        let index = self.frames[position].index;
        let key = Key::build("synthetic/road frame").key(&self.road.street_key).number(index).text(truth);
        Ok(if self.disparities { key.text("disparities") } else { key }.finish())
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let index = self.frames[position].index;
        let frame = self.road.frame(index, ctx.host);
        let mut outputs = Outputs::none();
        if self.disparities {
            outputs = Outputs::one("disp_noc", frame.disparity(&frame.sparse_visible))
                .with("disp_occ", frame.disparity(&frame.sparse))
                .with("obj_map", frame.cars);
        }
        let truth = match self.truth {
            SyntheticTruth::Noc => frame.sparse_visible,
            SyntheticTruth::Occ => frame.sparse,
        };
        let outputs = outputs
            .with("left", frame.left)
            .with("right", frame.right)
            .with("calibration", frame.calibration)
            .with("depth", truth)
            .with("dense", frame.dense)
            .with("occluded", frame.occluded);
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}
