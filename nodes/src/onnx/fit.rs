//! Brings a frame's images to the size of a network, and its maps back to the size of the images.

use depthloom_graphs::Fault;
use depthloom_kernels::memory::{TooMuch, zeros};
use depthloom_kernels::resize::bilinear_f32;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How images are brought to the network's size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Fit {
    /// Rows and columns are added before and removed after: no pixel is changed.
    #[default]
    Pad,
    /// Images are resized, and maps are resized back; disparities are scaled with the width.
    Resize,
}

/// Where rows and columns are added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PadAt {
    /// Below and to the right.
    #[default]
    BottomRight,
    /// Above and to the right (PSMNet and its successors).
    TopRight,
    /// Above and to the left.
    TopLeft,
    /// Half on each side, the odd one below or to the right (RAFT-Stereo).
    Centre,
}

/// Value of added pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PadWith {
    /// The nearest pixel of the image.
    #[default]
    Edge,
    /// Zeros, in the normalised image.
    Zero,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// px, if the network fixes it.
    pub width: Option<usize>,
    /// px, if the network fixes it.
    pub height: Option<usize>,
    /// Open sides are rounded up to a multiple of this, px.
    pub multiple: usize,
    /// Of a network that leaves both sides open, the side to whose length images are resized.
    pub side: Option<Side>,
}

/// The side of an image that gets a length, px; the other side follows from the aspect ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Short(usize),
    Long(usize),
}

impl Side {
    /// Columns and rows of an image of (columns, rows), each the nearest multiple: as the transforms of MiDaS and Depth
    /// Anything (`lower_bound` and `upper_bound`) compute it.
    fn size(self, (width, height): (usize, usize), multiple: usize) -> (usize, usize) {
        let (Self::Short(length) | Self::Long(length)) = self;
        let scales = (length as f64 / width as f64, length as f64 / height as f64);
        let scale = match self {
            Self::Short(_) => scales.0.max(scales.1),
            Self::Long(_) => scales.0.min(scales.1),
        };
        let rounded = |side: usize| {
            let exact = side as f64 * scale / multiple as f64;
            let nearest = exact.round_ties_even() as usize * multiple;
            let allowed = match self {
                Self::Short(_) if nearest < length => exact.ceil() as usize * multiple,
                Self::Long(_) if nearest > length => exact.floor() as usize * multiple,
                _ => nearest,
            };
            allowed.max(multiple)
        };
        (rounded(width), rounded(height))
    }
}

/// Maps a frame's size to the network's and back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fitted {
    /// Columns and rows of the frame's images.
    pub from: (usize, usize),
    /// Columns and rows of what the network sees.
    pub to: (usize, usize),
    fit: Fit,
    /// Column and row of the image's first pixel in the padded image.
    at: (usize, usize),
}

impl Fitted {
    pub(crate) fn new(from: (usize, usize), sizes: Sizes, fit: Fit, pad_at: PadAt) -> Result<Self, Fault> {
        let up = |side: usize, fixed: Option<usize>| fixed.unwrap_or_else(|| side.next_multiple_of(sizes.multiple));
        let to = match (sizes.side, sizes.width, sizes.height) {
            (Some(side), None, None) => side.size(from, sizes.multiple),
            _ => (up(from.0, sizes.width), up(from.1, sizes.height)),
        };
        let at = match fit {
            Fit::Resize => (0, 0),
            Fit::Pad => {
                let (Some(wide), Some(high)) = (to.0.checked_sub(from.0), to.1.checked_sub(from.1)) else {
                    return Err(Fault::new(format!(
                        "the network takes images of {}x{}, and these are {}x{}",
                        to.0, to.1, from.0, from.1
                    ))
                    .remedy("resize them: `fit: resize`; or export the network with an open size"));
                };
                match pad_at {
                    PadAt::BottomRight => (0, 0),
                    PadAt::TopRight => (0, high),
                    PadAt::TopLeft => (wide, high),
                    PadAt::Centre => (wide / 2, high / 2),
                }
            }
        };
        Ok(Self { from, to, fit, at })
    }

    pub(crate) const fn pixels(&self) -> usize {
        self.to.0 * self.to.1
    }

    fn is_same(&self) -> bool {
        self.from == self.to
    }

    pub(crate) fn resizes(&self) -> bool {
        self.fit == Fit::Resize && !self.is_same()
    }

    pub(crate) fn pads(&self) -> bool {
        self.fit == Fit::Pad && !self.is_same()
    }

