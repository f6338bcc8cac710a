//! Networks on the CPU.

use std::sync::{Arc, Mutex};

use depthloom_kernels::convolve::{
    Gradients, ImageGradient, LayerScratch, Planes, before_activation, halve, halve_back,
};
use depthloom_kernels::simd::Level;
use depthloom_threads::locked;
use rayon::prelude::*;

use super::Input;
use super::plan::{Kind, Operation, Place, Plan};
use crate::networks::{Architecture, Parameter, ParameterLayout, Size};

/// Computes a network for images of any size.
#[derive(Debug)]
pub(crate) struct Engine<A> {
    network: A,
    layout: Arc<ParameterLayout>,
    level: Level,
    /// One for each size of images that was seen.
    sizes: Vec<(Size, SizedNetwork)>,
}

/// A network for images of one size.
#[derive(Debug)]
struct SizedNetwork {
    plan: Plan,
    /// The values of each image of the last batch.
    images: Vec<ImageValues>,
    /// What threads work with.
    workers: Mutex<Vec<Worker>>,
}

#[derive(Debug)]
struct ImageValues {
    buffers: Vec<Vec<f32>>,
    /// The image's share of the gradients of all learned parameters.
    shares: Vec<f32>,
}

#[derive(Debug, Default)]
struct Worker {
    scratch: LayerScratch,
    /// Gradients of the values.
    slopes: Vec<Vec<f32>>,
}

impl<A: Architecture> Engine<A> {
    pub(crate) fn new(network: A, layout: &ParameterLayout) -> Self {
        Self { network, layout: Arc::new(layout.clone()), level: Level::best(), sizes: Vec::new() }
    }

    /// The maps of a batch, batch x maps x rows x columns in [0, 1], with parameters in the order of the layout.
    pub(crate) fn maps(&mut self, input: &Input, parameters: &[Vec<f32>]) -> Vec<f32> {
        self.forward(input, parameters, false)
    }

    /// The maps of a batch, and the gradients of the learned parameters for the gradient of the maps that `slopes`
    /// makes of them.
    pub(crate) fn gradients<T>(
        &mut self,
        input: &Input,
        parameters: &[Vec<f32>],
        slopes: impl FnOnce(&[f32]) -> (Vec<f32>, T),
    ) -> (Vec<Option<Vec<f32>>>, T) {
        let maps = self.forward(input, parameters, true);
        let (slopes, more) = slopes(&maps);
        (self.backward(input, &slopes), more)
    }

    fn sized(&mut self, [_, _, height, width]: [usize; 4]) -> &mut SizedNetwork {
        let size = Size { width, height };
        let found = self.sizes.iter().position(|(of, _)| *of == size).unwrap_or_else(|| {
            let plan = Plan::new(self.network, size, &self.layout);
            self.sizes.push((size, SizedNetwork { plan, images: Vec::new(), workers: Mutex::default() }));
            self.sizes.len() - 1
        });
        &mut self.sizes[found].1
    }

    fn forward(&mut self, input: &Input, parameters: &[Vec<f32>], backward: bool) -> Vec<f32> {
        let level = self.level;
        let SizedNetwork { plan, images, workers } = self.sized(input.shape);
        for operation in &mut plan.operations {
            if let Kind::Layer { layer, weights, .. } = &mut operation.kind {
                layer.pack(level, &parameters[*weights], backward && operation.gradient.is_some());
            }
        }
        let [batch, planes, height, width] = input.shape;
        while images.len() < batch {
            let buffers = plan.buffers.iter().map(|&samples| vec![0.0; samples]).collect();
            images.push(ImageValues { buffers, shares: Vec::new() });
        }
        let area: usize = plan.maps.iter().map(Place::len).sum();
        let mut maps = vec![0.0; batch * area];
        let compute = |maps: &mut [f32], samples: &[f32], image: &mut ImageValues| {
            with_worker(workers, |worker| {
                let place = &plan.image;
                place.planes.spread(samples, &mut image.buffers[place.buffer][place.samples()]);
                for operation in &plan.operations {
                    operation.forward(level, parameters, &mut image.buffers, &mut worker.scratch);
                }
            });
            let mut rest = maps;
            for map in &plan.maps {
                let (to, others) = rest.split_at_mut(map.len());
                map.planes.collect(&image.buffers[map.buffer][map.samples()], to);
                rest = others;
            }
        };
        if let ([image], true) = (images.as_mut_slice(), batch == 1) {
            // On the caller's thread: one image is one task, whatever threads there are.
            compute(&mut maps, &input.values, image);
            return maps;
        }
        let places = maps.par_chunks_exact_mut(area).zip(input.values.par_chunks_exact(planes * height * width));
        places.zip(images).with_max_len(1).for_each(|((maps, samples), image)| compute(maps, samples, image));
        maps
    }

