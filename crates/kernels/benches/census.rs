//! Census stereo at KITTI's size: features, paths, disparities, every implementation of this machine, one thread and
//! two.
//!
//! `cargo bench -p depthloom-kernels --bench census`. The images are random texture, the right one shifted: the work
//! does not depend on what they show.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::census::{Census, CensusScratch, Pair, Params, compute_at};
use depthloom_kernels::simd::Level;
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use support::{HEIGHT, WIDTH, texture};

mod support;

fn stereo(c: &mut Criterion) {
    let (left, right) = texture();
    let mut scratch = CensusScratch::default();
    let mut out = vec![0; WIDTH * HEIGHT];
    let mut frame = |level: Level, params: &Params, tiles: &dyn Tiles| {
        let pair = Pair { left: &left, right: &right, width: WIDTH, height: HEIGHT };
        compute_at(level, &pair, params, &mut scratch, tiles, &mut out).expect("parameters are legal");
        black_box(&out);
    };
    for disparities in [64, 128] {
        for (census, paths) in [(Census::Symmetric, 8), (Census::Symmetric, 4), (Census::Full, 8)] {
            let params = Params { disparities, census, paths, ..Params::default() };
            let mut group = c.benchmark_group(format!("census {census:?} {paths:?} {disparities}"));
            group.sample_size(10).throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
            for level in Level::available() {
                group.bench_function(BenchmarkId::new("1 thread", level.name()), |b| {
                    b.iter(|| frame(level, &params, &Serial));
                });
            }
            let budget = Budget::new(2);
            let _own = budget.permit();
            group.bench_function(BenchmarkId::new("2 threads", "best"), |b| {
                b.iter(|| frame(Level::best(), &params, &budget));
            });
        }
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
