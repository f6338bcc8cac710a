//! Images laid out as lines: rows one after the other, with zeros between them.

use crate::simd::LANES;

/// The layout of images of one size: every channel a plane, its rows separated by `pad` zeros, `pad` rows of zeros
/// above and below. A step past a row's end reaches zeros that the next row begins after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planes {
    width: usize,
    height: usize,
    pad: usize,
}

impl Planes {
    /// Planes of `width` by `height` samples for layers that reach `pad` samples beyond the border.
    #[must_use]
    pub const fn new(width: usize, height: usize, pad: usize) -> Self {
        Self { width, height, pad }
    }

    /// Columns of the image.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows of the image.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// The layout of images with other sides and the same zeros.
    #[must_use]
    pub const fn resized(&self, width: usize, height: usize) -> Self {
        Self { width, height, pad: self.pad }
    }

    pub(super) const fn pad(&self) -> usize {
        self.pad
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

    /// Samples of one plane in memory.
    #[must_use]
    pub const fn plane(&self) -> usize {
        // The zeros at the end are read by the last vectors of the lowest tap.
        (self.pad + (self.height + 2 * self.pad) * self.row() + self.pad + LANES).next_multiple_of(LANES)
    }

    /// Memory of `channels` planes, all zeros.
    #[must_use]
    pub fn zeros(&self, channels: usize) -> Vec<f32> {
        vec![0.0; channels * self.plane()]
    }

    /// Where the sample left and above by `pad` of a plane's first sample is: the origin of taps.
    pub(super) const fn tap(&self, plane: usize, down: usize, right: usize) -> usize {
        // One row of zeros begins `pad` after the plane does; a tap `right = 0` is `pad` before the sample.
        plane * self.plane() + down * self.row() + right
    }

    pub(super) const fn origin(&self, plane: usize) -> usize {
        self.tap(plane, self.pad, self.pad)
    }

    /// The rows of a plane, without the zeros between them.
    pub(super) fn rows<'a>(&self, planes: &'a [f32], plane: usize) -> impl Iterator<Item = &'a [f32]> {
        let width = self.width;
        planes[self.origin(plane)..][..self.height * self.row()].chunks_exact(self.row()).map(move |row| &row[..width])
    }

    /// As [`Planes::rows`], to write.
    pub(super) fn rows_mut<'a>(&self, planes: &'a mut [f32], plane: usize) -> impl Iterator<Item = &'a mut [f32]> {
        let (width, origin) = (self.width, self.origin(plane));
        let rows = planes[origin..][..self.height * self.row()].chunks_exact_mut(self.row());
        rows.map(move |row| &mut row[..width])
    }

    /// Puts an image, channels x height x width, into planes, whose zeros are left alone.
    pub fn spread(&self, image: &[f32], planes: &mut [f32]) {
        for (channel, image) in image.chunks_exact(self.width * self.height).enumerate() {
            for (to, from) in self.rows_mut(planes, channel).zip(image.chunks_exact(self.width)) {
                to.copy_from_slice(from);
            }
        }
    }

    /// Takes an image, channels x height x width, out of planes.
    pub fn collect(&self, planes: &[f32], image: &mut [f32]) {
        for (channel, image) in image.chunks_exact_mut(self.width * self.height).enumerate() {
            for (to, from) in image.chunks_exact_mut(self.width).zip(self.rows(planes, channel)) {
                to.copy_from_slice(from);
            }
        }
    }

    /// Makes zeros of what sums over whole lines have left between the rows and after the last.
    pub(super) fn clear_gaps(&self, planes: &mut [f32]) {
        for plane in planes.chunks_exact_mut(self.plane()) {
            let line = &mut plane[self.origin(0)..];
            for y in 0..self.height {
                line[y * self.row() + self.width..][..self.pad].fill(0.0);
            }
            line[self.height * self.row()..self.columns()].fill(0.0);
        }
    }
}
