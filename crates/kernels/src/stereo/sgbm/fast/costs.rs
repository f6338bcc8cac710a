//! One row of pixel costs, summed over the block's width; and block costs from the rows that enter and leave.

use super::lanes::{Lanes, WIDEST};
use crate::stereo::sgbm::prefilter::Plane;
use crate::stereo::sgbm::search::Search;

pub(super) struct CostRow<'a> {
    pub search: &'a Search,
    pub left: &'a [Plane],
    /// Planes of the right row, reversed.
    pub right: &'a [Plane],
    /// Memory for the pixel costs, `pixel_len` long.
    pub pixel: &'a mut [i16],
    pub sums: &'a mut [i16],
}

/// Values of pixel memory that a row needs: vectors reach past the last pixel.
pub(super) fn pixel_len(search: &Search) -> usize {
    search.row_len() + WIDEST
}

pub(super) fn largest_pixel_cost(search: &Search) -> usize {
    let sobel = if search.clip <= 127 { 2 * search.clip as usize } else { 255 };
    search.channels * (sobel + 255 / 4)
}

/// Where the rows of the planes begin: value, low and high of each.
type Pointers = [[*const u8; 3]; 6];

fn pointers(planes: &[Plane]) -> Pointers {
    let mut pointers = [[std::ptr::null(); 3]; 6];
    for (pointers, plane) in pointers.iter_mut().zip(planes) {
        *pointers = [plane.value.as_ptr(), plane.low.as_ptr(), plane.high.as_ptr()];
    }
    pointers
}

#[derive(Clone, Copy)]
struct Pixels<'a> {
    search: &'a Search,
    left: Pointers,
    right: Pointers,
    /// The costs: bytes in the first half of the memory, or 16 bits.
    to: *mut i16,
    /// Vectors of 16-bit costs per column.
    n: usize,
}

