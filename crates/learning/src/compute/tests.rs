//! The CPU against the library, on whole networks.

use burn::tensor::Device;
use depthloom_random::SplitMix64;

use super::{Input, cpu, library};
use crate::networks::{Architecture, FusionUnet, Monocular, Network, ParameterLayout, Size, layout};

const SIZE: Size = Size { width: 64, height: 32 };

fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| random.unit()).collect()
}

fn batch(network: impl Architecture, count: usize) -> Input {
    let planes = network.interface().planes;
    let shape = [count, planes, SIZE.height, SIZE.width];
    Input { values: noise(3, shape.iter().product()), shape }
}

/// Weights that let something through to the end.
fn parameters(layout: &ParameterLayout) -> Vec<Vec<f32>> {
    let mut parameters = layout.start(7);
    parameters.iter_mut().step_by(2).flatten().for_each(|weight| *weight *= 1.5);
    parameters
}

type GradientsAndMaps = (Vec<Option<Vec<f32>>>, Vec<f32>);

/// Gradients and maps; the slopes are noise.
fn with_noise(maps: &[f32]) -> (Vec<f32>, Vec<f32>) {
    (noise(5, maps.len()).into_iter().map(|slope| slope - 0.5).collect(), maps.to_vec())
}

fn on_cpu(network: impl Architecture, layout: &ParameterLayout, count: usize) -> GradientsAndMaps {
    cpu::Engine::new(network, layout).gradients(&batch(network, count), &parameters(layout), with_noise)
}

fn agree(network: impl Architecture) {
    let layout = layout(network, SIZE);
    let (gradients, maps) = on_cpu(network, &layout, 3);
    let mut theirs = library::Engine::on(Device::flex(), network, &layout);
    let (expected, expected_maps) = theirs.gradients(&batch(network, 3), &parameters(&layout), with_noise);
    let close = |ours: &[f32], theirs: &[f32], what: &str| {
        assert_eq!(ours.len(), theirs.len());
        let largest = theirs.iter().fold(1e-6_f32, |largest, value| largest.max(value.abs()));
        for (at, (a, b)) in ours.iter().zip(theirs).enumerate() {
            assert!((a - b).abs() <= 2e-3 * largest, "{} {what}[{at}]: {a} where {b} is right", network.name());
        }
    };
    close(&maps, &expected_maps, "maps");
    for ((ours, theirs), parameter) in gradients.iter().zip(&expected).zip(&layout.parameters) {
        assert_eq!(ours.is_some(), theirs.is_some(), "{}", parameter.name);
        if let (Some(ours), Some(theirs)) = (ours, theirs) {
            assert!(ours.iter().any(|&value| value != 0.0), "{} has no gradient", parameter.name);
            close(ours, theirs, &parameter.name);
        }
    }
}

#[test]
fn maps_and_gradients_are_the_librarys() {
    agree(Network::UnetLite.without_spread());
    agree(Monocular { network: Network::UnetTiny, spread: true });
    agree(Network::FcnLite.without_spread());
    agree(Network::EigenCoarse.without_spread());
    agree(FusionUnet);
}

#[test]
fn frozen_layers_have_no_gradient_and_let_it_pass() {
    agree(Network::FcnVgg16.without_spread());
}

#[test]
fn neither_threads_nor_earlier_batches_change_a_bit() {
    let network = Monocular { network: Network::UnetTiny, spread: true };
    let layout = layout(network, SIZE);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| on_cpu(network, &layout, 5))
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(run(threads) == one, "{threads} threads gave other bits");
    }
    let mut engine = cpu::Engine::new(network, &layout);
    engine.gradients(&batch(network, 8), &noise_parameters(&layout), with_noise);
    engine.maps(&batch(network, 2), &noise_parameters(&layout));
    let wide = Size { width: 128, height: 64 };
    let other = Input { values: noise(1, 3 * 128 * 64), shape: [1, 3, wide.height, wide.width] };
    engine.gradients(&other, &noise_parameters(&layout), with_noise);
    assert!(engine.gradients(&batch(network, 5), &parameters(&layout), with_noise) == one);
    assert!(engine.maps(&batch(network, 5), &parameters(&layout)) == one.1);
}

fn noise_parameters(layout: &ParameterLayout) -> Vec<Vec<f32>> {
    layout.parameters.iter().map(|parameter| noise(11, parameter.len())).collect()
}

#[test]
fn the_librarys_version_is_that_of_the_lock_file() {
    let (name, version) = library::VERSION.split_once(' ').unwrap();
    let locked = include_str!("../../../../Cargo.lock");
    assert!(locked.contains(&format!("name = \"{name}\"\nversion = \"{version}\"\n")), "{name} {version}");
}
