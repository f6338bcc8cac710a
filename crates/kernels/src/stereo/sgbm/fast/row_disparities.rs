//! The disparities of one row: sub-pixel positions and the left-right check, for whole rows at once.

use crate::stereo::sgbm::choice::Choice;
use crate::stereo::sgbm::search::Search;

/// Marks an invalid column.
const NONE: i16 = i16::MIN;

/// Larger than any index of a candidate.
const INDICES: i32 = 4095;

/// Columns before the first and after the last that a rounded disparity may name.
const MARGIN: usize = 2;

#[derive(Debug, Default)]
pub(super) struct RowDisparities {
    /// Best candidate of each searched column, or `NONE`.
    index: Vec<i16>,
    /// Costs of its predecessor, of itself, of its successor.
    before: Vec<i16>,
    here: Vec<i16>,
    after: Vec<i16>,
    /// For each column of the right image its cheapest partner: cost in the upper half, 4095 - index in the lower, 0
    /// for none. OpenCV goes from right to left and lets only a smaller cost replace one: of equal costs the larger
    /// index stays, so that it is the smallest key that wins.
    partners: Vec<i32>,
    /// For each column of the right image the smallest and largest disparity, px, that agree with its partner; with a
    /// margin.
    agreeing: Vec<[i16; 2]>,
}

/// Where the disparities of one row are written, as long as its [`RowDisparities`] are not accessed.
#[derive(Clone, Copy)]
pub(super) struct DisparitySlots {
    index: *mut i16,
    before: *mut i16,
    here: *mut i16,
    after: *mut i16,
    partners: *mut i32,
}

impl DisparitySlots {
    /// Searched column `x` is invalid.
    ///
    /// # Safety
    /// The disparities must be alive and started for a row with this column.
    #[inline(always)]
    pub(super) unsafe fn none(&self, x: usize) {
        // SAFETY: as the caller guarantees.
        unsafe { *self.index.add(x) = NONE };
    }

    /// Searched column `x` has the disparity `best`, the best of `sums`.
    ///
    /// # Safety
    /// As [`DisparitySlots::none`].
    #[inline(always)]
    pub(super) unsafe fn put(&self, search: &Search, x: usize, best: Choice, sums: &[i16]) {
        let partner = (x + search.first_column) as i32 - best.index - search.min_disparity;
        let key = i32::from(best.cost) << 16 | (INDICES - best.index);
        // At the ends these are not used; any in range will do.
        let last = sums.len() as i32 - 1;
        // SAFETY: a searched column's candidates are inside the right image, candidate -1 one column farther at most.
        unsafe {
            let slot = self.partners.add(partner as usize);
            *slot = key.min(*slot);
            *self.index.add(x) = best.index as i16;
            *self.here.add(x) = best.cost;
            *self.before.add(x) = *sums.get_unchecked((best.index - 1).max(0) as usize);
            *self.after.add(x) = *sums.get_unchecked((best.index + 1).min(last) as usize);
        }
    }
}

impl RowDisparities {
    /// Begins a row; disparities are written to the slots.
    pub(super) fn start(&mut self, search: &Search) -> DisparitySlots {
        for values in [&mut self.index, &mut self.before, &mut self.here, &mut self.after] {
            values.resize(search.columns, 0);
        }
        self.partners.clear();
        // One more than columns: a candidate -1 may be there. It never wins.
        self.partners.resize(search.width + 1, i32::from(i16::MAX) << 16);
        DisparitySlots {
            index: self.index.as_mut_ptr(),
            before: self.before.as_mut_ptr(),
            here: self.here.as_mut_ptr(),
            after: self.after.as_mut_ptr(),
            partners: self.partners.as_mut_ptr(),
        }
    }

    #[inline(always)]
    pub(super) fn finish(&mut self, search: &Search, out: &mut [i16]) {
        let columns = search.first_column..search.first_column + search.columns;
        out[..columns.start].fill(search.invalid);
        out[columns.end..].fill(search.invalid);
        self.refine(search, &mut out[columns.clone()]);
        self.see(search);
        let agreeing = &self.agreeing[..];
        for (x, disparity) in columns.clone().zip(&mut out[columns]) {
            let fixed = i32::from(*disparity);
            let agrees = |d: i32| {
                let [low, high] = agreeing[(x as i32 - d + MARGIN as i32) as usize].map(i32::from);
                (low <= d) & (d <= high)
            };
            // Most agree at once.
            if !agrees(fixed >> 4) && !agrees((fixed + 15) >> 4) {
                *disparity = search.invalid;
            }
        }
    }

    /// The minimum of the parabola through a candidate and its neighbours, in 1/16 px.
    #[inline(always)]
    fn refine(&self, search: &Search, out: &mut [i16]) {
        let len = out.len();
        let (index, before, here, after) =
            (&self.index[..len], &self.before[..len], &self.here[..len], &self.after[..len]);
        let last = search.disparities as i32 - 1;
        for x in 0..len {
            let i = i32::from(index[x]);
            let (before, here, after) = (i32::from(before[x]), i32::from(here[x]), i32::from(after[x]));
            let curvature = (before + after - 2 * here).max(1);
            let numerator = (before - after) * 16 + curvature;
            // Both are below 2^24, hence exact, and so is the quotient cut to an integer: a fractional quotient is
            // farther from the next integer than rounding reaches.
            let step = (numerator as f32 / (curvature * 2) as f32) as i32;
            let inside = i > 0 && i < last;
            let disparity = (i + search.min_disparity) * 16 + if inside { step } else { 0 };
            out[x] = if index[x] == NONE { search.invalid } else { disparity as i16 };
        }
    }

    /// The disparities that agree with what is seen from the right image.
    #[inline(always)]
    fn see(&mut self, search: &Search) {
        const ALL: [i16; 2] = [i16::MIN, i16::MAX];
        let Search { min_disparity, disp12_max_diff, .. } = *search;
        // More than any two 16-bit numbers differ.
        let reach = disp12_max_diff.min(1 << 20);
        // A partner that no pixel chose holds the invalid mark, which is in 1/16 px but compared as pixels: with a
        // minimum disparity of 2 and more it passes for a disparity. OpenCV does that; so do we.
        let nobody = i32::from(search.invalid);
        let around = |seen: i32| [(seen - reach).max(-0x8000) as i16, (seen + reach).min(0x7fff) as i16];
        let nobody = if nobody >= min_disparity { around(nobody) } else { ALL };
        self.agreeing.clear();
        self.agreeing.resize(search.width + 2 * MARGIN, ALL);
        for (agreeing, &key) in self.agreeing[MARGIN..].iter_mut().zip(&self.partners[..search.width]) {
            let place = key & 0xffff;
            let seen = around(INDICES - place + min_disparity);
            *agreeing = if place == 0 { nobody } else { seen };
        }
    }
}