    /// Converts a horizontal length from the network's pixels to the image's.
    pub(crate) fn columns_back(&self, length: f64) -> f64 {
        if self.resizes() { length * self.from.0 as f64 / self.to.0 as f64 } else { length }
    }

    /// Adds rows and columns to a plane of the image's size. Not for planes that are resized.
    pub(crate) fn padded(&self, plane: &[f32], with: PadWith) -> Result<Vec<f32>, TooMuch> {
        let ((width, height), (columns, rows), (left, top)) = (self.from, self.to, self.at);
        let mut out = zeros::<f32>(columns * rows)?;
        for (row, line) in out.chunks_exact_mut(columns).enumerate() {
            let inside = row.checked_sub(top).filter(|row| *row < height);
            let nearest = row.saturating_sub(top).min(height - 1);
            let of_image = &plane[nearest * width..][..width];
            match (inside, with) {
                (None, PadWith::Zero) => {}
                (Some(_), PadWith::Zero) => line[left..left + width].copy_from_slice(of_image),
                (_, PadWith::Edge) => {
                    line[..left].fill(of_image[0]);
                    line[left..left + width].copy_from_slice(of_image);
                    line[left + width..].fill(of_image[width - 1]);
                }
            }
        }
        Ok(out)
    }

    pub(crate) fn map_there(&self, plane: &[f32], with: PadWith) -> Result<Vec<f32>, TooMuch> {
        if self.is_same() {
            return Ok(plane.to_vec());
        }
        match self.fit {
            Fit::Pad => self.padded(plane, with),
            Fit::Resize => {
                let mut out = zeros::<f32>(self.pixels())?;
                bilinear_f32(plane, self.from.0, self.from.1, self.to.0, self.to.1, &mut out);
                Ok(out)
            }
        }
    }

    /// Resizes a network's map (bilinear, half-pixel centres) to its input's size, then crops or resizes it to the
    /// image's. A result pixel that depends on a non-finite value is not finite.
    pub(crate) fn map_back(&self, mut map: Vec<f32>, size: (usize, usize)) -> Result<Vec<f32>, TooMuch> {
        if self.resizes() {
            // From a map's own size in one step.
            return resized(&mut map, size, self.from);
        }
        let map = if size == self.to { map } else { resized(&mut map, size, self.to)? };
        if self.is_same() {
            return Ok(map);
        }
        let ((width, height), (left, top)) = (self.from, self.at);
        let rows = map.chunks_exact(self.to.0).skip(top).take(height);
        Ok(rows.flat_map(|row| &row[left..left + width]).copied().collect())
    }
}

/// A result pixel that depends on a non-finite value is NaN.
fn resized(map: &mut [f32], from: (usize, usize), to: (usize, usize)) -> Result<Vec<f32>, TooMuch> {
    let mut out = zeros::<f32>(to.0 * to.1)?;
    if from == to {
        out.copy_from_slice(map);
        return Ok(out);
    }
    if map.iter().all(|value| value.is_finite()) {
        bilinear_f32(map, from.0, from.1, to.0, to.1, &mut out);
    } else {
        resize_answers(map, from, to, &mut out);
    }
    Ok(out)
}