    fn backward(&mut self, input: &Input, slopes: &[f32]) -> Vec<Option<Vec<f32>>> {
        let (level, layout) = (self.level, Arc::clone(&self.layout));
        // Where each learned parameter's gradient lies among those of an image.
        let mut total = 0;
        let starts: Vec<Option<usize>> = layout
            .parameters
            .iter()
            .map(|parameter| {
                (!parameter.frozen).then(|| {
                    total += parameter.len();
                    total - parameter.len()
                })
            })
            .collect();
        let batch = input.shape[0];
        let SizedNetwork { plan, images, workers } = self.sized(input.shape);
        let images = &mut images[..batch];
        images.par_iter_mut().zip(slopes.par_chunks_exact(slopes.len() / batch)).with_max_len(1).for_each(
            |(image, slopes)| {
                with_worker(workers, |worker| {
                    image.shares.resize(total, 0.0);
                    if worker.slopes.is_empty() {
                        worker.slopes = plan.buffers.iter().map(|&samples| vec![0.0; samples]).collect();
                    }
                    let mut rest = slopes;
                    for map in &plan.maps {
                        let (from, others) = rest.split_at(map.len());
                        map.planes.spread(from, &mut worker.slopes[map.buffer][map.samples()]);
                        rest = others;
                    }
                    for operation in plan.operations.iter().rev() {
                        operation.backward(level, &layout, &starts, image, worker);
                    }
                });
            },
        );
        let (first, rest) = images.split_first().expect("a batch has images");
        let gradient = |(start, parameter): (&Option<usize>, &Parameter)| {
            let at = start.map(|start| start..start + parameter.len())?;
            let mut sum = first.shares[at.clone()].to_vec();
            for image in rest {
                sum.iter_mut().zip(&image.shares[at.clone()]).for_each(|(sum, share)| *sum += share);
            }
            Some(sum)
        };
        starts.par_iter().zip(&layout.parameters).map(gradient).collect()
    }
}

fn with_worker<T>(workers: &Mutex<Vec<Worker>>, f: impl FnOnce(&mut Worker) -> T) -> T {
    let mut worker = locked(workers).pop().unwrap_or_default();
    let result = f(&mut worker);
    locked(workers).push(worker);
    result
}

/// The planes of two places, the second to write.
fn two<'a>(buffers: &'a mut [Vec<f32>], read: &Place, write: &Place) -> (&'a [f32], &'a mut [f32]) {
    let disjoint = "an operation does not write what it reads";
    if read.buffer == write.buffer {
        let [a, b] = buffers[read.buffer].get_disjoint_mut([read.samples(), write.samples()]).expect(disjoint);
        return (a, b);
    }
    let [a, b] = buffers.get_disjoint_mut([read.buffer, write.buffer]).expect(disjoint);
    (&a[read.samples()], &mut b[write.samples()])
}

impl Operation {
    fn forward(&self, level: Level, parameters: &[Vec<f32>], buffers: &mut [Vec<f32>], scratch: &mut LayerScratch) {
        let (x, out) = two(buffers, &self.x, &self.out);
        match &self.kind {
            Kind::Layer { layer, weights, .. } => layer.forward(level, x, &parameters[weights + 1], out, scratch),
            Kind::Halve => halve(level, &self.x.planes, x, out),
            Kind::Sigmoid => each_sample(&self.out.planes, x, out, sigmoid),
            Kind::AsMap => same_samples([&self.x.planes, &self.out.planes], x, out, false),
        }
    }

