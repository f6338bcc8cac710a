//! Samples read from the encoded bytes, without a second copy.

use depthloom_graphs::Fault;
use depthloom_graphs::values::Artifact;
use depthloom_kernels::learned::Cell;
use half::f16;

use super::format::{DecodeError, FLAG_CELLS, FLAG_RIGHT, Form, HEADER_LEN, LARGEST_SIDE, MAGIC, VERSION};
use super::sample::{CELL_LEN, cell};

#[derive(Clone, Debug)]
pub(crate) struct SamplesView<'a> {
    pub(super) form: Form,
    pub(crate) items: Vec<SampleView<'a>>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SampleView<'a> {
    #[cfg_attr(not(test), expect(dead_code, reason = "reading checks it; only tests look at it again"))]
    pub(crate) id: &'a str,
    /// The left image, 3 x height x width.
    pub(crate) image: &'a [u8],
    pub(crate) right: Option<&'a [u8]>,
    /// `f * B / width`, metres; `None` without calibration.
    pub(crate) depth_scale: Option<f64>,
    share: &'a [[u8; 2]],
    pub(super) cells: Option<&'a [[u8; CELL_LEN]]>,
}

impl SampleView<'_> {
    /// The target of a pixel: disparity as a share of the image's width; NaN = no target.
    #[inline]
    pub(crate) fn share(&self, pixel: usize) -> f16 {
        f16::from_le_bytes(self.share[pixel])
    }

    /// What fusion sees of a pixel; the default where the samples have no cells.
    pub(crate) fn cell(&self, pixel: usize) -> Cell {
        self.cells.map(|cells| cell(cells[pixel])).unwrap_or_default()
    }

    pub(crate) fn shares(&self) -> impl Iterator<Item = f16> {
        self.share.iter().map(|bytes| f16::from_le_bytes(*bytes))
    }
}

impl<'a> SamplesView<'a> {
    /// The samples at a port of a training, without a copy, since a large set would not fit into memory twice.
    pub(crate) fn at_port(port: &str, artifact: &'a Artifact) -> Result<Self, Fault> {
        let damaged = |error| Fault::new(format!("the input `{port}` cannot be read as samples")).because(error);
        let samples = Self::read(&artifact.bytes).map_err(damaged)?;
        if samples.has_target() {
            return Ok(samples);
        }
        Err(Fault::new(format!("there are no samples at `{port}`: no frame had a target")).remedy(
            "check that the stage has frames, and that `target`, and `mask` at `learn/samples`, leave valid pixels",
        ))
    }

    /// Reads the output of `learn/samples`, without a copy.
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let (form, count, mut rest) = header(bytes)?;
        // Damaged counts announce more than the bytes can hold: no memory is taken before it is looked at.
        let most = rest.len() / form.sample_len() + 1;
        let mut items = Vec::with_capacity(usize::try_from(count).unwrap_or(usize::MAX).min(most));
        for index in 0..count {
            let (sample, after) = sample(form, index, count, rest)?;
            items.push(sample);
            rest = after;
        }
        if !rest.is_empty() {
            return Err(DecodeError::Trailing(rest.len()));
        }
        Ok(Self { form, items })
    }

    pub(crate) const fn width(&self) -> usize {
        self.form.width as usize
    }

    pub(crate) const fn height(&self) -> usize {
        self.form.height as usize
    }

    /// Whether every sample has a right image; without, none has.
    pub(crate) const fn has_right(&self) -> bool {
        self.form.has_right
    }

    /// Whether every sample has cells for fusion; without, none has.
    pub(crate) const fn has_cells(&self) -> bool {
        self.form.has_cells
    }

    pub(crate) const fn len(&self) -> usize {
        self.items.len()
    }

    pub(crate) fn has_target(&self) -> bool {
        self.items.iter().any(|sample| sample.shares().any(|share| !share.is_nan()))
    }

    /// Whether every sample has a depth in metres.
    pub(crate) fn has_depth_scale(&self) -> bool {
        self.items.iter().all(|sample| sample.depth_scale.is_some())
    }
}

/// Columns, rows, and whether there are right images, from the first bytes.
pub(crate) fn size_and_right(bytes: &[u8]) -> Result<(u32, u32, bool), DecodeError> {
    header(bytes).map(|(form, ..)| (form.width, form.height, form.has_right))
}

