//! `learn/samples`: images and confident disparities, collected at a network's size.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Artifact, Calibration, Image, Pixels};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, OrderedNode, Outputs, Port, Value, ValueType};
use depthloom_kernels::resize::area_rgb8;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::format::Form;
use super::sample::Sample;
use super::sampler::{Sampler, Sampling};
use super::spool::Spool;

/// Parameters of `learn/samples`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SamplesParams {
    /// Columns and rows of the network's image, px.
    #[schemars(inner(range(min = 1, max = 4096)))]
    pub(crate) size: [u32; 2],
    /// Only disparities above this become targets, px.
    #[schemars(range(min = 0, max = 2048))]
    pub(crate) least_disparity: f64,
    /// A cell of the small image has a target only if at least this share of it is covered.
    #[schemars(range(min = 0, max = 1))]
    pub(crate) coverage: f64,
    /// Samples beyond this size are stored in a temporary file until the last frame, MB (2^20 bytes); the result is the
    /// same.
    #[schemars(range(min = 0, max = 1_048_576), extend("operational" = true))]
    pub(crate) memory_mb: u32,
}

impl Default for SamplesParams {
    fn default() -> Self {
        Self { size: [320, 96], least_disparity: 0.5, coverage: 0.2, memory_mb: 256 }
    }
}

pub(crate) struct CollectSamples {
    sampler: Sampler,
    spool: Spool,
    count: u64,
    /// Whether samples have a right image: settled by the first.
    has_right: Option<bool>,
}

impl Node for CollectSamples {
    type Params = SamplesParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: Self::KIND,
            version: 1,
            contract: Contract::Ordered,
            summary: "Collects training samples: images and confident disparities at the network's size.",
            doc: "\
The image is resized by area to `size` and rounded to 8 bits, as in `mono/onnx`; grey is repeated in all three channels. The target of a pixel of the small \
image is the mean disparity of its cell, divided by the image's width. The mean covers the pixels that the mask confirms and whose disparity is above \
`least_disparity` (area resize of value times mask, divided by that of the mask). Cells covered less than `coverage` have no target. Targets are stored as \
IEEE half, together with `f * B / width` from `calibration`, which converts them to metres.\n\n\
No ground truth is used. A frame without any target is skipped; a training without any samples reports that. The bytes of the samples depend only on the \
frames and on `size`, `least_disparity` and `coverage`.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The left image, grey or RGB, no smaller than `size`."),
                Port::frame("target", ValueType::Disparity, "Disparity of the image's pixels, 1/16 px."),
                Port::frame("mask", ValueType::Mask, "Where the disparity is confident enough for training."),
                Port::frame("calibration", ValueType::Calibration, "Focal length and baseline, for losses in metres.")
                    .optional(),
                Port::frame("right", ValueType::Image, "The right image, for photometric losses.").optional(),
            ],
            outputs: vec![Port::once("samples", ValueType::Samples, "All samples, in the order of the frames.")],
        }
    }

    fn check(params: &SamplesParams) -> Result<(), (&'static str, String)> {
        Sampling::new(params).check()
    }

    fn build(params: SamplesParams) -> Result<Instance, Fault> {
        Ok(Instance::Ordered(Box::new(Self::new(&params))))
    }
}

impl CollectSamples {
    pub(crate) const KIND: &str = "learn/samples";

    fn new(params: &SamplesParams) -> Self {
        let bound = (params.memory_mb as usize).saturating_mul(1 << 20);
        let sampler = Sampler::new(Sampling::new(params));
        Self { sampler, spool: Spool::new(bound), count: 0, has_right: None }
    }

    const fn form(&self) -> Form {
        let has_right = matches!(self.has_right, Some(true));
        let [width, height] = self.sampler.size();
        Form { width, height, has_right, has_cells: false }
    }

