//! The fast implementation: named vectors of 16-bit sums, for machines with AVX2, AVX-512 or NEON.
//!
//! 1242x375 with 64 candidates and a block of 21 searches 408,000 pixels, 26 million cells. A cell costs about 8
//! operations of 16-bit lanes to keep the sums of columns, 3 to keep that of the block, and 4 to choose; the choice of
//! a pixel costs some 20 more. What is read in a row (sums of 1,200 columns, 150 kB) stays in the second-level cache.
//!
//! Without these vectors the compiler makes one sum at a time of what is searched across lanes: the smallest, its
//! place, its rivals. On an EPYC with AVX-512 a frame takes 8.8 ms on one thread; the loops that every machine can run
//! take 18, as OpenCV's do.
#![expect(unsafe_code, reason = "vector instructions, on buffers whose sizes are checked for each row")]

use super::search::Search;
use super::sums::{Column, Pair};
use crate::simd::Level;
use crate::stereo::lanes::{COMPARED, Lanes, compare, near_bits};

/// Marks an invalid column.
const NONE: i16 = i16::MIN;

/// The kernels of an instruction set.
///
/// # Safety
/// The creator of the table detected the instruction set on this machine.
#[derive(Clone, Copy)]
pub(super) struct Kernels {
    advance: unsafe fn(Advance<'_>),
    choose: unsafe fn(Choose<'_>),
    refine: unsafe fn(&Search, &Choices, &mut [i16], &mut [i32]),
}

impl Kernels {
    /// Those for a search; `None` if the machine, the number of candidates or the size of the sums does not permit it.
    pub(super) fn new(level: Level, search: &Search) -> Option<Self> {
        let block = 2 * search.radius + 1;
        let fit = 2 * usize::from(search.cap) * block * block < i16::MAX as usize;
        #[cfg(target_arch = "x86_64")]
        if fit && level.has_avx512_vbmi2() && search.disparities.is_multiple_of(64) {
            return Some(avx512::kernels(search.disparities));
        }
        #[cfg(target_arch = "x86_64")]
        if fit && level.has_avx2() && search.disparities.is_multiple_of(32) {
            return Some(avx2::kernels(search.disparities));
        }
        #[cfg(target_arch = "aarch64")]
        if fit && level.has_neon() && search.disparities.is_multiple_of(32) {
            return Some(neon::kernels(search.disparities));
        }
        let _ = (level, fit);
        None
    }
}

/// Sums of a band's rows.
#[derive(Debug, Default)]
pub(super) struct FastSums {
    /// By column and candidate, over the block's height.
    columns: Vec<i16>,
    /// By candidate, over the block; and as many zeros.
    block: Vec<i16>,
    nothing: Vec<i16>,
    choices: Choices,
}

/// The choice for each searched column.
#[derive(Debug, Default)]
struct Choices {
    /// The best candidate, or `NONE`.
    index: Vec<i16>,
    /// The sums of its predecessor, of itself, of its successor.
    before: Vec<i16>,
    here: Vec<i16>,
    after: Vec<i16>,
}

impl FastSums {
    pub(super) fn start(&mut self, search: &Search) {
        let columns = search.columns + 2 * search.radius;
        self.columns.clear();
        self.columns.resize(columns * search.disparities, 0);
        self.block.resize(search.disparities, 0);
        self.nothing.resize(search.disparities, 0);
        let Choices { index, before, here, after } = &mut self.choices;
        for values in [index, before, here, after] {
            values.resize(search.columns, 0);
        }
    }

    /// Adds a row to the sums of columns, and takes off another.
    pub(super) fn advance(&mut self, kernels: Kernels, search: &Search, entering: Pair<'_>, leaving: Option<Pair<'_>>) {
        // SAFETY: `Kernels` was made for an instruction set of this machine.
        unsafe { (kernels.advance)(Advance { search, columns: &mut self.columns, entering, leaving }) }
    }

    /// Answers of the searched columns, at their places in the row; the rest of `disparity` stays. `texture` is that of
    /// each column.
    pub(super) fn answer(
        &mut self,
        kernels: Kernels,
        search: &Search,
        texture: &[i32],
        disparity: &mut [i16],
        cost: &mut [i32],
    ) {
        let Self { columns, block, nothing, choices } = self;
        // SAFETY: as in `advance`.
        unsafe {
            (kernels.choose)(Choose { search, columns, texture, block, nothing, choices });
            let searched = search.first_column..search.first_column + search.columns;
            (kernels.refine)(search, choices, &mut disparity[searched.clone()], &mut cost[searched]);
        }
    }
}

struct Advance<'a> {
    search: &'a Search,
    columns: &'a mut [i16],
    entering: Pair<'a>,
    leaving: Option<Pair<'a>>,
}

/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
unsafe fn advance<L: Lanes, const N: usize>(row: Advance<'_>) {
    let Advance { search, columns, entering, leaving } = row;
    let candidates = count_of::<L, N>(search);
    for (sums, column) in columns.chunks_exact_mut(candidates).zip(-(search.radius as isize)..) {
        let enters = entering.column(search, column);
        // SAFETY: as the caller guarantees; a column has as many sums and bytes as candidates, in whole vectors.
        unsafe {
            match &leaving {
                None => add::<L>(sums, &enters, None),
                Some(leaving) => add::<L>(sums, &enters, Some(&leaving.column(search, column))),
            }
        }
    }
}

/// # Safety
/// As [`advance`]; there are as many sums as bytes in each row, in whole vectors.
#[inline(always)]
unsafe fn add<L: Lanes>(sums: &mut [i16], enters: &Column<'_>, leaves: Option<&Column<'_>>) {
    // SAFETY: as the caller guarantees.
    unsafe {
        for at in (0..sums.len()).step_by(L::BYTES) {
            let sums = sums.as_mut_ptr().add(at);
            let mut change = L::widen(differences::<L>(enters, at));
            if let Some(leaves) = leaves {
                let [low, high] = L::widen(differences::<L>(leaves, at));
                change = [L::sub(change[0], low), L::sub(change[1], high)];
            }
            L::store(sums, L::add(L::load(sums), change[0]));
            let sums = sums.add(L::LANES);
            L::store(sums, L::add(L::load(sums), change[1]));
        }
    }
}

/// # Safety
/// As [`advance`]; there are `L::BYTES` bytes from `at` on.
#[inline(always)]
unsafe fn differences<L: Lanes>(column: &Column<'_>, at: usize) -> L::B {
    // SAFETY: as the caller guarantees.
    let (left, right) = unsafe { (L::splat_bytes(column.left), L::load_bytes(column.right.as_ptr().add(at))) };
    // One of them is zero.
    L::add_bytes(L::sub_bytes(left, right), L::sub_bytes(right, left))
}

struct Choose<'a> {
    search: &'a Search,
    columns: &'a [i16],
    texture: &'a [i32],
    block: &'a mut [i16],
    nothing: &'a [i16],
    choices: &'a mut Choices,
}

