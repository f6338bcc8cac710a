//! Samples as bytes: version 1 of the format, little-endian throughout.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `DLSAMPLE` |
//! | 4 | version, 1 |
//! | 4 | flags: bit 0, every sample has a right image; bit 1, every sample has cells for fusion; the others are 0 |
//! | 4 + 4 | columns and rows, px |
//! | 8 | number of samples |
//!
//! Then each sample:
//!
//! | bytes | what |
//! |---|---|
//! | 4 + n | length of the frame's id, and the id (UTF-8) |
//! | 8 | `f * B / width`, metres (f64); NaN without calibration |
//! | 3 x rows x columns | left image, the planes of red, green and blue |
//! | 3 x rows x columns | right image likewise, if flagged |
//! | 2 x rows x columns | disparity as a share of the image's width (IEEE half, above 0); NaN = no target |
//! | 7 x rows x columns | if flagged: stereo and the monocular estimate as such shares (IEEE half, 0 = invalid), then the |
//! | | shares of the cell where stereo is valid and where the right view agrees, and confidence (0 to 255 each) |
//!
//! A number that is "none" is always the same NaN, so equal samples are equal bytes.

use half::f16;

use super::sample::{CELL_LEN, Sample};

pub(super) const MAGIC: [u8; 8] = *b"DLSAMPLE";
pub(super) const VERSION: u32 = 1;
pub(super) const FLAG_RIGHT: u32 = 1;
pub(super) const FLAG_CELLS: u32 = 2;
/// The largest side of an image, px: more is a damaged file.
pub(super) const LARGEST_SIDE: u32 = 1 << 14;
/// Bytes before the first sample.
pub(super) const HEADER_LEN: usize = 32;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum DecodeError {
    /// The bytes begin otherwise.
    #[error("not training samples: the bytes do not begin with `DLSAMPLE`")]
    Magic,
    #[error("training samples of version {0} are not supported (expected {VERSION}): collect them again")]
    Version(u32),
    #[error("training samples with the unknown flags {0:#x}")]
    Flags(u32),
    #[error("training samples of {width}x{height} px: sides are 1 to {LARGEST_SIDE}")]
    Size { width: u32, height: u32 },
    #[error("training samples are cut off in sample {sample} of {count}")]
    CutOff { sample: u64, count: u64 },
    #[error("{0} bytes follow the last training sample")]
    Trailing(usize),
    #[error("the id of training sample {0} is not UTF-8")]
    Id(u64),
    #[error("training sample {sample} has {what} that is not above 0")]
    Value { sample: u64, what: &'static str },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) has_right: bool,
    pub(super) has_cells: bool,
}

impl Form {
    pub(super) const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    pub(super) const fn sample_len(self) -> usize {
        let (right, cells) = (if self.has_right { 3 } else { 0 }, if self.has_cells { CELL_LEN } else { 0 });
        4 + 8 + self.pixels() * (3 + right + 2 + cells)
    }

    pub(super) fn header(self, count: u64) -> [u8; HEADER_LEN] {
        let mut header = [0; HEADER_LEN];
        let flags = if self.has_right { FLAG_RIGHT } else { 0 } | if self.has_cells { FLAG_CELLS } else { 0 };
        header[..8].copy_from_slice(&MAGIC);
        header[8..12].copy_from_slice(&VERSION.to_le_bytes());
        header[12..16].copy_from_slice(&flags.to_le_bytes());
        header[16..20].copy_from_slice(&self.width.to_le_bytes());
        header[20..24].copy_from_slice(&self.height.to_le_bytes());
        header[24..].copy_from_slice(&count.to_le_bytes());
        header
    }

    pub(super) fn append(self, sample: &Sample, out: &mut Vec<u8>) {
        let pixels = self.pixels();
        assert_eq!(sample.image.len(), 3 * pixels, "the image has the samples' size");
        assert_eq!(sample.right.as_ref().map(Vec::len), self.has_right.then_some(3 * pixels), "all or none is right");
        assert_eq!(sample.share.len(), pixels, "the target has the samples' size");
        assert_eq!(sample.cells.as_ref().map(Vec::len), self.has_cells.then_some(pixels), "all or none has cells");
        let id_len = u32::try_from(sample.id.len()).expect("an id is short");
        out.reserve(self.sample_len() + sample.id.len());
        out.extend_from_slice(&id_len.to_le_bytes());
        out.extend_from_slice(sample.id.as_bytes());
        out.extend_from_slice(&sample.depth_scale.unwrap_or(f64::NAN).to_le_bytes());
        out.extend_from_slice(&sample.image);
        out.extend_from_slice(sample.right.as_deref().unwrap_or_default());
        for share in &sample.share {
            let share = if share.is_nan() { f16::NAN } else { *share };
            out.extend_from_slice(&share.to_le_bytes());
        }
        out.extend_from_slice(sample.cells.as_deref().unwrap_or_default().as_flattened());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Samples;
    use proptest::collection::vec;
    use proptest::prelude::*;

    fn sample(form: Form) -> impl Strategy<Value = Sample> {
        let pixels = form.pixels();
        let share = prop_oneof![Just(f16::NAN), (1u16..0x7c00).prop_map(f16::from_bits)];
        let right = vec(any::<u8>(), 3 * pixels).prop_map(move |right| form.has_right.then_some(right));
        let scale = proptest::option::of(1e-3..1e4f64);
        let cell = (1u16..0x7c00, 0u16..0x7c00, any::<[u8; 3]>()).prop_map(|(stereo, mono, shares)| {
            let halves = [stereo.to_le_bytes(), mono.to_le_bytes()].concat();
            std::array::from_fn(|at| if at < 4 { halves[at] } else { shares[at - 4] })
        });
        let cells = vec(cell, pixels).prop_map(move |cells: Vec<[u8; CELL_LEN]>| form.has_cells.then_some(cells));
        (".{0,12}", vec(any::<u8>(), 3 * pixels), right, vec(share, pixels), scale, cells).prop_map(
            |(id, image, right, share, depth_scale, cells)| Sample { id, image, right, share, depth_scale, cells },
        )
    }

    fn samples() -> impl Strategy<Value = Samples> {
        (1u32..6, 1u32..5, any::<bool>(), any::<bool>()).prop_flat_map(|(width, height, has_right, has_cells)| {
            vec(sample(Form { width, height, has_right, has_cells }), 0..4).prop_map(move |items| Samples {
                width,
                height,
                has_right,
                items,
            })
        })
    }

    fn one() -> Samples {
        let share = vec![f16::NAN, f16::from_f32(0.25)];
        let (id, image) = ("7".to_owned(), (1..7).collect());
        let sample = Sample { id, image, share, depth_scale: Some(2.0), ..Sample::default() };
        Samples { width: 2, height: 1, has_right: false, items: vec![sample] }
    }

    #[test]
    fn the_bytes_are_those_of_the_documented_format() {
        let mut expected = b"DLSAMPLE".to_vec();
        for number in [1u32, 0, 2, 1, 1, 0, 1] {
            expected.extend_from_slice(&number.to_le_bytes());
        }
        expected.push(b'7');
        expected.extend_from_slice(&[0, 0, 0, 0, 0, 0, 0, 0x40]);
        expected.extend_from_slice(&[1, 2, 3, 4, 5, 6]);
        expected.extend_from_slice(&[0x00, 0x7e, 0x00, 0x34]);
        assert_eq!(one().encode(), expected);
    }

    #[test]
    fn every_nan_is_written_as_the_same_one() {
        let mut other = one();
        other.items[0].share[0] = f16::from_bits(0xffff);
        assert_eq!(other.encode(), one().encode());
    }

    #[test]
    fn damage_is_named() {
        let bytes = one().encode();
        let with = |at: usize, byte: u8| {
            let mut bytes = bytes.clone();
            bytes[at] = byte;
            Samples::decode(&bytes).unwrap_err()
        };
        let scale = HEADER_LEN + 5;
        assert_eq!(Samples::decode(b"PNG"), Err(DecodeError::Magic));
        assert_eq!(Samples::decode(&bytes[..20]), Err(DecodeError::CutOff { sample: 0, count: 0 }));
        assert_eq!(with(8, 9), DecodeError::Version(9));
        assert_eq!(with(12, 6), DecodeError::Flags(6));
        assert_eq!(with(16, 0), DecodeError::Size { width: 0, height: 1 });
        assert_eq!(with(31, 0xff), DecodeError::CutOff { sample: 1, count: 0xff00_0000_0000_0001 });
        assert_eq!(with(24, 0), DecodeError::Trailing(bytes.len() - HEADER_LEN));
        assert_eq!(with(HEADER_LEN + 4, 0xff), DecodeError::Id(0));
        assert_eq!(with(scale + 7, 0xc0), DecodeError::Value { sample: 0, what: "a depth scale" });
        assert_eq!(with(bytes.len() - 1, 0xb4), DecodeError::Value { sample: 0, what: "a target" });
        // A valid cell without stereo, and a monocular estimate that is not a number.
        let cells = |cell: [u8; CELL_LEN]| {
            let mut samples = one();
            samples.items[0].cells = Some(vec![[0; CELL_LEN], cell]);
            Samples::decode(&samples.encode()).map(|_| ())
        };
        let wrong = Err(DecodeError::Value { sample: 0, what: "a share" });
        assert_eq!(cells([0, 0, 0, 0x3c, 0, 0, 0]), Ok(()));
        assert_eq!(cells([0, 0, 0, 0x3c, 1, 0, 0]), wrong);
        assert_eq!(cells([0, 0, 0, 0x7e, 0, 0, 0]), wrong);
    }

    proptest! {
        #[test]
        fn samples_survive_being_written_and_read(samples in samples()) {
            let bytes = samples.encode();
            let read = Samples::decode(&bytes);
            prop_assert_eq!(read.as_ref(), Ok(&samples));
            prop_assert_eq!(read.map(|read| read.encode()), Ok(bytes));
        }

        #[test]
        fn every_beginning_of_samples_is_an_error(samples in samples(), part in 0.0..1.0f64) {
            let bytes = samples.encode();
            prop_assert!(Samples::decode(&bytes[..(bytes.len() as f64 * part) as usize]).is_err());
        }

        #[test]
        fn damaged_bytes_never_panic(samples in samples(), damage in vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
            let mut bytes = samples.encode();
            for (at, byte) in damage {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            if let Ok(read) = Samples::decode(&bytes) {
                prop_assert_eq!(Samples::decode(&read.encode()), Ok(read));
            }
        }
    }
}
