//! Grey from colour, with OpenCV's weights.

use crate::raster::check;
use crate::simd::{Level, Pass, grey_from_leading};

/// Grey of an interleaved RGB image, as OpenCV's `cvtColor` gives it:
/// `(9798 R + 19235 G + 3735 B + 16384) >> 15`, exactly.
///
/// `rgb` has three samples a pixel, `out` one.
pub fn grey_from_rgb(rgb: &[u8], width: usize, height: usize, out: &mut [u8]) {
    grey_from_rgb_at(Level::best(), rgb, width, height, out);
}

pub(crate) fn grey_from_rgb_at(level: Level, rgb: &[u8], width: usize, height: usize, out: &mut [u8]) {
    check("rgb", rgb.len(), width, height, 3);
    check("grey", out.len(), width, height, 1);
    let done = grey_from_leading(level, rgb, out);
    level.run(Grey { rgb: &rgb[3 * done..], out: &mut out[done..] });
}

struct Grey<'a> {
    rgb: &'a [u8],
    out: &'a mut [u8],
}

impl Pass for Grey<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (grey, rgb) in self.out.iter_mut().zip(self.rgb.as_chunks::<3>().0) {
            let [r, g, b] = rgb.map(u32::from);
            *grey = ((9798 * r + 19235 * g + 3735 * b + 16384) >> 15) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    #[test]
    fn primaries_black_and_white_have_opencvs_values() {
        // cv2.cvtColor(..., cv2.COLOR_RGB2GRAY) of these six pixels.
        let rgb = [0, 0, 0, 255, 255, 255, 255, 0, 0, 0, 255, 0, 0, 0, 255, 12, 200, 77];
        let grey = every_level(|level| {
            let mut grey = [0; 6];
            grey_from_rgb_at(level, &rgb, 3, 2, &mut grey);
            grey
        });
        assert_eq!(grey, [0, 255, 76, 150, 29, 130]);
    }

    #[test]
    fn every_level_gives_the_same_grey_at_every_length() {
        for pixels in 0..200 {
            let rgb: Vec<u8> = (0..3 * pixels).map(|i| (i * i * 31 + i * 7) as u8).collect();
            every_level(|level| {
                let mut grey = vec![0; pixels];
                grey_from_rgb_at(level, &rgb, pixels, 1, &mut grey);
                grey
            });
        }
    }
}
