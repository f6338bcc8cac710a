//! Depth of a frame by the current network, as `mono/onnx` computes it from the network's file.

use depthloom_graphs::Fault;
use depthloom_graphs::values::{Calibration, Depth, Raster};
use depthloom_kernels::depth::{Geometry, depth_from_share};
use depthloom_kernels::resize::bilinear_f32;

use crate::compute::{Engine, Input};
use crate::networks::{Meaning, Monocular, ParameterLayout, Size};

/// The smallest disparity, px of the image; the default of `mono/onnx`.
const FLOOR_PX: f32 = 1e-3;
/// Metres; the value that metrics clamp to.
const NEAREST_M: f32 = 1e-3;

pub(super) struct Predictor {
    engine: Engine<Monocular>,
    meaning: Meaning,
    /// Columns and rows of the network's image, px.
    image: Size,
    map: Size,
    cap_m: f32,
}

impl Predictor {
    pub(super) fn new(network: Monocular, layout: &ParameterLayout, image: Size, cap_m: f32) -> Self {
        let (engine, meaning) = (Engine::new(network, layout), network.network.meaning());
        Self { engine, meaning, image, map: layout.map, cap_m }
    }

    /// Metres at the size of the frame, from the image's planes at the network's size.
    pub(super) fn depth(
        &mut self,
        planes: &[u8],
        parameters: &[Vec<f32>],
        calibration: &Calibration,
        (columns, rows): (u32, u32),
    ) -> Result<Depth, Fault> {
        let values = planes.iter().map(|&sample| f32::from(sample) / 255.0).collect();
        let shape = [1, 3, self.image.height, self.image.width];
        let mut map = self.engine.maps(&Input { values, shape }, parameters);
        // A pixel that depends on a number that is not finite is invalid.
        map.iter_mut().for_each(|value| {
            *value = if value.is_finite() { *value * self.meaning.scale() } else { f32::NAN };
        });
        let (width, height) = (columns as usize, rows as usize);
        let mut full = vec![0.0; width * height];
        if (self.map.width, self.map.height) == (width, height) {
            full = map;
        } else {
            bilinear_f32(&map, self.map.width, self.map.height, width, height, &mut full);
        }
        let mut metres = vec![0.0; full.len()];
        match self.meaning {
            Meaning::DisparityShare { .. } => {
                let Calibration { focal_px, baseline_m, doffs_px, .. } = *calibration;
                let pair = Geometry { focal_px, baseline_metres: baseline_m, doffs_px };
                depth_from_share(&full, width, pair, FLOOR_PX, self.cap_m, &mut metres);
            }
            Meaning::Depth { .. } => {
                for (metres, &value) in metres.iter_mut().zip(&full) {
                    let raised = if value < NEAREST_M { NEAREST_M } else { value };
                    *metres = if raised > self.cap_m { self.cap_m } else { raised };
                }
            }
        }
        let metres = Raster::from_raw(columns, rows, metres).ok_or_else(|| Fault::new("a map lost its size"))?;
        Ok(Depth { metres })
    }
}
