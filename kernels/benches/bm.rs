//! Block matching at KITTI's size: two blocks, the best implementation of this machine, one thread and two.
//!
//! `cargo bench -p depthloom-kernels --bench bm`. The images are random texture, the right one shifted: the work does not
//! depend on what they show. `DEPTHLOOM_SIMD` holds the instruction set down; `bench/stereo.sh` compares with OpenCV on real
//! frames.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::bm::{Params, Scratch, compute};
use depthloom_kernels::tiles::{Crew, Serial, Tiles};

const WIDTH: usize = 1242;
const HEIGHT: usize = 375;

fn texture() -> (Vec<u8>, Vec<u8>) {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let left: Vec<u8> = std::iter::repeat_with(|| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 56) as u8
    })
    .take(WIDTH * HEIGHT)
    .collect();
    let right = (0..left.len()).map(|i| left[(i + 20) % left.len()]).collect();
    (left, right)
}

fn stereo(c: &mut Criterion) {
    let (left, right) = texture();
    let mut scratch = Scratch::default();
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
            let crew = Crew::new(2);
            std::thread::scope(|scope| {
                let _closing = crew.closing();
                scope.spawn(|| crew.work());
                group.bench_function(BenchmarkId::new("2 threads", "best"), |b| b.iter(|| frame(&params, &crew)));
            });
        }
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
