//! Block matching at KITTI's size: two blocks, the best implementation of this machine, one thread and two.
//!
//! `cargo bench -p depthloom-kernels --bench bm`. The images are random texture, the right one shifted: the work does
//! not depend on what they show. `DEPTHLOOM_SIMD` holds the instruction set down; `bench/stereo.sh` compares with
//! OpenCV on real frames.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::bm::{BmScratch, Params, compute};
use depthloom_kernels::tiles::{Serial, Tiles};
use depthloom_threads::Budget;
use support::{HEIGHT, WIDTH, texture};

mod support;

fn stereo(c: &mut Criterion) {
    let (left, right) = texture();
    let mut scratch = BmScratch::default();
    let mut out = vec![0; WIDTH * HEIGHT];
    let mut frame = |params: &Params, tiles: &dyn Tiles| {
        compute(&left, &right, WIDTH, HEIGHT, params, &mut scratch, tiles, &mut out).expect("parameters are legal");
        black_box(&out);
    };
    for disparities in [64, 128] {
        for block in [9, 21] {
            let params = Params { disparities, block, ..Params::default() };
            let mut group = c.benchmark_group(format!("bm block {block} {disparities}"));
            group.sample_size(10).throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
            group.bench_function(BenchmarkId::new("1 thread", "best"), |b| b.iter(|| frame(&params, &Serial)));
            let budget = Budget::new(2);
            let _own = budget.permit();
            group.bench_function(BenchmarkId::new("2 threads", "best"), |b| b.iter(|| frame(&params, &budget)));
        }
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
