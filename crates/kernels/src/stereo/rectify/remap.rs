//! Pixels taken from where a map says.

use super::map::{Map, Places, STEPS};
use crate::raster::check;
use crate::simd::{Level, Pass};

/// An image of (width, height) with `CHANNELS` interleaved samples a pixel, seen through a map: linear between four
/// pixels; what lies outside counts as black. OpenCV's `remap` with `INTER_LINEAR` and `BORDER_CONSTANT`.
pub fn remap<const CHANNELS: usize>(image: &[u8], (width, height): (usize, usize), map: &Map, out: &mut [u8]) {
    remap_at::<CHANNELS>(Level::best(), image, (width, height), map, out);
}

fn remap_at<const CHANNELS: usize>(
    level: Level,
    image: &[u8],
    (width, height): (usize, usize),
    map: &Map,
    out: &mut [u8],
) {
    check("image", image.len(), width, height, CHANNELS);
    check("rectified", out.len(), map.size.0, map.size.1, CHANNELS);
    let image = Image::<CHANNELS> { pixels: image.as_chunks().0, width, height };
    let out = out.as_chunks_mut().0;
    match &map.places {
        Places::Float(places) => level.run(Floats { image, places, out }),
        Places::Fixed(places) => level.run(Fixed { image, places, out }),
    }
}

#[derive(Clone, Copy)]
struct Image<'a, const CHANNELS: usize> {
    pixels: &'a [[u8; CHANNELS]],
    width: usize,
    height: usize,
}

/// Pixels that are done together: their samples are gathered one by one, and mixed in vectors.
const BLOCK: usize = 64;

/// The four pixels about each place of a block, each channel by itself.
type Gathered<const CHANNELS: usize> = [[[u8; BLOCK]; 4]; CHANNELS];

impl<const CHANNELS: usize> Image<'_, CHANNELS> {
    /// Puts the pixel, its right neighbour, and those below at place `at` of a block; black where they are outside.
    #[inline(always)]
    fn gather(&self, column: i32, row: i32, at: usize, into: &mut Gathered<CHANNELS>) {
        // As numbers without a sign those left of and above the image are far beyond it.
        let (x, y) = (column as u32 as usize, row as u32 as usize);
        let four = if x < self.width.saturating_sub(1) && y < self.height.saturating_sub(1) {
            let [above, below] = [y, y + 1].map(|y| &self.pixels[y * self.width + x..][..2]);
            [above[0], above[1], below[0], below[1]]
        } else {
            self.four_at_the_border(column, row)
        };
        for (channel, into) in into.iter_mut().enumerate() {
            for (pixel, into) in four.iter().zip(into) {
                into[at] = pixel[channel];
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn four_at_the_border(&self, column: i32, row: i32) -> [[u8; CHANNELS]; 4] {
        let inside = |from: i32, step: i32, count: usize| {
            let at = i64::from(from) + i64::from(step);
            (at >= 0 && at < count as i64).then_some(at as usize)
        };
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
            let at = inside(column, right, self.width).zip(inside(row, down, self.height));
            at.map_or([0; CHANNELS], |(x, y)| self.pixels[y * self.width + x])
        })
    }
}

/// Puts what was mixed of a channel into the pixels of a block.
#[inline(always)]
fn scatter<const CHANNELS: usize>(mixed: &[u8; BLOCK], channel: usize, out: &mut [[u8; CHANNELS]]) {
    for (out, mixed) in out.iter_mut().zip(mixed) {
        out[channel] = *mixed;
    }
}

struct Floats<'a, const CHANNELS: usize> {
    image: Image<'a, CHANNELS>,
    places: &'a [[f32; 2]],
    out: &'a mut [[u8; CHANNELS]],
}

