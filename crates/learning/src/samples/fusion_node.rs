//! `learn/fusion-samples`: samples from which a network is trained to fuse stereo with a monocular estimate.

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Artifact, Calibration, Depth, Disparity, Image, Weight};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, OrderedNode, Outputs, Port, Value, ValueType};
use depthloom_kernels::learned::{FrameMaps, cells};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::format::Form;
use super::node::{depth_scale, same_size, small, unwritten};
use super::sample::{Sample, cell_bytes};
use super::spool::Spool;
use super::target::{Maps, Rule};

/// Parameters of `learn/fusion-samples`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct FusionSamplesParams {
    /// Columns and rows of the network's image, px.
    #[schemars(inner(range(min = 1, max = 4096)))]
    pub(crate) size: [u32; 2],
    /// Only target disparities above this are used, px.
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

impl Default for FusionSamplesParams {
    fn default() -> Self {
        Self { size: [640, 192], least_disparity: 0.5, coverage: 0.5, memory_mb: 256 }
    }
}

pub(crate) struct CollectFusionSamples {
    size: [u32; 2],
    rule: Rule,
    maps: Maps,
    spool: Spool,
    count: u64,
}

impl Node for CollectFusionSamples {
    type Params = FusionSamplesParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: Self::KIND,
            version: 1,
            contract: Contract::Ordered,
            summary: "Collects samples to train a fusion network: image, stereo, monocular depth and trusted stereo.",
            doc: "\
All maps are brought to `size` by area. Disparities become shares of the image's width; a cell has the mean of its \
valid pixels. A sample also has the share of each cell where stereo is valid, and where the right view agrees.\n\n\
The target is trusted stereo: `target` where it is valid, otherwise `consistent`. Give `target` a matcher that sees \
more than `disparity` does, for example one with more disparities: the network then learns where the range of \
`disparity` is too small.\n\n\
No ground truth is used. A frame without any target is skipped.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The left image, grey or RGB, no smaller than `size`."),
                Port::frame("disparity", ValueType::Disparity, "Stereo, as the network will see it."),
                Port::frame(
                    "consistent",
                    ValueType::Disparity,
                    "`disparity` where the right view agrees: `disparity/left-right`.",
                ),
                Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid."),
                Port::frame("weight", ValueType::Weight, "Confidence in stereo, `W_c`, in [0, 1]."),
                Port::frame("calibration", ValueType::Calibration, "Focal length and baseline."),
                Port::frame("target", ValueType::Disparity, "Trusted stereo; `consistent` if it is not connected.")
                    .optional(),
            ],
            outputs: vec![Port::once("samples", ValueType::Samples, "All samples, in the order of the frames.")],
        }
    }

    fn check(params: &FusionSamplesParams) -> Result<(), (&'static str, String)> {
        let FusionSamplesParams { size, least_disparity, coverage, .. } = params;
        if size.iter().any(|side| !(1..=4096).contains(side)) {
            return Err(("size", format!("size is {size:?}, whose sides are not in 1..=4096")));
        }
        if !(0.0..=2048.0).contains(least_disparity) {
            return Err(("least_disparity", format!("least_disparity is {least_disparity} px, not in 0..=2048")));
        }
        if !(0.0..=1.0).contains(coverage) {
            return Err(("coverage", format!("coverage is {coverage}, which is not in 0..=1")));
        }
        Ok(())
    }

    fn build(params: FusionSamplesParams) -> Result<Instance, Fault> {
        let bound = (params.memory_mb as usize).saturating_mul(1 << 20);
        let rule = Rule { least_disparity_px: params.least_disparity, coverage: params.coverage };
        let (maps, spool) = (Maps::default(), Spool::new(bound));
        Ok(Instance::Ordered(Box::new(Self { size: params.size, rule, maps, spool, count: 0 })))
    }
}

impl CollectFusionSamples {
    pub(crate) const KIND: &str = "learn/fusion-samples";

    const fn form(&self) -> Form {
        Form { width: self.size[0], height: self.size[1], has_right: false, has_cells: true }
    }

