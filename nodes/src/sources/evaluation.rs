//! Inputs of `score/disparity`: ground-truth disparities of two pixel sets, the pixels between them, and objects.

use depthloom_graphs::values::{Mask, Raster, TrueDisparity};
use depthloom_graphs::{Outputs, Port, Value, ValueType};

#[derive(Debug, Default)]
pub(super) struct Evaluation {
    pub noc: Option<TrueDisparity>,
    pub occ: Option<TrueDisparity>,
    pub objects: Option<Mask>,
}

impl Evaluation {
    pub(super) fn on_request() -> [Port; 3] {
        ports([
            "Ground-truth disparity of pixels that both cameras see, px, NaN = unknown; with `disparities: true`.",
            "Ground-truth disparity of all pixels that have one, px, NaN = unknown; with `disparities: true`.",
            "255 where `disp_occ` has a disparity and `disp_noc` has not; with `disparities: true`.",
        ])
    }

    pub(super) fn always() -> [Port; 3] {
        ports([
            "Ground-truth disparity of pixels that both cameras see, px, NaN = unknown; absent if no file contains this.",
            "Ground-truth disparity of all pixels that have one, px, NaN = unknown; absent without ground truth.",
            "255 where `disp_occ` has a disparity and `disp_noc` has not; absent without both.",
        ])
    }

    pub(super) fn outputs(self, mut outputs: Outputs) -> Outputs {
        if let (Some(noc), Some(occ)) = (&self.noc, &self.occ) {
            let hidden = |(noc, occ): (&f32, &f32)| if noc.is_nan() && !occ.is_nan() { 255 } else { 0 };
            let hidden = noc.px.iter().zip(occ.px.iter()).map(hidden).collect();
            let set = Raster::from_raw(occ.px.width(), occ.px.height(), hidden);
            outputs = outputs.with("occluded", Mask { set: set.expect("both maps are of the left image's size") });
        }
        outputs = with_optional(outputs, "disp_noc", self.noc);
        outputs = with_optional(outputs, "disp_occ", self.occ);
        with_optional(outputs, "obj_map", self.objects)
    }
}

pub(super) fn with_optional(outputs: Outputs, port: &'static str, value: Option<impl Into<Value>>) -> Outputs {
    match value {
        Some(value) => outputs.with(port, value),
        None => outputs,
    }
}

fn ports([noc, occ, occluded]: [&'static str; 3]) -> [Port; 3] {
    [
        Port::frame("disp_noc", ValueType::TrueDisparity, noc).optional(),
        Port::frame("disp_occ", ValueType::TrueDisparity, occ).optional(),
        Port::frame("occluded", ValueType::Mask, occluded).optional(),
    ]
}
