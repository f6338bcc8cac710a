//! Images laid out as lines: rows one after the other, with zeros between them.

use crate::simd::LANES;

/// The line layout of images of one size: every channel a plane, its rows separated by `pad` zeros, `pad` rows of zeros
/// above and below. A step past a row's end reaches zeros that the next row begins after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Planes {
    width: usize,
    height: usize,
    pad: usize,
}

impl Planes {
    pub(super) const fn new(width: usize, height: usize, pad: usize) -> Self {
        Self { width, height, pad }
    }

    /// Samples from a row's first sample to the next row's.
    pub(super) const fn row(&self) -> usize {
        self.width + self.pad
    }

    /// Samples that a sum over the image runs through: its rows with the zeros between them, rounded up to whole
    /// vectors.
    pub(super) const fn columns(&self) -> usize {
        (self.height * self.row()).next_multiple_of(LANES)
    }

    pub(super) const fn plane(&self) -> usize {
        // The zeros at the end are read by the last vectors of the lowest tap.
        (self.pad + (self.height + 2 * self.pad) * self.row() + self.pad + LANES).next_multiple_of(LANES)
    }

    /// Where the sample left and above by `pad` of a plane's first sample is: the origin of taps.
    pub(super) const fn tap(&self, plane: usize, down: usize, right: usize) -> usize {
        // One row of zeros begins `pad` after the plane does; a tap `right = 0` is `pad` before the sample.
        plane * self.plane() + down * self.row() + right
    }

    pub(super) const fn origin(&self, plane: usize) -> usize {
        self.tap(plane, self.pad, self.pad)
    }

    pub(super) fn reserve(&self, planes: &mut Vec<f32>, count: usize) {
        // What is left over of other sizes is overwritten plane by plane.
        if planes.len() < count * self.plane() {
            planes.resize(count * self.plane(), 0.0);
        }
    }

    /// Fills one plane: `row(y, out)` writes the samples of row `y`, everything between is zero.
    pub(super) fn fill(&self, planes: &mut [f32], plane: usize, mut row: impl FnMut(usize, &mut [f32])) {
        let plane = &mut planes[plane * self.plane()..][..self.plane()];
        let first = self.pad * self.row() + self.pad;
        plane[..first].fill(0.0);
        let (rows, rest) = plane[first..].split_at_mut(self.height * self.row());
        for (y, line) in rows.chunks_exact_mut(self.row()).enumerate() {
            let (samples, gap) = line.split_at_mut(self.width);
            row(y, samples);
            gap.fill(0.0);
        }
        rest.fill(0.0);
    }

    pub(super) fn spread(&self, image: &[f32], planes: &mut Vec<f32>) {
        let area = self.width * self.height;
        self.reserve(planes, image.len() / area);
        for (channel, image) in image.chunks_exact(area).enumerate() {
            self.fill(planes, channel, |y, row| row.copy_from_slice(&image[y * self.width..][..self.width]));
        }
    }

    /// Takes an image out of sums, whose channels are [`Planes::columns`] apart.
    pub(super) fn collect(&self, sums: &[f32], image: &mut [f32]) {
        for (channel, image) in image.chunks_exact_mut(self.width * self.height).enumerate() {
            let sums = sums[channel * self.columns()..].chunks(self.row());
            for (row, sums) in image.chunks_exact_mut(self.width).zip(sums) {
                row.copy_from_slice(&sums[..self.width]);
            }
        }
    }
}