    /// The gradients of x and of the parameters, from that of the output.
    fn backward(
        &self,
        level: Level,
        layout: &ParameterLayout,
        starts: &[Option<usize>],
        image: &mut ImageValues,
        worker: &mut Worker,
    ) {
        if self.gradient.is_none() && !matches!(self.kind, Kind::Layer { learned: true, .. }) {
            return; // Nothing that is learned decides it.
        }
        let Worker { scratch, slopes } = worker;
        let ImageValues { buffers, shares } = image;
        let (x, out) = (&buffers[self.x.buffer][self.x.samples()], &buffers[self.out.buffer][self.out.samples()]);
        if let Kind::Layer { layer, .. } = &self.kind {
            let slopes = &mut slopes[self.out.buffer][self.out.samples()];
            before_activation(level, layer.activation(), &self.out.planes, out, slopes);
        }
        let (slopes, gradient) = match self.gradient {
            Some(add) => {
                let (slopes, planes) = two(slopes, &self.out, &self.x);
                (slopes, Some(ImageGradient { planes, add }))
            }
            None => (&slopes[self.out.buffer][self.out.samples()], None),
        };
        match (&self.kind, gradient) {
            (Kind::Layer { layer, weights, learned }, image) => {
                let (mut of_weights, mut of_bias) = (None, None);
                if *learned {
                    let start = starts[*weights].expect("a learned parameter has a gradient");
                    let count = layout.parameters[*weights].len();
                    let (first, rest) = shares[start..].split_at_mut(count);
                    of_weights = Some(first);
                    of_bias = Some(&mut rest[..layout.parameters[*weights + 1].len()]);
                }
                let mut gradients = Gradients { image, weights: of_weights, bias: of_bias };
                layer.backward(level, x, slopes, &mut gradients, scratch);
            }
            (_, None) => {}
            (Kind::Halve, Some(mut gradient)) => halve_back(level, &self.x.planes, x, out, slopes, &mut gradient),
            (Kind::Sigmoid, Some(gradient)) => {
                // Between the rows the slopes are 0.
                let of_x = slopes.iter().zip(out).map(|(slope, out)| slope * out * (1.0 - out));
                for (sample, of_x) in gradient.planes.iter_mut().zip(of_x) {
                    *sample = if gradient.add { *sample + of_x } else { of_x };
                }
            }
            (Kind::AsMap, Some(gradient)) => {
                same_samples([&self.out.planes, &self.x.planes], slopes, gradient.planes, gradient.add);
            }
        }
    }
}

/// `f` of every sample; the zeros between the rows stay.
fn each_sample(planes: &Planes, from: &[f32], to: &mut [f32], f: impl Fn(f32) -> f32) {
    let mut samples = vec![0.0; from.len() / planes.plane() * planes.width() * planes.height()];
    planes.collect(from, &mut samples);
    samples.iter_mut().for_each(|sample| *sample = f(*sample));
    planes.spread(&samples, to);
}

/// Copies or adds the samples of planes to others, which have as many.
fn same_samples([source, target]: [&Planes; 2], from: &[f32], to: &mut [f32], add: bool) {
    let mut samples = vec![0.0; from.len() / source.plane() * source.width() * source.height()];
    source.collect(from, &mut samples);
    if add {
        let mut before = samples.clone();
        target.collect(to, &mut before);
        samples.iter_mut().zip(before).for_each(|(sample, before)| *sample += before);
    }
    target.spread(&samples, to);
}

/// `1 / (1 + exp(-x))` without overflow.
fn sigmoid(x: f32) -> f32 {
    if x >= 0.0 {
        1.0 / (1.0 + (-x).exp())
    } else {
        let e = x.exp();
        e / (1.0 + e)
    }
}
