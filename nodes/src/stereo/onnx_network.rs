//! A stereo network, loaded: which inputs take which image, and one run over the views of a frame.

use depthloom_graphs::Fault;
use depthloom_graphs::values::{Artifact, Image};

use super::onnx_params::{PairOrder, StereoOnnxParams};
use crate::onnx::{self, Axes, Fitted, Maps, PoolInput, Pools, Preprocessing, Sizes};

pub(super) struct View<'a> {
    pub first: &'a Image,
    pub second: &'a Image,
    pub mirrored: bool,
}

pub(super) struct PairNetwork {
    params: StereoOnnxParams,
    /// Planes of one image.
    planes: usize,
    sizes: Sizes,
    /// One input for both images, or one per image.
    pools: Pools,
}

impl PairNetwork {
    /// Loads the model at once if its inputs fix the size.
    pub(super) fn load(model: &Artifact, params: &StereoOnnxParams) -> Result<Self, Fault> {
        let declared = onnx::declared(model, params.provider)?;
        let names: Vec<&str> = declared.inputs.iter().map(|input| input.name.as_str()).collect();
        let named = [params.left_name.as_deref(), params.right_name.as_deref()];
        let chosen: Vec<&str> = match (named, &names[..]) {
            ([Some(left), Some(right)], _) => vec![left, right],
            ([None, None], [one]) => vec![*one],
            ([Some(one), None] | [None, Some(one)], [_]) => vec![one],
            ([None, None], [left, right]) => vec![*left, *right],
            _ => {
                return Err(Fault::new(format!("the network has the inputs {}", names.join(", ")))
                    .remedy("set `left_name` and `right_name`; use `onnx` for a network with other inputs"));
            }
        };
        let outlet = |name: &&str| onnx::outlet("input", &declared.inputs, Some(name));
        let found: Vec<_> = chosen.iter().map(outlet).collect::<Result<_, _>>()?;
        let axes: Vec<Axes> = found.iter().map(|input| onnx::planes(input, params.layout)).collect::<Result<_, _>>()?;
        let planes = planes_of(&chosen, &axes)?;
        let named: Vec<(&str, Axes)> = chosen.iter().copied().zip(axes.iter().copied()).collect();
        let sizes = onnx::sizes(&named, params.size, params.multiple)?;
        let output = onnx::map_output(&declared.outputs, params.output_name.as_deref(), (sizes.width, sizes.height))?;
        let batch = onnx::batch(&named, output, 1 + usize::from(params.right_view))?;
        let per_input = if named.len() == 1 { 2 * planes } else { planes };
        let inputs = named
            .into_iter()
            .map(|(name, axes)| PoolInput { name: name.to_owned(), axes, images: batch, planes: per_input })
            .collect();
        let pools = Pools::new(model, (params.provider, params.threads), inputs, vec![output.name.clone()]);
        pools.load_fixed(sizes)?;
        Ok(Self { params: params.clone(), planes, sizes, pools })
    }

    pub(super) fn fitted(&self, from: (usize, usize)) -> Result<Fitted, Fault> {
        Fitted::new(from, self.sizes, self.params.fit, self.params.pad_at)
    }

    pub(super) fn run(
        &self,
        views: &[View<'_>],
        fitted: &Fitted,
        preprocessing: &Preprocessing,
    ) -> Result<Vec<Maps>, Fault> {
        let (pool, inputs) = (self.pools.get(fitted.to)?, &self.pools.inputs);
        let batch = inputs[0].images;
        let mut maps = Vec::with_capacity(views.len());
        for views in views.chunks(batch) {
            let mut tensors: Vec<Vec<f32>> = vec![Vec::new(); inputs.len()];
            for view in views {
                let planes = |image: &Image| {
                    preprocessing
                        .planes(image, self.planes, fitted, view.mirrored)
                        .map_err(|error| Fault::new(error.to_string()))
                };
                let (mut first, mut second) = (planes(view.first)?, planes(view.second)?);
                if let [tensor] = &mut tensors[..] {
                    if self.params.order == PairOrder::RightLeft {
                        std::mem::swap(&mut first, &mut second);
                    }
                    first.append(&mut second);
                    inputs[0].axes.laid_out(&first, tensor);
                } else {
                    inputs[0].axes.laid_out(&first, &mut tensors[0]);
                    inputs[1].axes.laid_out(&second, &mut tensors[1]);
                }
            }
            let tensors: Vec<&[f32]> = tensors.iter().map(Vec::as_slice).collect();
            let Some(given) = pool.run(&tensors)?.pop() else { continue };
            let found =
                onnx::map_of(given, &self.pools.outputs[0], (batch, fitted.to), self.params.head, self.params.layout)?;
            let pixels = found.size.0 * found.size.1;
            let map = |map: &[f32]| Maps { values: map.to_vec(), size: found.size };
            maps.extend(found.values.chunks_exact(pixels).map(map));
        }
        Ok(maps)
    }
}

/// 3 or 1. An open number is read as 3.
fn planes_of(names: &[&str], axes: &[Axes]) -> Result<usize, Fault> {
    let wrong = |name: &str, channels: usize, wanted: &str| {
        Err(Fault::new(format!("input `{name}` of the network takes {channels} channels, expected {wanted}"))
            .remedy("see `layout`; use `onnx` for a network with other inputs"))
    };
    match axes {
        [both] => match both.channels {
            None | Some(6) => Ok(3),
            Some(2) => Ok(1),
            Some(other) => wrong(names[0], other, "6 or 2 (two images)"),
        },
        _ => {
            let channels = |axes: &Axes| axes.channels.unwrap_or(3);
            match axes
                .iter()
                .zip(names)
                .find(|(one, _)| ![1, 3].contains(&channels(one)) || channels(one) != channels(&axes[0]))
            {
                Some((other, name)) => wrong(name, channels(other), "1 or 3 in both inputs"),
                None => Ok(channels(&axes[0])),
            }
        }
    }
}