/// # Safety
/// As [`advance`].
#[inline(always)]
unsafe fn choose<L: Lanes, const N: usize>(row: Choose<'_>) {
    let candidates = count_of::<L, N>(row.search);
    // SAFETY: as the caller guarantees.
    unsafe {
        if N > 0 {
            choose_with::<L, [L::V; N]>(row, candidates, [L::splat(0); N]);
        } else {
            choose_with::<L, Vec<L::V>>(row, candidates, vec![L::splat(0); candidates / L::LANES]);
        }
    }
}

/// # Safety
/// As [`advance`]; `sums` are vectors of zeros for all candidates.
#[inline(always)]
unsafe fn choose_with<L: Lanes, S: AsMut<[L::V]>>(row: Choose<'_>, candidates: usize, mut sums: S) {
    let Choose { search, columns, texture, block, nothing, choices } = row;
    let (sums, side) = (sums.as_mut(), 2 * search.radius + 1);
    assert!(columns.len() == (search.columns + side - 1) * candidates && texture.len() == search.columns + side - 1);
    assert!(block.len() == candidates && nothing.len() == candidates && sums.len() * L::LANES == candidates);
    let Choices { index, before, here, after } = choices;
    let column = |at: usize| columns[at * candidates..][..candidates].as_ptr();
    // SAFETY: as the caller guarantees; columns, block and sums have the asserted sizes.
    unsafe {
        for at in 0..side - 1 {
            for (lane, sum) in sums.iter_mut().enumerate() {
                *sum = L::add(*sum, L::load(column(at).add(lane * L::LANES)));
            }
        }
        let mut flat: i32 = texture[..side - 1].iter().sum();
        let choices = index.iter_mut().zip(before).zip(here.iter_mut().zip(after)).enumerate();
        for (x, ((index, before), (here, after))) in choices.take(search.columns) {
            let (entering, leaving) = (column(x + side - 1), if x == 0 { nothing.as_ptr() } else { column(x - 1) });
            flat += texture[x + side - 1] - if x == 0 { 0 } else { texture[x - 1] };
            let mut least = L::splat(i16::MAX);
            for (lane, sum) in sums.iter_mut().enumerate() {
                let at = lane * L::LANES;
                *sum = L::add(*sum, L::sub(L::load(entering.add(at)), L::load(leaving.add(at))));
                L::store(block.as_mut_ptr().add(at), *sum);
                least = L::min(least, *sum);
            }
            let least = L::minimum(least);
            let best = first_equal::<L>(block, least);
            let is_valid = flat >= search.texture_threshold && !is_rivalled::<L>(search, block, least, best);
            *index = if is_valid { best as i16 } else { NONE };
            *here = L::first(least);
            // At the ends these are not used; any in range will do.
            *before = *block.get_unchecked(best.saturating_sub(1));
            *after = *block.get_unchecked((best + 1).min(candidates - 1));
        }
    }
}