impl<const CHANNELS: usize> Pass for Floats<'_, CHANNELS> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (mut whole, mut share) = ([[0_i32; BLOCK]; 2], [[0.0_f32; BLOCK]; 2]);
        let mut gathered: Gathered<CHANNELS> = [[[0; BLOCK]; 4]; CHANNELS];
        for (out, places) in self.out.chunks_mut(BLOCK).zip(self.places.chunks(BLOCK)) {
            for (axis, (whole, share)) in whole.iter_mut().zip(&mut share).enumerate() {
                for ((whole, share), place) in whole.iter_mut().zip(share).zip(places) {
                    // Saturates: what lies nowhere is far outside.
                    let towards_zero = place[axis] as i32;
                    *whole = towards_zero.saturating_sub(i32::from(place[axis] < towards_zero as f32));
                    // Far outside only black is mixed, whatever the weights; a weight of NaN
                    // would make it white.
                    let over = place[axis] - *whole as f32;
                    *share = if (0.0..1.0).contains(&over) { over } else { 0.0 };
                }
            }
            for (at, (column, row)) in whole[0].iter().zip(&whole[1]).take(places.len()).enumerate() {
                self.image.gather(*column, *row, at, &mut gathered);
            }
            for (channel, four) in gathered.iter().enumerate() {
                let mut mixed = [0; BLOCK];
                for (at, mixed) in mixed.iter_mut().enumerate() {
                    let [a, b, c, d] = [four[0][at], four[1][at], four[2][at], four[3][at]].map(f32::from);
                    let (right, down) = (share[0][at], share[1][at]);
                    let (above, below) = (a + right * (b - a), c + right * (d - c));
                    // The last bits of a number beyond 2^23 are whole ones: rounded, half to even.
                    *mixed = (above + down * (below - above) + 8_388_608.0_f32).to_bits() as u8;
                }
                scatter(&mixed, channel, out);
            }
        }
    }
}

struct Fixed<'a, const CHANNELS: usize> {
    image: Image<'a, CHANNELS>,
    places: &'a [[i32; 2]],
    out: &'a mut [[u8; CHANNELS]],
}

impl<const CHANNELS: usize> Pass for Fixed<'_, CHANNELS> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut share = [[0_i32; BLOCK]; 2];
        let mut gathered: Gathered<CHANNELS> = [[[0; BLOCK]; 4]; CHANNELS];
        for (out, places) in self.out.chunks_mut(BLOCK).zip(self.places.chunks(BLOCK)) {
            for (at, place) in places.iter().enumerate() {
                let [column, row] = place.map(|at| at.div_euclid(STEPS));
                [share[0][at], share[1][at]] = place.map(|at| at.rem_euclid(STEPS));
                self.image.gather(column, row, at, &mut gathered);
            }
            for (channel, four) in gathered.iter().enumerate() {
                let mut mixed = [0; BLOCK];
                for (at, mixed) in mixed.iter_mut().enumerate() {
                    let [a, b, c, d] = [four[0][at], four[1][at], four[2][at], four[3][at]].map(i32::from);
                    let (right, down) = (share[0][at], share[1][at]);
                    let (above, below) = (a * (STEPS - right) + b * right, c * (STEPS - right) + d * right);
                    let sum = above * (STEPS - down) + below * down;
                    *mixed = ((sum + STEPS * STEPS / 2) / (STEPS * STEPS)) as u8;
                }
                scatter(&mixed, channel, out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Map, Places, remap_at};
    use crate::simd::every_level;

    fn seen(places: Places) -> Vec<u8> {
        let image = [10, 20, 30, 40, 50, 60];
        let count = match &places {
            Places::Float(of) => of.len(),
            Places::Fixed(of) => of.len(),
        };
        let map = Map { size: (count, 1), places };
        every_level(|level| {
            let mut out = vec![9; count];
            remap_at::<1>(level, &image, (3, 2), &map, &mut out);
            out
        })
    }

    #[test]
    fn between_pixels_is_linear_and_outside_is_black() {
        let (far, nowhere) = (1e30, f32::INFINITY);
        let places = [
            [0.0, 0.0],
            [1.5, 0.0],
            [0.25, 0.5],
            [2.0, 1.0],
            [2.5, 1.0],
            [-0.5, 0.0],
            [-1.0, 0.0],
            [2.0, 1.5],
            [3.0, 0.0],
            [far, 0.0],
            [-far, 0.0],
            [nowhere, nowhere],
            [-nowhere, 1.0],
            [f32::NAN, f32::NAN],
        ];
        let expected = [10, 25, 28, 60, 30, 5, 0, 30, 0, 0, 0, 0, 0];
        let found = seen(Places::Float(places.to_vec()));
        assert_eq!(found[..13], expected);
        let fixed = places[..9].iter().map(|place| place.map(|at| (at * 32.0) as i32)).collect();
        // 27.5 is 28 here too, by rounding up.
        assert_eq!(seen(Places::Fixed(fixed)), expected[..9]);
        assert_eq!(seen(Places::Fixed(vec![[i32::MIN, 0], [i32::MAX, 0], [0, i32::MAX]])), [0; 3]);
    }
}
