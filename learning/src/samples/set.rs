//! Training samples in memory.

use half::f16;

/// Training samples of one size.
///
/// Equality is that of the encoded bytes, so that pixels without target (NaN) are equal to each other.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Columns of the network's image, px.
    pub width: u32,
    /// Rows of the network's image, px.
    pub height: u32,
    /// Whether every sample has a right image; without, none has.
    pub has_right: bool,
    /// The samples in the order of their frames.
    pub items: Vec<Sample>,
}

/// A frame as a network is taught it.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// The frame's own name, e.g. `000150_10`; frames of joined sources may share one.
    pub id: String,
    /// The left image, 3 x height x width: the planes of red, green and blue, 0 to 255.
    pub image: Vec<u8>,
    /// The right image, likewise.
    pub right: Option<Vec<u8>>,
    /// The target, height x width: disparity as a share of the image's width, above 0; NaN = no target.
    pub share: Vec<f16>,
    /// `f * B / width`, metres: depth is this over the share. `None` without calibration.
    pub depth_scale: Option<f64>,
}

impl Samples {
    /// How many samples there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Pixels of an image.
    #[must_use]
    pub const fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether every sample can be taught as depth in metres.
    #[must_use]
    pub fn has_depth_scale(&self) -> bool {
        self.items.iter().all(|sample| sample.depth_scale.is_some())
    }
}

impl PartialEq for Samples {
    fn eq(&self, other: &Self) -> bool {
        let same_form = (self.width, self.height, self.has_right) == (other.width, other.height, other.has_right);
        same_form && self.items == other.items
    }
}

impl PartialEq for Sample {
    fn eq(&self, other: &Self) -> bool {
        let same_share = |(a, b): (&f16, &f16)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        (&self.id, &self.image, &self.right) == (&other.id, &other.image, &other.right)
            && self.depth_scale == other.depth_scale
            && self.share.len() == other.share.len()
            && self.share.iter().zip(&other.share).all(same_share)
    }
}