/// The first of the sums that equals the lanes of `least`, which one does.
///
/// # Safety
/// As [`advance`]; there are whole groups of [`COMPARED`] sums.
#[inline(always)]
unsafe fn first_equal<L: Lanes>(sums: &[i16], least: L::V) -> usize {
    let mut first = 0;
    for at in (0..sums.len()).step_by(2 * COMPARED).rev() {
        // SAFETY: as the caller guarantees.
        let equal = unsafe { compare::<L, true>(sums, at, least) };
        first = if equal == 0 { first } else { at + equal.trailing_zeros() as usize };
    }
    // Whatever the sums are, it is one of them.
    first.min(sums.len() - 1)
}

/// Whether a candidate that is not next to the best one comes within the margin.
///
/// # Safety
/// As [`first_equal`].
#[inline(always)]
unsafe fn is_rivalled<L: Lanes>(search: &Search, sums: &[i16], least: L::V, best: usize) -> bool {
    if search.uniqueness == 0 {
        return false;
    }
    let smallest = i32::from(L::first(least));
    // In OpenCV's 32 bits, which large ratios overflow.
    let limit = smallest.wrapping_add(smallest.wrapping_mul(search.uniqueness) / 100);
    if limit < 0 {
        return false;
    }
    // No sum is larger.
    let above = L::splat(limit.min(i32::from(i16::MAX) - 1) as i16 + 1);
    let mut rivals = 0;
    for at in (0..sums.len()).step_by(2 * COMPARED) {
        // SAFETY: as the caller guarantees.
        let within = unsafe { compare::<L, false>(sums, at, above) };
        rivals |= within & !near_bits(best as i32 - at as i32);
    }
    rivals != 0
}

/// As [`super::choice::refined`], of a whole row.
#[inline(always)]
fn refine(search: &Search, choices: &Choices, disparity: &mut [i16], cost: &mut [i32]) {
    let count = disparity.len();
    let Choices { index, before, here, after } = choices;
    let (index, before, here, after) = (&index[..count], &before[..count], &here[..count], &after[..count]);
    let (cost, last) = (&mut cost[..count], search.disparities as i32 - 1);
    let largest = search.min_disparity + last;
    for x in 0..count {
        let i = i32::from(index[x]);
        let (before, here, after) = (i32::from(before[x]), i32::from(here[x]), i32::from(after[x]));
        let height = before + after - 2 * here + (after - before).abs();
        let inside = i > 0 && i < last && height != 0;
        // Both are below 2^23, hence exact, and so is the quotient cut to an integer: a fractional quotient is farther
        // from the next integer than rounding reaches.
        let step = (((after - before) * 256) as f32 / height.max(1) as f32) as i32;
        let fixed = (largest - i) * 256 + if inside { step } else { 0 };
        disparity[x] = if index[x] == NONE { disparity[x] } else { ((fixed + 15) >> 4) as i16 };
        cost[x] = here;
    }
}

/// The number of candidates: whole vectors of bytes.
#[inline(always)]
fn count_of<L: Lanes, const N: usize>(search: &Search) -> usize {
    let candidates = if N == 0 { search.disparities } else { N * L::LANES };
    assert!(candidates == search.disparities && candidates.is_multiple_of(L::BYTES));
    candidates
}

/// Compiles the kernels in a module of their own: `$lanes`, with the features `$feature`.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! compiled {
    ($name:ident, $lanes:ty $(, $feature:literal)?) => {
        mod $name {
            use super::{Advance, Choices, Choose, Kernels, Search};
            use crate::stereo::lanes::Lanes as _;

            $(#[target_feature(enable = $feature)])?
            unsafe fn advance<const N: usize>(row: Advance<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { super::advance::<$lanes, N>(row) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn choose<const N: usize>(row: Choose<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { super::choose::<$lanes, N>(row) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn refine(search: &Search, choices: &Choices, disparity: &mut [i16], cost: &mut [i32]) {
                super::refine(search, choices, disparity, cost);
            }

            pub(super) fn kernels(candidates: usize) -> Kernels {
                match candidates / <$lanes>::LANES {
                    2 => Kernels { advance: advance::<2>, choose: choose::<2>, refine },
                    4 => Kernels { advance: advance::<4>, choose: choose::<4>, refine },
                    8 => Kernels { advance: advance::<8>, choose: choose::<8>, refine },
                    _ => Kernels { advance: advance::<0>, choose: choose::<0>, refine },
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
compiled!(avx2, crate::stereo::lanes::Avx2, "avx2,bmi1,bmi2,lzcnt,popcnt");
#[cfg(target_arch = "x86_64")]
compiled!(
    avx512,
    crate::stereo::lanes::Avx512,
    "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2"
);
#[cfg(target_arch = "aarch64")]
compiled!(neon, crate::stereo::lanes::Neon); // part of the target, so it needs no feature
