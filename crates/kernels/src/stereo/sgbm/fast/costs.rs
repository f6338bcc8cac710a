//! One row of pixel costs.

use crate::stereo::lanes::{Lanes, WIDEST};
use crate::stereo::sgbm::prefilter::Plane;
use crate::stereo::sgbm::search::Search;

pub(super) struct CostRow<'a> {
    pub search: &'a Search,
    pub left: &'a [Plane],
    /// Planes of the right row, reversed.
    pub right: &'a [Plane],
    /// The costs: bytes or words (see [`in_bytes`]), `pixel_len` values of memory.
    pub pixel: &'a mut [i16],
}

/// Values of memory that a row of pixel costs needs: vectors reach past the last pixel.
pub(super) fn pixel_len(search: &Search) -> usize {
    let values = if in_bytes(search) { search.row_len() / 2 } else { search.row_len() };
    (values + WIDEST).next_multiple_of(WIDEST)
}

/// Whether pixel costs are stored as bytes: one channel, costs up to 255.
pub(super) fn in_bytes(search: &Search) -> bool {
    search.channels == 1 && largest_pixel_cost(search) <= usize::from(u8::MAX)
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

/// Pixel costs of a row.
///
/// # Safety
/// The instruction set of `L` must be present; planes are as [`Plane`] says.
#[inline(always)]
pub(super) unsafe fn cost_row<L: Lanes, const N: usize>(row: &mut CostRow<'_>) {
    let Search { channels, columns, width, first_column, min_disparity, .. } = *row.search;
    assert!(row.pixel.len() >= pixel_len(row.search));
    assert!(row.left.len() == 2 * channels && row.right.len() == 2 * channels);
    let (left, right) = (pointers(row.left), pointers(row.right));
    let d = if N > 0 { N * L::LANES } else { row.search.disparities };
    let bytes = in_bytes(row.search);
    let to = row.pixel.as_mut_ptr();
    for x in 0..columns {
        let column = first_column + x;
        let first = ((width - 1 - column) as i32 + min_disparity) as usize;
        for at in (0..d).step_by(L::BYTES) {
            let from = first + at;
            // SAFETY: candidates are inside the planes, which are padded by a vector; so is the memory.
            unsafe {
                if bytes {
                    let sobel = dissimilarity::<L>(&left[0], &right[0], column, from);
                    let grey = dissimilarity::<L>(&left[1], &right[1], column, from);
                    L::store_bytes(to.cast::<u8>().add(x * d + at), L::add_bytes(sobel, L::quarter_bytes(grey)));
                    continue;
                }
                let mut sum = [L::splat(0); 2];
                for plane in 0..2 * channels {
                    let cost = dissimilarity::<L>(&left[plane], &right[plane], column, from);
                    let cost = L::widen(if plane < channels { cost } else { L::quarter_bytes(cost) });
                    sum = [L::add(sum[0], cost[0]), L::add(sum[1], cost[1])];
                }
                L::store(to.add(x * d + at), sum[0]);
                L::store(to.add(x * d + at + L::LANES), sum[1]);
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
