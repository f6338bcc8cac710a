//! `example/plane`: a source.

use depthloom::graphs::contracts::{Frame, SourceDeclaration};
use depthloom::graphs::plan::FrameIndex;
use depthloom::graphs::values::{Calibration, Depth, Image, Pixels, Raster};
use depthloom::graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use image::{GrayImage, Luma};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const WIDTH: u32 = 320;
const HEIGHT: u32 = 120;
const FOCAL_PX: f64 = 200.0;
const BASELINE_M: f64 = 0.5;

/// Parameters of `example/plane`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaneParams {
    /// The disparity of every frame's plane, px: its depth is 100 / disparity metres.
    disparities: Vec<u32>,
}

/// The kind `example/plane`.
pub(crate) struct Plane {
    disparities: Vec<u32>,
    frames: Vec<Frame>,
}

impl SourceKind for Plane {
    type Params = PlaneParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: "example/plane",
            version: 1,
            summary: "A textured plane that faces the cameras.",
            doc: "One frame per disparity; both images are one random texture, the right one shifted.",
            outputs: vec![
                Port::frame("left", ValueType::Image, "Left image, grey, 8 bit."),
                Port::frame("right", ValueType::Image, "Right image, likewise."),
                Port::frame("calibration", ValueType::Calibration, "f = 200 px, B = 0.5 m."),
                Port::frame("depth", ValueType::Depth, "The plane's depth in every pixel, metres."),
            ],
        }
    }

    fn check(params: &PlaneParams) -> Result<(), (&'static str, String)> {
        match params.disparities.iter().find(|disparity| !(1..=64).contains(*disparity)) {
            Some(wrong) => Err(("disparities", format!("a disparity is {wrong} px, which is not in 1 to 64"))),
            None => Ok(()),
        }
    }

    fn open(PlaneParams { disparities }: PlaneParams) -> Result<Box<dyn Source>, Fault> {
        let frames = (0..).zip(&disparities).map(|(index, _)| Frame::at_10_hz(format!("{index:03}"), index)).collect();
        Ok(Box::new(Self { disparities, frames }))
    }
}

impl Source for Plane {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        // What decides the frame, so that results can be known again: a data set hashes the files it reads.
        Ok(Key::build("example/plane").number(u64::from(self.disparities[position])).finish())
    }

    fn read(&self, position: FrameIndex, _ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let disparity = self.disparities[position];
        let texture = |x: u32, y: u32| {
            let mixed = (y * 4096 + x).wrapping_mul(2_654_435_761);
            Luma([((mixed ^ mixed >> 15).wrapping_mul(2_246_822_519) >> 24) as u8])
        };
        let left = GrayImage::from_fn(WIDTH, HEIGHT, texture);
        let right = GrayImage::from_fn(WIDTH, HEIGHT, |x, y| texture(x + disparity, y));
        let metres = Raster::from_pixel(WIDTH, HEIGHT, Luma([(FOCAL_PX * BASELINE_M) as f32 / disparity as f32]));
        let calibration = Calibration {
            width: WIDTH,
            height: HEIGHT,
            focal_px: FOCAL_PX,
            cx_px: f64::from(WIDTH) / 2.0,
            cy_px: f64::from(HEIGHT) / 2.0,
            baseline_m: BASELINE_M,
            doffs_px: 0.0,
        };
        let outputs = Outputs::one("left", Image::new(Pixels::Grey(left)))
            .with("right", Image::new(Pixels::Grey(right)))
            .with("calibration", calibration)
            .with("depth", Depth { metres });
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}