    /// The frame as a sample; `None` if it has no target.
    fn sample(&mut self, frame: &Frame, inputs: &Inputs<'_>) -> Result<Option<Sample>, Fault> {
        let image = inputs.get::<Image>("image")?;
        let (consistent, mono) = (inputs.get::<Disparity>("consistent")?, inputs.get::<Depth>("mono")?);
        let (stereo, weight) = (inputs.get::<Disparity>("disparity")?, inputs.get::<Weight>("weight")?);
        let target = inputs.optional::<Disparity>("target")?.unwrap_or(consistent);
        same_size(image, "disparity", stereo.sixteenths_px.dimensions())?;
        same_size(image, "consistent", consistent.sixteenths_px.dimensions())?;
        same_size(image, "mono", mono.metres.dimensions())?;
        same_size(image, "weight", weight.share.dimensions())?;
        same_size(image, "target", target.sixteenths_px.dimensions())?;
        let planes = small(self.size, "image", image)?;
        let (width, height) = image.dimensions();
        let scale = depth_scale(inputs.get::<Calibration>("calibration")?, width)?;
        let (columns, rows) = (self.size[0] as usize, self.size[1] as usize);
        let share = self.maps.target(target, None, self.rule, columns, rows);
        if share.iter().all(|share| share.is_nan()) {
            return Ok(None);
        }
        let shares = |disparity: &Disparity| -> Vec<f32> {
            // Disparities that are not above 0 are invalid or infinitely far.
            let share = |&fixed: &i16| if fixed > 0 { f32::from(fixed) / 16.0 / width as f32 } else { f32::NAN };
            disparity.sixteenths_px.iter().map(share).collect()
        };
        let mono: Vec<f32> = mono.metres.iter().map(|&metres| scale as f32 / metres).collect();
        let maps =
            FrameMaps { stereo: &shares(stereo), consistent: &shares(consistent), mono: &mono, weight: &weight.share };
        let cells = cells(&maps, (width as usize, height as usize), (columns, rows));
        Ok(Some(Sample {
            id: frame.id.to_string(),
            image: planes,
            right: None,
            share,
            depth_scale: Some(scale),
            cells: Some(cells.iter().map(cell_bytes).collect()),
        }))
    }
}