fn resize_answers(
    map: &mut [f32],
    (from_width, from_height): (usize, usize),
    (width, height): (usize, usize),
    out: &mut [f32],
) {
    let gaps: Vec<f32> = map.iter().map(|value| f32::from(u8::from(!value.is_finite()))).collect();
    map.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
    bilinear_f32(map, from_width, from_height, width, height, out);
    let mut share_of_gaps = vec![0.0; out.len()];
    bilinear_f32(&gaps, from_width, from_height, width, height, &mut share_of_gaps);
    for (value, share) in out.iter_mut().zip(share_of_gaps) {
        if share > 0.0 {
            *value = f32::NAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Fit, Fitted, PadAt, PadWith, Side, Sizes};

    const OPEN: Sizes = Sizes { width: None, height: None, multiple: 4, side: None };

    fn fitted(pad_at: PadAt) -> Fitted {
        Fitted::new((3, 2), OPEN, Fit::Pad, pad_at).expect("it fits")
    }

    #[test]
    fn padding_repeats_the_nearest_pixel_and_is_removed() {
        let plane = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let (a, b) = ([1.0, 2.0, 3.0, 3.0], [4.0, 5.0, 6.0, 6.0]);
        let left = ([1.0, 1.0, 2.0, 3.0], [4.0, 4.0, 5.0, 6.0]);
        for (pad_at, expected) in [
            (PadAt::BottomRight, [a, b, b, b]),
            (PadAt::TopRight, [a, a, a, b]),
            (PadAt::TopLeft, [left.0, left.0, left.0, left.1]),
            (PadAt::Centre, [a, a, b, b]),
        ] {
            let fitted = fitted(pad_at);
            let padded = fitted.padded(&plane, PadWith::Edge).expect("memory");
            assert_eq!(padded, expected.as_flattened(), "{pad_at:?}");
            assert_eq!(fitted.map_back(padded, (4, 4)).expect("memory"), plane, "{pad_at:?}");
        }
        let zero = fitted(PadAt::TopLeft).padded(&plane, PadWith::Zero).expect("memory");
        assert_eq!(zero[..9], [0.0; 9]);
        assert_eq!(zero[9..], [1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn an_image_that_is_too_large_is_refused_unless_it_is_resized() {
        let small = Sizes { width: Some(2), height: Some(2), multiple: 1, side: None };
        assert!(Fitted::new((3, 2), small, Fit::Pad, PadAt::Centre).is_err());
        let resized = Fitted::new((3, 2), small, Fit::Resize, PadAt::Centre).expect("it fits");
        assert_eq!((resized.to, resized.columns_back(2.0)), ((2, 2), 3.0));
    }

    /// `get_size` of `Resize` in `depth_anything_v2/util/transform.py`, with NumPy.
    #[test]
    fn sides_are_those_of_the_published_transforms() {
        let cases = [
            (Side::Short(518), 14, (1242, 375), (1722, 518)),
            (Side::Short(518), 14, (640, 480), (686, 518)),
            (Side::Short(518), 14, (480, 640), (518, 686)),
            (Side::Short(518), 14, (1920, 1080), (924, 518)),
            (Side::Short(518), 14, (518, 518), (518, 518)),
            (Side::Short(518), 14, (287, 93), (1596, 518)),
            (Side::Short(384), 32, (1242, 375), (1280, 384)),
            (Side::Short(384), 32, (640, 480), (512, 384)),
            (Side::Short(384), 32, (480, 640), (384, 512)),
            (Side::Short(384), 32, (1920, 1080), (672, 384)),
            (Side::Short(384), 32, (518, 518), (384, 384)),
            (Side::Short(384), 32, (287, 93), (1184, 384)),
            (Side::Long(384), 32, (1242, 375), (384, 128)),
            (Side::Long(384), 32, (640, 480), (384, 288)),
            (Side::Long(384), 32, (480, 640), (288, 384)),
            (Side::Long(384), 32, (1920, 1080), (384, 224)),
            (Side::Long(384), 32, (518, 518), (384, 384)),
            (Side::Long(384), 32, (287, 93), (384, 128)),
            (Side::Long(256), 32, (1242, 375), (256, 64)),
            (Side::Long(256), 32, (640, 480), (256, 192)),
            (Side::Long(256), 32, (480, 640), (192, 256)),
            (Side::Long(256), 32, (1920, 1080), (256, 128)),
            (Side::Long(256), 32, (518, 518), (256, 256)),
            (Side::Long(256), 32, (287, 93), (256, 96)),
            (Side::Short(500), 14, (1242, 375), (1652, 504)),
            (Side::Short(500), 14, (640, 480), (672, 504)),
            (Side::Short(500), 14, (480, 640), (504, 672)),
            (Side::Short(500), 14, (1920, 1080), (882, 504)),
            (Side::Short(500), 14, (518, 518), (504, 504)),
            (Side::Short(500), 14, (287, 93), (1540, 504)),
        ];
        for (side, multiple, from, expected) in cases {
            let sizes = Sizes { width: None, height: None, multiple, side: Some(side) };
            let fitted = Fitted::new(from, sizes, Fit::Resize, PadAt::Centre).expect("it fits");
            assert_eq!(fitted.to, expected, "{side:?} {multiple} {from:?}");
        }
    }

    #[test]
    fn a_small_map_is_enlarged_to_the_input_of_the_network() {
        // Half the size: a linear slope stays linear, except at the edges.
        let fitted = Fitted::new((4, 4), OPEN, Fit::Pad, PadAt::Centre).expect("it fits");
        let map = fitted.map_back(vec![0.0, 2.0, 0.0, 2.0], (2, 2)).expect("memory");
        assert_eq!(map[..4], [0.0, 0.5, 1.5, 2.0]);
    }
}
