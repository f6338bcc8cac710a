//! Percentiles of samples that lie on disk: exact selection by counting, in three passes of polars' streaming engine.
//!
//! A sample is a [key](super::keys). The first pass counts the keys by their upper bits; from the counts follows in which cell
//! each wanted order statistic lies, and which of the cell it is. The second pass splits those cells by their next bits, the
//! third by the last: what is left is single values. Each pass holds counts only: at most 80 metres x 532 cells of the first
//! (errors up to 80 m), then 10 cells a metre x 2048, then 10 x 1024.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use polars::frame::DataFrame;
use polars::prelude::{
    Column, DataType, Engine, Expr, IntoLazy, JoinArgs, JoinType, LazyFrame, NamedFrom, PlRefPath, PolarsResult,
    ScanArgsParquet, Series, col, len, lit,
};

use super::keys::{bin_m, error_m};
use super::{DistanceBin, PERCENTILES};

/// How many lower bits of a key a cell spans, pass by pass.
const SPANS: [u32; 3] = [21, 10, 0];

/// The bins of one estimator, nearest first, from files that hold one column `key`.
pub(super) fn percentiles(estimator: usize, files: &[PathBuf]) -> PolarsResult<Vec<DistanceBin>> {
    let mut found: Vec<DistanceBin> = Vec::new();
    // What is looked for: the cell it lies in, its rank in there, and the ranks' places in `order`.
    let mut wanted: Vec<Wanted> = Vec::new();
    for (pass, span) in SPANS.into_iter().enumerate() {
        let cells: BTreeSet<u64> = wanted.iter().map(|wanted| wanted.cell).collect();
        let counts = count(files, span, (pass > 0).then(|| (SPANS[pass - 1], cells)))?;
        if pass == 0 {
            found = bins(estimator, &counts);
            wanted = found.iter().enumerate().flat_map(|(bin, found)| order_statistics(bin, found)).collect();
        }
        narrow(&mut wanted, &counts, if pass == 0 { 32 } else { SPANS[pass - 1] });
    }
    let mut statistics: BTreeMap<(usize, usize, bool), f64> = BTreeMap::new();
    for wanted in &wanted {
        statistics.insert((wanted.bin, wanted.percentile, wanted.upper), f64::from(error_m(wanted.cell)));
    }
    for (bin, found) in found.iter_mut().enumerate() {
        for (i, percentile) in PERCENTILES.into_iter().enumerate() {
            let (lower, upper) = (statistics[&(bin, i, false)], statistics[&(bin, i, true)]);
            found.percentiles_m[i] = lower + (upper - lower) * position(percentile, found.count).1;
        }
    }
    Ok(found)
}

/// An order statistic on the way to being found.
struct Wanted {
    bin: usize,
    percentile: usize,
    upper: bool,
    /// The first key of the cell it lies in, as far as is known.
    cell: u64,
    /// Its rank among the keys of that cell, from 0.
    rank: u64,
}

/// Where a percentile lies among `count` sorted samples: the rank below it, and how far it is from there to the next.
fn position(percentile: u32, count: u64) -> (u64, f64) {
    let exact = f64::from(percentile) / 100.0 * (count - 1) as f64;
    (exact.floor() as u64, exact - exact.floor())
}

/// The two samples beside each percentile; their cell is, as yet, the whole bin.
fn order_statistics(bin: usize, found: &DistanceBin) -> impl Iterator<Item = Wanted> {
    let (bin_m, count) = (found.bin_m, found.count);
    PERCENTILES.into_iter().enumerate().flat_map(move |(percentile, p)| {
        let lower = position(p, count).0;
        [(false, lower), (true, (lower + 1).min(count - 1))].map(|(upper, rank)| Wanted {
            bin,
            percentile,
            upper,
            cell: u64::from(bin_m) << 32,
            rank,
        })
    })
}

/// The metres that hold samples, and how many, from the counts of the first pass.
fn bins(estimator: usize, counts: &BTreeMap<u64, u64>) -> Vec<DistanceBin> {
    let mut bins: Vec<DistanceBin> = Vec::new();
    for (cell, count) in counts {
        let bin_m = bin_m(*cell);
        match bins.last_mut().filter(|bin| bin.bin_m == bin_m) {
            Some(bin) => bin.count += count,
            None => bins.push(DistanceBin { estimator, bin_m, count: *count, percentiles_m: [f64::NAN; 5] }),
        }
    }
    bins
}

/// Finds, for everything wanted, the counted cell inside its cell of `before` bits.
fn narrow(wanted: &mut [Wanted], counts: &BTreeMap<u64, u64>, before: u32) {
    for wanted in wanted {
        let inside = wanted.cell..wanted.cell + (1 << before);
        for (&cell, &count) in counts.range(inside) {
            wanted.cell = cell;
            if wanted.rank < count {
                break;
            }
            wanted.rank -= count;
        }
    }
}

/// How many keys each cell of `span` bits holds; of those in the given cells of a wider span only, if any are given.
fn count(files: &[PathBuf], span: u32, within: Option<(u32, BTreeSet<u64>)>) -> PolarsResult<BTreeMap<u64, u64>> {
    let paths = files.iter().map(|file| PlRefPath::try_from_path(file)).collect::<PolarsResult<Vec<_>>>()?;
    let mut keys = LazyFrame::scan_parquet_files(paths.into(), ScanArgsParquet::default())?;
    if let Some((wide, cells)) = within {
        let cells = cells.into_iter().collect::<Vec<_>>();
        let cells = DataFrame::new(cells.len(), vec![Column::from(Series::new("wide".into(), cells))])?;
        let keys_with_cells = keys.with_column(cell_of(wide).alias("wide"));
        // The cells are unique: the join keeps the keys inside them, once each.
        keys = keys_with_cells.join(cells.lazy(), [col("wide")], [col("wide")], JoinArgs::new(JoinType::Inner));
    }
    let counted = keys.group_by([cell_of(span).alias("cell")]).agg([len().cast(DataType::UInt64).alias("count")]);
    let counted = counted.collect_with_engine(Engine::Streaming)?.unwrap_single();
    let (cells, counts) = (counted.column("cell")?.u64()?, counted.column("count")?.u64()?);
    Ok(cells.iter().zip(counts.iter()).filter_map(|(cell, count)| Some((cell?, count?))).collect())
}

/// The first key of a key's cell: the key without its lowest bits. (An integer division would need one more feature of polars.)
fn cell_of(span: u32) -> Expr {
    col("key") - col("key") % lit(1_u64 << span)
}
