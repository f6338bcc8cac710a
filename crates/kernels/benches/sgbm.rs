//! Stereo at KITTI's size: every mode, every implementation of this machine, one thread and two.
//!
//! `cargo bench -p depthloom-kernels --bench sgbm`. The images are random texture, the right one shifted: the work does
//! not depend on what they show. `bench/stereo.sh` compares with OpenCV on real frames.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::sgbm::{Mode, Params, Path, SgbmScratch, View, compute_on};
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use support::{HEIGHT, WIDTH, texture};

mod support;

fn match_frame(
    path: Path,
    params: &Params,
    images: &(Vec<u8>, Vec<u8>),
    state: &mut (SgbmScratch, Vec<i16>),
    tiles: &dyn Tiles,
) {
    let view = |data| View { data, width: WIDTH, height: HEIGHT, channels: 1 };
    let (scratch, out) = state;
    compute_on(path, &view(&images.0), &view(&images.1), params, scratch, tiles, out).expect("parameters are legal");
    black_box(out);
}

fn stereo(c: &mut Criterion) {
    let images = texture();
    let mut state = (SgbmScratch::default(), vec![0; WIDTH * HEIGHT]);
    for (name, mode) in [("sgbm", Mode::Sgbm), ("hh", Mode::Hh), ("3way", Mode::ThreeWay), ("hh4", Mode::Hh4)] {
        let mut group = c.benchmark_group(name);
        group.sample_size(10).throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
        let params = Params { mode, ..Params::default() };
        for path in Path::available() {
            group.bench_function(BenchmarkId::new("1 thread", path.name()), |b| {
                b.iter(|| match_frame(path, &params, &images, &mut state, &Serial));
            });
        }
        let budget = Budget::new(2);
        let _own = budget.permit();
        group.bench_function(BenchmarkId::new("2 threads", "best"), |b| {
            b.iter(|| match_frame(Path::best(), &params, &images, &mut state, &budget));
        });
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