/// How pixel costs are stored. (A trait, not closures: only functions can be forced to be inlined, and
/// code outside a function compiled for an instruction set does not use it.)
trait PixelCosts<L: Lanes> {
    /// Computes column `x`.
    ///
    /// # Safety
    /// As [`cost_row`]; `x` is a searched column.
    unsafe fn compute(pixels: &Pixels<'_>, x: usize);

    /// A vector of costs from `at`, computed before.
    ///
    /// # Safety
    /// As [`cost_row`].
    unsafe fn load(pixels: &Pixels<'_>, at: usize) -> L::V;
}

/// One channel, costs up to 255.
struct Bytes;

/// Any costs.
struct Words;

impl<L: Lanes> PixelCosts<L> for Bytes {
    #[inline(always)]
    unsafe fn compute(pixels: &Pixels<'_>, x: usize) {
        let (column, from) = pixels.places(x);
        let d = pixels.n * L::LANES;
        for at in (0..d).step_by(L::BYTES) {
            // SAFETY: candidates are inside the planes, which are padded by a vector; so is the memory.
            unsafe {
                let sobel = dissimilarity::<L>(&pixels.left[0], &pixels.right[0], column, from + at);
                let grey = dissimilarity::<L>(&pixels.left[1], &pixels.right[1], column, from + at);
                L::store_bytes(pixels.to.cast::<u8>().add(x * d + at), L::add_bytes(sobel, L::quarter_bytes(grey)));
            }
        }
    }

    #[inline(always)]
    unsafe fn load(pixels: &Pixels<'_>, at: usize) -> L::V {
        // SAFETY: as the caller guarantees.
        unsafe { L::load_widened(pixels.to.cast::<u8>().add(at)) }
    }
}

impl<L: Lanes> PixelCosts<L> for Words {
    #[inline(always)]
    unsafe fn compute(pixels: &Pixels<'_>, x: usize) {
        let (column, from) = pixels.places(x);
        let d = pixels.n * L::LANES;
        let channels = pixels.search.channels;
        for at in (0..d).step_by(L::BYTES) {
            // SAFETY: candidates are inside the planes, which are padded by a vector; so is the memory.
            unsafe {
                let mut sum = [L::splat(0); 2];
                for plane in 0..2 * channels {
                    let cost = dissimilarity::<L>(&pixels.left[plane], &pixels.right[plane], column, from + at);
                    let cost = L::widen(if plane < channels { cost } else { L::quarter_bytes(cost) });
                    sum = [L::add(sum[0], cost[0]), L::add(sum[1], cost[1])];
                }
                L::store(pixels.to.add(x * d + at), sum[0]);
                L::store(pixels.to.add(x * d + at + L::LANES), sum[1]);
            }
        }
    }

    #[inline(always)]
    unsafe fn load(pixels: &Pixels<'_>, at: usize) -> L::V {
        // SAFETY: as the caller guarantees.
        unsafe { L::load(pixels.to.add(at)) }
    }
}

impl Pixels<'_> {
    /// The places of a searched column and its first candidate in the planes.
    #[inline(always)]
    fn places(&self, x: usize) -> (usize, usize) {
        let column = self.search.first_column + x;
        (column, ((self.search.width - 1 - column) as i32 + self.search.min_disparity) as usize)
    }
}

/// Pixel costs and their sums along the row.
///
/// # Safety
/// The instruction set of `L` must be present; planes are as [`Plane`] says, buffers as [`CostRow`] says.
#[inline(always)]
pub(super) unsafe fn cost_row<L: Lanes, const N: usize>(row: &mut CostRow<'_>) {
    let search = row.search;
    assert!(row.pixel.len() >= pixel_len(search) && row.sums.len() == search.row_len());
    assert!(row.left.len() == 2 * search.channels && row.right.len() == 2 * search.channels);
    let pixels = Pixels {
        search,
        left: pointers(row.left),
        right: pointers(row.right),
        to: row.pixel.as_mut_ptr(),
        n: if N > 0 { N } else { search.disparities / L::LANES },
    };
    // SAFETY: as the caller guarantees; lengths were just measured.
    unsafe {
        if search.channels == 1 && largest_pixel_cost(search) <= usize::from(u8::MAX) {
            sum_row::<L, Bytes>(&pixels, row.sums.as_mut_ptr());
        } else {
            sum_row::<L, Words>(&pixels, row.sums.as_mut_ptr());
        }
    }
}

/// Pixel costs, and their sums over the block's width.
///
/// # Safety
/// As [`cost_row`].
#[inline(always)]
unsafe fn sum_row<L: Lanes, K: PixelCosts<L>>(pixels: &Pixels<'_>, sums: *mut i16) {
    let Search { columns, radius, .. } = *pixels.search;
    let n = pixels.n;
    let d = n * L::LANES;
    let last = columns - 1;
    // SAFETY: `x <= last` and `j < n`: within the row's costs and sums.
    unsafe {
        // Columns computed so far: always `radius` ahead.
        let mut computed = 0;
        for x in 0..=last {
            while computed <= (x + radius).min(last) {
                K::compute(pixels, computed);
                computed += 1;
            }
            let now = sums.add(x * d);
            if x == 0 {
                for j in 0..n {
                    let first = K::load(pixels, j * L::LANES);
                    // The border column counts `radius + 1` times: once here, and once more with each column added.
                    let mut sum = first;
                    for column in 1..=radius {
                        sum = L::add(sum, L::add(first, K::load(pixels, column.min(last) * d + j * L::LANES)));
                    }
                    L::store(now.add(j * L::LANES), sum);
                }
                continue;
            }
            let enters = (x + radius).min(last) * d;
            let leaves = (x - 1).saturating_sub(radius) * d;
            let before = now.sub(d);
            for j in 0..n {
                let at = j * L::LANES;
                let change = L::sub(K::load(pixels, enters + at), K::load(pixels, leaves + at));
                L::store(now.add(at), L::add(L::load(before.add(at)), change));
            }
        }
    }
}

/// The dissimilarity of a column of the left plane with a vector of candidates of the right one.
///
/// # Safety
/// As [`cost_row`]; the places are inside the planes.
#[inline(always)]
unsafe fn dissimilarity<L: Lanes>(left: &[*const u8; 3], right: &[*const u8; 3], column: usize, from: usize) -> L::B {
    // SAFETY: as the caller guarantees.
    unsafe {
        let u = L::splat_bytes(*left[0].add(column));
        let u_low = L::splat_bytes(*left[1].add(column));
        let u_high = L::splat_bytes(*left[2].add(column));
        let v = L::load_bytes(right[0].add(from));
        let v_low = L::load_bytes(right[1].add(from));
        let v_high = L::load_bytes(right[2].add(from));
        let left_in_right = L::max_bytes(L::sub_bytes(u, v_high), L::sub_bytes(v_low, u));
        let right_in_left = L::max_bytes(L::sub_bytes(v, u_high), L::sub_bytes(u_low, v));
        L::min_bytes(left_in_right, right_in_left)
    }
}

pub(super) struct Slide<'a> {
    pub cost: &'a mut [i16],
    pub before: &'a [i16],
    /// Row sums that enter the block.
    pub enters: &'a [i16],
    /// Row sums that leave it.
    pub leaves: &'a [i16],
}

#[inline(always)]
pub(super) fn slide(part: &mut Slide<'_>) {
    let changes = part.enters.iter().zip(part.leaves);
    for ((cost, before), (enters, leaves)) in part.cost.iter_mut().zip(part.before).zip(changes) {
        *cost = before.wrapping_add(enters.wrapping_sub(*leaves));
    }
}
