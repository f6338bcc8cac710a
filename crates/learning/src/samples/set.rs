//! Training samples in memory, as tests make them and look at them.

use half::f16;

use super::format::{DecodeError, Form};
use super::sample::Sample;
use super::view::{SampleView, SamplesView};

/// Training samples of one size.
///
/// Equality is that of the encoded bytes, so that pixels without target (NaN) are equal to each other.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Whether every sample has a right image; without, none has.
    pub(crate) has_right: bool,
    pub(crate) items: Vec<Sample>,
}

impl Samples {
    /// The samples as bytes; equal samples give equal bytes.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let form = Form {
            width: self.width,
            height: self.height,
            has_right: self.has_right,
            has_cells: self.items.iter().any(|sample| sample.cells.is_some()),
        };
        let mut out = form.header(self.items.len() as u64).to_vec();
        for sample in &self.items {
            form.append(sample, &mut out);
        }
        out
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let SamplesView { form, items } = SamplesView::read(bytes)?;
        let items = items.into_iter().map(SampleView::to_sample).collect();
        Ok(Self { width: form.width, height: form.height, has_right: form.has_right, items })
    }
}

impl SampleView<'_> {
    fn to_sample(self) -> Sample {
        Sample {
            id: self.id.to_owned(),
            image: self.image.to_vec(),
            right: self.right.map(<[u8]>::to_vec),
            share: self.shares().collect(),
            depth_scale: self.depth_scale,
            cells: self.cells.map(<[_]>::to_vec),
        }
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
            && (self.depth_scale, &self.cells) == (other.depth_scale, &other.cells)
            && self.share.len() == other.share.len()
            && self.share.iter().zip(&other.share).all(same_share)
    }
}
