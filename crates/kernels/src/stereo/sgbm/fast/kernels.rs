//! The kernels as compiled for each instruction set.
//!
//! Each is compiled for the numbers of disparities that people use, where whole loops become straight code and paths
//! stay in registers, and once for any number.

use super::aggregate::{self, Aggregate};
use super::block_costs::{self, BlockRows};
use super::costs::{self, CostRow};
use super::decide::{self, Decide};
use super::right_view::{self, RightRow};
use crate::filter::median::integer::median3_row;
use crate::stereo::lanes::{Lanes, Portable};
use crate::stereo::sgbm::prefilter::Planes;
use crate::stereo::sgbm::search::Search;
use crate::stereo::sgbm::view::View;

/// One instruction set's kernels, for one number of disparities.
///
/// # Safety
/// Each function's own; and the creator of the table detected the instruction set on this machine.
#[derive(Clone, Copy)]
pub(super) struct Kernels {
    /// Padding of path slots that keeps their vectors aligned.
    pub padding: usize,
    pub planes: unsafe fn(&mut Planes, &Search, &View<'_>, usize, bool),
    pub cost_row: unsafe fn(&mut CostRow<'_>),
    pub block_costs: unsafe fn(&mut BlockRows<'_>),
    pub aggregate: unsafe fn(&Aggregate<'_>),
    pub decide: unsafe fn(&mut [Decide<'_>]),
    /// `decide` for rows whose ambiguity or totals are wanted.
    pub decide_more: unsafe fn(&mut [Decide<'_>]),
    pub right_view: unsafe fn(&mut RightRow<'_>),
    pub median: unsafe fn([&[i16]; 3], &mut [i16]),
}

/// Compiles the kernels in a module of their own: `$lanes`, with the features `$feature`.
macro_rules! compiled {
    ($name:ident, $lanes:ty $(, $feature:literal)?) => {
        pub(super) mod $name {
            use super::{Aggregate, BlockRows, CostRow, Decide, Kernels, Lanes, Planes, RightRow, Search, View, aggregate, block_costs, costs, decide, median3_row, right_view};

            $(#[target_feature(enable = $feature)])?
            unsafe fn planes(planes: &mut Planes, search: &Search, image: &View<'_>, y: usize, reversed: bool) {
                planes.fill(search, image, y, reversed);
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn cost_row<const N: usize>(row: &mut CostRow<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { costs::cost_row::<$lanes, N>(row) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn block_costs<const N: usize>(rows: &mut BlockRows<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { block_costs::block_costs::<$lanes, N>(rows) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn aggregate<const N: usize>(part: &Aggregate<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { aggregate::aggregate::<$lanes, N>(part) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn decide<const N: usize, const MORE: bool>(rows: &mut [Decide<'_>]) {
                // SAFETY: as `Kernels` says.
                unsafe { decide::decide::<$lanes, N, MORE>(rows) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn right_view<const N: usize>(row: &mut RightRow<'_>) {
                // SAFETY: as `Kernels` says.
                unsafe { right_view::right_view::<$lanes, N>(row) }
            }

            $(#[target_feature(enable = $feature)])?
            unsafe fn median(rows: [&[i16]; 3], out: &mut [i16]) {
                median3_row(rows, out);
            }

            fn table<const N: usize>() -> Kernels {
                let padding = <$lanes>::LANES.max(aggregate::LEAST_PADDING);
                let (cost_row, block_costs, right_view) = (cost_row::<N>, block_costs::<N>, right_view::<N>);
                let aggregate = aggregate::<N>;
                let (decide, decide_more) = (decide::<N, false>, decide::<N, true>);
                Kernels { padding, planes, cost_row, block_costs, aggregate, decide, decide_more, right_view, median }
            }

            pub(crate) fn kernels(disparities: usize) -> Kernels {
                match disparities / <$lanes>::LANES {
                    2 => table::<2>(),
                    3 => table::<3>(),
                    4 => table::<4>(),
                    6 => table::<6>(),
                    8 => table::<8>(),
                    _ => table::<0>(),
                }
            }
        }
    };
}

compiled!(portable, super::Portable);
#[cfg(target_arch = "x86_64")]
compiled!(avx2, crate::stereo::lanes::Avx2, "avx2");
#[cfg(target_arch = "x86_64")]
compiled!(
    avx512,
    crate::stereo::lanes::Avx512,
    "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2"
);
#[cfg(target_arch = "aarch64")]
compiled!(neon, crate::stereo::lanes::Neon); // part of the target, so it needs no feature
