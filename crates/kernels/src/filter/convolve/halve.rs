//! The maximum of 2x2 samples, with its gradient.
//!
//! Where two samples are equally large the first has the gradient, as in PyTorch; which it was is seen again from image
//! and output, so nothing but these is kept.

use super::ImageGradient;
use super::planes::Planes;
use crate::simd::{Level, Pass};

/// The largest of every 2x2 samples; sides are even. `planes` are the image's, the output's have half the sides.
///
/// # Panics
/// If a side is odd, or memory is not that of the planes.
pub fn halve(level: Level, planes: &Planes, image: &[f32], out: &mut [f32]) {
    let half = half_of(planes);
    assert_eq!(image.len() / planes.plane(), out.len() / half.plane());
    level.run(Halve { planes, half: &half, image, out });
}

/// The gradient of the image, from that of the output.
///
/// # Panics
/// As [`halve`].
pub fn halve_back(
    level: Level,
    planes: &Planes,
    image: &[f32],
    out: &[f32],
    slopes: &[f32],
    gradient: &mut ImageGradient<'_>,
) {
    let half = half_of(planes);
    assert_eq!(image.len() / planes.plane(), out.len() / half.plane());
    assert!(image.len() == gradient.planes.len() && out.len() == slopes.len());
    level.run(Back { planes, half: &half, image, out, slopes, add: gradient.add, gradient: gradient.planes });
}

fn half_of(planes: &Planes) -> Planes {
    let (width, height) = (planes.width(), planes.height());
    assert!(width.is_multiple_of(2) && height.is_multiple_of(2), "{width}x{height} samples cannot be halved");
    planes.resized(width / 2, height / 2)
}

struct Halve<'a> {
    planes: &'a Planes,
    half: &'a Planes,
    image: &'a [f32],
    out: &'a mut [f32],
}

impl Pass for Halve<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { planes, half, image, out } = self;
        for channel in 0..out.len() / half.plane() {
            for y in 0..half.height() {
                let [above, below] = pair(planes, channel, y).map(|at| &image[at..][..planes.width()]);
                let (above, below) = (above.as_chunks::<2>().0, below.as_chunks::<2>().0);
                let out = &mut out[half.origin(channel) + y * half.row()..][..half.width()];
                for ((out, above), below) in out.iter_mut().zip(above).zip(below) {
                    *out = larger(larger(above[0], above[1]), larger(below[0], below[1]));
                }
            }
        }
    }
}

/// Where the two rows of a pair begin.
#[inline(always)]
fn pair(planes: &Planes, channel: usize, y: usize) -> [usize; 2] {
    let above = planes.origin(channel) + 2 * y * planes.row();
    [above, above + planes.row()]
}

/// Without a branch; networks hold no NaN, and one that does has diverged anyway.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a >= b { a } else { b }
}

struct Back<'a> {
    planes: &'a Planes,
    half: &'a Planes,
    image: &'a [f32],
    out: &'a [f32],
    slopes: &'a [f32],
    add: bool,
    gradient: &'a mut [f32],
}

impl Pass for Back<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { planes, half, image, out, slopes, add, gradient } = self;
        for channel in 0..out.len() / half.plane() {
            for y in 0..half.height() {
                let at = pair(planes, channel, y);
                let [above, below] = at.map(|at| image[at..][..planes.width()].as_chunks::<2>().0);
                let (upper, lower) = gradient[at[0]..at[1] + planes.width()].split_at_mut(planes.row());
                let upper = upper[..planes.width()].as_chunks_mut::<2>().0;
                let lower = lower.as_chunks_mut::<2>().0;
                let place = half.origin(channel) + y * half.row();
                let (out, slopes) = (&out[place..][..half.width()], &slopes[place..][..half.width()]);
                let samples = above.iter().zip(below).zip(out.iter().zip(slopes));
                for ((upper, lower), ((above, below), (&most, &slope))) in upper.iter_mut().zip(lower).zip(samples) {
                    let first = above[0] == most;
                    let second = !first & (above[1] == most);
                    let third = !first & !second & (below[0] == most);
                    let fourth = !first & !second & !third & (below[1] == most);
                    let share = |taken: bool| if taken { slope } else { 0.0 };
                    let (top, bottom) = ([share(first), share(second)], [share(third), share(fourth)]);
                    if add {
                        *upper = [upper[0] + top[0], upper[1] + top[1]];
                        *lower = [lower[0] + bottom[0], lower[1] + bottom[1]];
                    } else {
                        (*upper, *lower) = (top, bottom);
                    }
                }
            }
        }
    }
}