/// The form, the number of samples, and the bytes of the samples.
fn header(bytes: &[u8]) -> Result<(Form, u64, &[u8]), DecodeError> {
    if bytes.get(..8) != Some(&MAGIC) {
        return Err(DecodeError::Magic);
    }
    let cut = DecodeError::CutOff { sample: 0, count: 0 };
    let (header, rest) = bytes.split_first_chunk::<HEADER_LEN>().ok_or(cut)?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let (version, flags, width, height) = (number(8), number(12), number(16), number(20));
    let count = u64::from(number(24)) | u64::from(number(28)) << 32;
    if version != VERSION {
        return Err(DecodeError::Version(version));
    }
    if flags & !(FLAG_RIGHT | FLAG_CELLS) != 0 {
        return Err(DecodeError::Flags(flags));
    }
    if !(1..=LARGEST_SIDE).contains(&width) || !(1..=LARGEST_SIDE).contains(&height) {
        return Err(DecodeError::Size { width, height });
    }
    let (has_right, has_cells) = (flags & FLAG_RIGHT != 0, flags & FLAG_CELLS != 0);
    Ok((Form { width, height, has_right, has_cells }, count, rest))
}

/// The first of the samples in `rest`, and the bytes after it.
fn sample(form: Form, index: u64, count: u64, rest: &[u8]) -> Result<(SampleView<'_>, &[u8]), DecodeError> {
    let cut = DecodeError::CutOff { sample: index, count };
    let mut rest = rest;
    let mut take = |len: usize| {
        let (taken, after) = rest.split_at_checked(len).ok_or_else(|| cut.clone())?;
        rest = after;
        Ok(taken)
    };
    let id_len = take(4)?.first_chunk().map_or(0, |len| u32::from_le_bytes(*len));
    let id = str::from_utf8(take(id_len as usize)?).map_err(|_| DecodeError::Id(index))?;
    let scale = take(8)?.first_chunk().map_or(f64::NAN, |scale| f64::from_le_bytes(*scale));
    let image = take(3 * form.pixels())?;
    let right = if form.has_right { Some(take(3 * form.pixels())?) } else { None };
    let (share, _) = take(2 * form.pixels())?.as_chunks::<2>();
    let cells = if form.has_cells { Some(take(CELL_LEN * form.pixels())?.as_chunks::<CELL_LEN>().0) } else { None };
    let depth_scale = (!scale.is_nan()).then_some(scale);
    if depth_scale.is_some_and(|scale| !(scale > 0.0 && scale.is_finite())) {
        return Err(DecodeError::Value { sample: index, what: "a depth scale" });
    }
    let sample = SampleView { id, image, right, depth_scale, share, cells };
    if !sample.shares().all(|share| share.is_nan() || share > f16::ZERO && share.is_finite()) {
        return Err(DecodeError::Value { sample: index, what: "a target" });
    }
    let is_sound = |&bytes: &[u8; CELL_LEN]| {
        let Cell { stereo, covered, mono, .. } = cell(bytes);
        let is_share = |share: f32| share.is_finite() && share.is_sign_positive();
        is_share(stereo) && is_share(mono) && (covered == 0.0 || stereo > 0.0)
    };
    if !cells.is_none_or(|cells| cells.iter().all(is_sound)) {
        return Err(DecodeError::Value { sample: index, what: "a share" });
    }
    Ok((sample, rest))
}

#[cfg(test)]
mod tests {
    use super::{SamplesView, f16};
    use crate::samples::{Sample, Samples};

    #[test]
    fn fault_22_samples_are_read_without_a_copy() {
        let sample = Sample {
            id: "7".to_owned(),
            image: (1..7).collect(),
            right: Some((7..13).collect()),
            share: vec![f16::NAN, f16::from_f32(0.25)],
            depth_scale: Some(2.0),
            cells: None,
        };
        let bytes = Samples { width: 2, height: 1, has_right: true, items: vec![sample.clone(), sample] }.encode();
        let view = SamplesView::read(&bytes).unwrap();
        for sample in &view.items {
            let lies_within = |part: &[u8]| {
                let (part, whole) = (part.as_ptr_range(), bytes.as_ptr_range());
                whole.start <= part.start && part.end <= whole.end
            };
            assert!(lies_within(sample.id.as_bytes()) && lies_within(sample.image));
            assert!(lies_within(sample.right.unwrap()) && lies_within(sample.share.as_flattened()));
        }
        // What indexing takes does not grow with the images.
        assert!(size_of_val(&view.items[0]) < 128);
    }
}
