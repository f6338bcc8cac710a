//! Stereo at KITTI's size: every mode, every implementation of this machine, one thread and two.
//!
//! `cargo bench -p depthloom-kernels --bench sgbm`. The images are random texture, the right one shifted: the work does
//! not depend on what they show. `bench/stereo.sh` compares with OpenCV on real frames.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::sgbm::{Maps, Mode, Params, Path, SgbmScratch, View, compute_maps};
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use support::{HEIGHT, WIDTH, texture};

mod support;

fn match_frame(
    path: Path,
    params: &Params,
    images: &(Vec<u8>, Vec<u8>),
    state: &mut State,
    further: [bool; 2],
    tiles: &dyn Tiles,
) {
    let view = |data| View { data, width: WIDTH, height: HEIGHT, channels: 1 };
    let State { scratch, disparity, right, ambiguity } = state;
    let maps = Maps { disparity, right: further[0].then_some(right), ambiguity: further[1].then_some(ambiguity) };
    compute_maps(path, &view(&images.0), &view(&images.1), params, scratch, tiles, maps).expect("parameters are legal");
    black_box(disparity);
}

#[derive(Default)]
struct State {
    scratch: SgbmScratch,
    disparity: Vec<i16>,
    right: Vec<i16>,
    ambiguity: Vec<f32>,
}

fn stereo(c: &mut Criterion) {
    let images = texture();
    let (map, ambiguity) = (vec![0; WIDTH * HEIGHT], vec![0.0; WIDTH * HEIGHT]);
    let mut state = State { disparity: map.clone(), right: map, ambiguity, ..State::default() };
    for (name, mode) in [("sgbm", Mode::Sgbm), ("hh", Mode::Hh), ("3way", Mode::ThreeWay), ("hh4", Mode::Hh4)] {
        let mut group = c.benchmark_group(name);
        group.sample_size(10).throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
        let params = Params { mode, ..Params::default() };
        for path in Path::available() {
            group.bench_function(BenchmarkId::new("1 thread", path.name()), |b| {
                b.iter(|| match_frame(path, &params, &images, &mut state, [false; 2], &Serial));
            });
        }
        let options =
            [("extend_left", true, [false; 2]), ("right", false, [true, false]), ("ambiguity", false, [false, true])];
        for (option, extend_left, further) in options {
            let params = Params { extend_left, ..params.clone() };
            group.bench_function(BenchmarkId::new("1 thread", option), |b| {
                b.iter(|| match_frame(Path::best(), &params, &images, &mut state, further, &Serial));
            });
        }
        let budget = Budget::new(2);
        let _own = budget.permit();
        group.bench_function(BenchmarkId::new("2 threads", "best"), |b| {
            b.iter(|| match_frame(Path::best(), &params, &images, &mut state, [false; 2], &budget));
        });
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