    /// The frame as a sample; `None` if it has no target.
    fn sample(&mut self, frame: &Frame, inputs: &Inputs<'_>) -> Result<Option<Sample>, Fault> {
        let image = inputs.get::<Image>("image")?;
        let right = inputs.optional::<Image>("right")?;
        if let Some(right) = right {
            same_size(image, "right", right.dimensions())?;
        }
        let (size, image_size) = (self.sampler.size(), image.dimensions());
        let planes = small(size, "image", image)?;
        let depth_scale = match inputs.optional::<Calibration>("calibration")? {
            Some(calibration) => Some(depth_scale(calibration, image_size.0)?),
            None => None,
        };
        if *self.has_right.get_or_insert(right.is_some()) != right.is_some() {
            return Err(Fault::new("some frames have a right image and others do not")
                .remedy("leave `right` unwired, or select only frames with a right image"));
        }
        let Some(sample) = self.sampler.sample(frame, inputs, planes, depth_scale)? else { return Ok(None) };
        let right = right.map(|right| small(size, "right", right)).transpose()?;
        Ok(Some(Sample { right, ..sample }))
    }

    fn bytes(&mut self) -> std::io::Result<std::sync::Arc<[u8]>> {
        let header = self.form().header(self.count);
        self.spool.bytes(&header)
    }
}

impl OrderedNode for CollectSamples {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        if let Some(sample) = self.sample(frame, inputs)? {
            let form = self.form();
            self.spool.append(|out| form.append(&sample, out)).map_err(unwritten)?;
            self.count += 1;
        }
        Ok(Outputs::none())
    }

    fn finish(mut self: Box<Self>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let samples = Artifact::samples(self.bytes().map_err(unwritten)?);
        Ok(Outputs::one("samples", Value::Samples(samples.into())))
    }
}

/// The planes of red, green and blue at the network's size.
pub(crate) fn small(size: [u32; 2], port: &str, image: &Image) -> Result<Vec<u8>, Fault> {
    let (width, height) = image.dimensions();
    let [columns, rows] = size;
    if width < columns || height < rows {
        return Err(Fault::new(format!(
            "`{port}` is {width}x{height}, smaller than the network's image of {columns}x{rows}"
        ))
        .remedy("lower `size` (and the network's): training on enlarged images is not supported"));
    }
    let repeated: Vec<u8>;
    let interleaved = match image.pixels() {
        Pixels::Rgb(rgb) => rgb.as_raw(),
        Pixels::Grey(grey) => {
            repeated = grey.iter().flat_map(|&value| [value; 3]).collect();
            &repeated
        }
    };
    let mut small = vec![0; 3 * columns as usize * rows as usize];
    let to = (columns as usize, rows as usize);
    area_rgb8(interleaved, width as usize, height as usize, to.0, to.1, &mut small);
    Ok((0..3).flat_map(|channel| small.iter().skip(channel).step_by(3)).copied().collect())
}

pub(super) fn unwritten(error: std::io::Error) -> Fault {
    Fault::new(format!("failed to write samples to a temporary file in {}", std::env::temp_dir().display()))
        .because(error)
        .remedy("free some disk space, set TMPDIR to another folder, or raise `memory_mb`")
}

pub(super) fn same_size(image: &Image, port: &str, (width, height): (u32, u32)) -> Result<(), Fault> {
    let (columns, rows) = image.dimensions();
    if (columns, rows) == (width, height) {
        return Ok(());
    }
    Err(Fault::new(format!(
        "`image` is {columns}x{rows} and `{port}` is {width}x{height}: they must have the same size"
    )))
}

/// `f * B / width`, metres: with a share `s`, depth is this over `s`.
pub(crate) fn depth_scale(calibration: &Calibration, width: u32) -> Result<f64, Fault> {
    if calibration.doffs_px != 0.0 {
        let doffs_px = calibration.doffs_px;
        let what = format!(
            "the principal points of `calibration` are {doffs_px} px apart, but training in metres requires equal principal points"
        );
        return Err(Fault::new(what).remedy("leave `calibration` unwired to train on disparities, without metres"));
    }
    let scale = calibration.focal_baseline_px_m() / f64::from(width);
    if scale > 0.0 && scale.is_finite() {
        return Ok(scale);
    }
    let Calibration { focal_px, baseline_m, .. } = calibration;
    Err(Fault::new(format!("`calibration` has a focal length of {focal_px} px and a baseline of {baseline_m} m"))
        .remedy("both must be above 0; leave `calibration` unwired to train without metres"))
}

#[cfg(test)]
mod tests;