impl OrderedNode for CollectFusionSamples {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        if let Some(sample) = self.sample(frame, inputs)? {
            let form = self.form();
            self.spool.append(|out| form.append(&sample, out)).map_err(unwritten)?;
            self.count += 1;
        }
        Ok(Outputs::none())
    }

    fn finish(mut self: Box<Self>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let header = self.form().header(self.count);
        let samples = Artifact::samples(self.spool.bytes(&header).map_err(unwritten)?);
        Ok(Outputs::one("samples", Value::Samples(samples.into())))
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::contracts::InlineHost;
    use depthloom_graphs::values::{Calibration, Depth, Disparity, Image, Pixels, Raster, Weight};
    use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Node, Scratch, Value, ValueType};
    use half::f16;
    use image::{Luma, RgbImage};

    use super::{CollectFusionSamples, FusionSamplesParams};
    use crate::samples::Samples;

    const WIDTH: u32 = 16;
    const HEIGHT: u32 = 8;

    /// Left half and right half, px.
    fn disparity(left: i16, right: i16) -> Value {
        let px = |x: u32| if x < WIDTH / 2 { left } else { right };
        let sixteenths_px = Raster::from_fn(WIDTH, HEIGHT, |x, _| Luma([px(x) * 16]));
        Disparity { sixteenths_px, min_disparity_px: 0 }.into()
    }

    fn collect(change: impl Fn(&str) -> Option<Value>, has_target: bool) -> Result<Samples, Fault> {
        let params = FusionSamplesParams { size: [4, 2], ..FusionSamplesParams::default() };
        let Instance::Ordered(mut node) = CollectFusionSamples::build(params)? else { panic!("frames in order") };
        let ports = CollectFusionSamples::declaration().inputs;
        let mut scratch = Scratch::default();
        let calibration = Calibration {
            width: WIDTH,
            height: HEIGHT,
            focal_px: 32.0,
            cx_px: 8.0,
            cy_px: 4.0,
            baseline_m: 0.5,
            doffs_px: 0.0,
        };
        let usual = |port: &str| match port {
            "image" => {
                let image = RgbImage::from_raw(WIDTH, HEIGHT, vec![7; (WIDTH * HEIGHT * 3) as usize]).unwrap();
                Some(Image::new(Pixels::Rgb(image)).into())
            }
            "disparity" => Some(disparity(4, -1)),
            "consistent" => Some(disparity(-1, -1)),
            "target" => has_target.then(|| disparity(4, 8)),
            "mono" => Some(Depth { metres: Raster::from_pixel(WIDTH, HEIGHT, Luma([8.0])) }.into()),
            "weight" => Some(Weight { share: Raster::from_pixel(WIDTH, HEIGHT, Luma([0.6])) }.into()),
            "calibration" => Some(Value::Calibration(calibration.clone().into())),
            other => panic!("nothing is wired to {other}"),
        };
        let values: Vec<_> = ports.iter().map(|port| change(port.name).or_else(|| usual(port.name))).collect();
        let frame = Frame::at_10_hz("seven", 7);
        node.process(&frame, &Inputs::new(&ports, &values), &mut Context::new(&InlineHost, &mut scratch))?;
        let outputs = node.finish(&mut Context::new(&InlineHost, &mut scratch))?;
        let outputs = outputs.in_order_of(&CollectFusionSamples::declaration().outputs)?;
        let [Some(Value::Samples(samples))] = outputs.as_slice() else { panic!("samples") };
        Ok(Samples::decode(&samples.bytes).unwrap())
    }

    #[test]
    fn a_frame_becomes_a_sample_with_its_cells() {
        let found = collect(|_| None, true).unwrap();
        let sample = &found.items[0];
        assert_eq!((found.width, found.height, sample.depth_scale), (4, 2, Some(1.0)));
        assert_eq!(sample.image, [7; 24]);
        let halves = |left: f32, right: f32| [left, left, right, right].repeat(2);
        let shares: Vec<f32> = sample.share.iter().map(|share| share.to_f32()).collect();
        assert_eq!(shares, halves(4.0 / 16.0, 8.0 / 16.0));
        for (cell, left) in sample.cells.as_ref().unwrap().iter().zip([true, true, false, false].repeat(2)) {
            let half = |share: f32| f16::from_f32(share).to_le_bytes();
            let ([s0, s1], [m0, m1]) = (half(if left { 0.25 } else { 0.0 }), half(1.0 / 8.0));
            assert_eq!(*cell, [s0, s1, m0, m1, if left { 255 } else { 0 }, 0, 153]);
        }
    }

    #[test]
    fn without_a_target_it_is_what_the_right_view_confirms() {
        assert!(collect(|_| None, false).unwrap().items.is_empty());
        let confirmed = |port: &str| (port == "consistent").then(|| disparity(4, -1));
        let found = collect(confirmed, false).unwrap();
        assert_eq!(found.items[0].share[0].to_f32(), 0.25);
        assert!(found.items[0].share[3].is_nan());
    }

    #[test]
    fn sizes_that_differ_are_reported() {
        let small =
            |port: &str| (port == "mono").then(|| Depth { metres: Raster::from_pixel(WIDTH, 7, Luma([8.0])) }.into());
        let what = collect(small, true).unwrap_err().chain();
        assert_eq!(what, "`image` is 16x8 and `mono` is 16x7: they must have the same size");
    }

    #[test]
    fn no_port_takes_ground_truth() {
        for port in CollectFusionSamples::declaration().inputs {
            assert_ne!(port.value_type, ValueType::TrueDisparity, "{}", port.name);
            assert!(port.value_type != ValueType::Depth || port.name == "mono", "{}", port.name);
        }
    }
}
