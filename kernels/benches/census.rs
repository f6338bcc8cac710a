//! Census stereo at KITTI's size: features, paths, disparities, every implementation of this machine, one thread and two.
//!
//! `cargo bench -p depthloom-kernels --bench census`. The images are random texture, the right one shifted: the work does not
//! depend on what they show.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use depthloom_kernels::census::{Census, Pair, Params, Path, Paths, Scratch, compute_on};
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
    let mut frame = |path: Path, params: &Params, tiles: &dyn Tiles| {
        let pair = Pair { left: &left, right: &right, width: WIDTH, height: HEIGHT };
        compute_on(path, &pair, params, &mut scratch, tiles, &mut out).expect("parameters are legal");
        black_box(&out);
    };
    for disparities in [64, 128] {
        for (census, paths) in
            [(Census::Symmetric, Paths::Eight), (Census::Symmetric, Paths::Four), (Census::Full, Paths::Eight)]
        {
            let params = Params { disparities, census, paths, ..Params::default() };
            let mut group = c.benchmark_group(format!("census {census:?} {paths:?} {disparities}"));
            group.sample_size(10).throughput(Throughput::Elements((WIDTH * HEIGHT) as u64));
            for path in Path::available().into_iter().filter(|&path| path != Path::Plain) {
                group.bench_function(BenchmarkId::new("1 thread", format!("{path:?}")), |b| {
                    b.iter(|| frame(path, &params, &Serial));
                });
            }
            let crew = Crew::new(2);
            std::thread::scope(|scope| {
                let _closing = crew.closing();
                scope.spawn(|| crew.work());
                group.bench_function(BenchmarkId::new("2 threads", "best"), |b| {
                    b.iter(|| frame(Path::available()[0], &params, &crew));
                });
            });
        }
    }
}

criterion_group!(benches, stereo);
criterion_main!(benches);
