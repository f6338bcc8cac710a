//! Frames as training samples.

use std::borrow::Borrow;

use depthloom_graphs::values::{Disparity, Image, Mask};
use depthloom_graphs::{Fault, Frame, Inputs};

use super::format::Form;
use super::node::{SamplesParams, same_size};
use super::sample::Sample;
use super::target::{Maps, Rule};

/// The parameters that decide what a sample contains, as `learn/samples` documents them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampling {
    pub(crate) size: [u32; 2],
    pub(crate) least_disparity: f64,
    pub(crate) coverage: f64,
}

impl Sampling {
    pub(super) const fn new(params: &SamplesParams) -> Self {
        let SamplesParams { size, least_disparity, coverage, .. } = *params;
        Self { size, least_disparity, coverage }
    }

    pub(crate) fn check(&self) -> Result<(), (&'static str, String)> {
        let Self { size, least_disparity, coverage } = self;
        if size.iter().any(|side| !(1..=4096).contains(side)) {
            return Err(("size", format!("size is {size:?}, whose sides are not in 1..=4096")));
        }
        if !(0.0..=2048.0).contains(least_disparity) {
            let what = format!("least_disparity is {least_disparity} px, which is not in 0..=2048");
            return Err(("least_disparity", what));
        }
        if !(0.0..=1.0).contains(coverage) {
            return Err(("coverage", format!("coverage is {coverage}, which is not in 0..=1")));
        }
        Ok(())
    }
}

/// Makes samples of the inputs `target` and `mask`.
pub(crate) struct Sampler {
    size: [u32; 2],
    rule: Rule,
    maps: Maps,
}

impl Sampler {
    pub(crate) fn new(Sampling { size, least_disparity, coverage }: Sampling) -> Self {
        Self { size, rule: Rule { least_disparity_px: least_disparity, coverage }, maps: Maps::default() }
    }

    /// Columns and rows, px.
    pub(crate) const fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The sample of a frame, without a right image; `None` if the frame has no target. `planes` is the image at the
    /// network's size.
    pub(crate) fn sample(
        &mut self,
        frame: &Frame,
        inputs: &Inputs<'_>,
        planes: Vec<u8>,
        depth_scale: Option<f64>,
    ) -> Result<Option<Sample>, Fault> {
        let image = inputs.get::<Image>("image")?;
        let (disparity, mask) = (inputs.get::<Disparity>("target")?, inputs.get::<Mask>("mask")?);
        same_size(image, "target", disparity.sixteenths_px.dimensions())?;
        same_size(image, "mask", mask.set.dimensions())?;
        let (columns, rows) = (self.size[0] as usize, self.size[1] as usize);
        let share = self.maps.target(disparity, Some(mask), self.rule, columns, rows);
        if share.iter().all(|share| share.is_nan()) {
            return Ok(None);
        }
        Ok(Some(Sample { id: frame.id.to_string(), image: planes, right: None, share, depth_scale, cells: None }))
    }
}

/// Samples without right images as the bytes of `learn/samples`.
pub(crate) fn encode(size: [u32; 2], samples: &[impl Borrow<Sample>]) -> Vec<u8> {
    let form = Form { width: size[0], height: size[1], has_right: false, has_cells: false };
    let mut bytes = form.header(samples.len() as u64).to_vec();
    for sample in samples {
        form.append(sample.borrow(), &mut bytes);
    }
    bytes
}
