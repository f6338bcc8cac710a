//! A comparison by distance as a table.

use depthloom_graphs::Key;

use super::super::{CompareOptions, few_frames, significance};
use super::{DistancePair, DistanceRow, Handover, Near, Statistic};
use crate::statistics::{Interval, Resampling};
use crate::tables::{Column, DIMENSIONLESS, Rows, Table};

/// Estimates compared with others by distance: one row per bin, statistic and pair.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceComparison {
    pub(crate) pairs: Vec<DistancePair>,
    /// A row per bin, statistic and pair.
    pub table: Table,
    pub(super) resampling: Resampling,
    /// The key of the plan of the baseline's run.
    pub key: Key,
}

pub(super) fn comparison(
    pairs: Vec<DistancePair>,
    mut notes: Vec<String>,
    options: &CompareOptions,
    key: Key,
    several_runs: bool,
) -> DistanceComparison {
    let rows: Vec<(&DistancePair, &DistanceRow)> =
        pairs.iter().flat_map(|pair| pair.rows.iter().map(move |row| (pair, row))).collect();
    let resampling = options.resampling;
    let handovers = pairs.iter().flat_map(|pair| pair.handovers.iter().map(move |handover| (pair, handover)));
    notes
        .splice(0..0, handovers.map(|(pair, (by, handover))| handover_note(pair, *by, handover.as_ref(), &resampling)));
    notes.extend(few_frames(pairs.iter().map(|pair| pair.frames).min().unwrap_or(0), "frame"));
    let titles: Vec<String> = pairs
        .iter()
        .map(|pair| format!("{} compared with {}", pair.estimates[1].title, pair.estimates[0].title))
        .collect();
    let selected = if options.selection.frames.is_some() { " of the selected frames" } else { "" };
    let about = format!(
        "absolute error by ground-truth distance, metres, {}: pixels{selected} that are valid in both; interval of the difference: {}; p_holm: Wilcoxon signed rank over \
         frames, two-sided, corrected for the bins of a statistic; verdict: p_holm below {} and an interval without 0",
        titles.join(", "),
        resampling.about(),
        significance(&resampling)
    );
    let begins = |at: usize| {
        at == 0 || !std::ptr::eq(rows[at].0, rows[at - 1].0) || rows[at].1.statistic != rows[at - 1].1.statistic
    };
    let starts: Vec<usize> = (0..rows.len()).filter(|&at| begins(at)).collect();
    let table = Table {
        about,
        label: "compared-by-distance".to_owned(),
        gaps: starts.iter().copied().skip(1).collect(),
        starts,
        notes,
        ..Table::new(columns(&rows, several_runs || pairs.len() > 1, &resampling))
    };
    DistanceComparison { pairs, table, resampling, key }
}

/// A note on the handover distance.
fn handover_note(
    pair: &DistancePair,
    statistic: Statistic,
    handover: Option<&Handover>,
    resampling: &Resampling,
) -> String {
    let (by, [baseline, other]) = (statistic.name(), &pair.estimates);
    let Some(Handover { near, distance_m, interval, share, crossings_m }) = handover else {
        return format!(
            "by the {by}, there is no handover between {} and {}: one estimate alone has the smallest sum of errors",
            baseline.title, other.title
        );
    };
    let (near, far) = match near {
        Near::Baseline => (&baseline.title, &other.title),
        Near::Other => (&other.title, &baseline.title),
    };
    let interval = interval.map_or_else(String::new, |Interval { low, high }| {
        let share = if *share < 1.0 { format!(", in {:.0} % of resamples", 100.0 * share) } else { String::new() };
        format!(" ({} from {low:.1} to {high:.1} m{share})", resampling.level())
    });
    let crossings = match crossings_m.len() {
        0 | 1 => String::new(),
        count => format!("; the difference crosses zero {count} times"),
    };
    format!("by the {by}, use {near} up to {distance_m:.1} m and {far} beyond{interval}{crossings}")
}

fn columns(pairs: &[(&DistancePair, &DistanceRow)], several_pairs: bool, resampling: &Resampling) -> Vec<Column> {
    let rows = Rows(pairs);
    let is_whole = |edge: f64| edge.fract() == 0.0;
    let decimals = if pairs.iter().all(|(_, row)| is_whole(row.from_m) && is_whole(row.to_m)) { 0 } else { 2 };
    let probability = |p: f64| (p, if p < 1e-4 { format!("{p:.0e}") } else { format!("{p:.4}") });
    let interval = |row: &DistanceRow| {
        row.interval.map_or_else(|| "-".to_owned(), |of| format!("[{:+.3}, {:+.3}]", of.low, of.high))
    };
    let mut columns = vec![
        rows.key("stage", |(pair, _)| &pair.estimates[1].stage).in_files(),
        rows.key("variant", |(pair, _)| pair.estimates[1].variant.as_ref()).in_files(),
        rows.key("estimate", |(pair, _)| &pair.estimates[1].estimate).in_files(),
        rows.key("run", |(pair, _)| &pair.estimates[1].run).in_files(),
        rows.key("baseline_run", |(pair, _)| &pair.estimates[0].run).in_files(),
        rows.key("baseline_stage", |(pair, _)| &pair.estimates[0].stage).in_files(),
        rows.key("baseline_variant", |(pair, _)| pair.estimates[0].variant.as_ref()).in_files(),
        rows.key("baseline_estimate", |(pair, _)| &pair.estimates[0].estimate).in_files(),
    ];
    if several_pairs {
        columns.push(rows.key("other", |(pair, _)| &pair.estimates[1].title).once().in_text());
    }
    columns.extend([
        rows.key("statistic", |(_, row)| row.statistic.name()).once(),
        rows.number("bin_from_m", |(_, row)| row.from_m).decimals(decimals).unit("m").key().latex("from (m)"),
        rows.number("bin_to_m", |(_, row)| row.to_m).decimals(decimals).unit("m").key().latex("to (m)"),
        rows.count("pixels", |(_, row)| row.pixels).unit("pixels"),
        rows.count("frames", |(_, row)| row.frames as u64).unit("frames"),
        rows.number("baseline_m", |(_, row)| row.baseline_m).unit("m").latex("baseline (m)"),
        rows.number("value_m", |(_, row)| row.value_m).unit("m").latex("value (m)"),
        rows.number("difference_m", |(_, row)| row.difference_m()).unit("m").latex("difference (m)"),
        rows.text(format!("{} interval", resampling.level()), |(_, row)| interval(row)).in_text(),
        rows.number("difference_low_m", |(_, row)| row.interval.map(|of| of.low)).unit("m").in_files(),
        rows.number("difference_high_m", |(_, row)| row.interval.map(|of| of.high)).unit("m").in_files(),
        rows.count("wins", |(_, row)| row.wins).unit("frames").in_files(),
        rows.count("ties", |(_, row)| row.ties).unit("frames").in_files(),
        rows.count("losses", |(_, row)| row.losses).unit("frames").in_files(),
        rows.text("+/=/-", |(_, DistanceRow { wins, ties, losses, .. })| format!("{wins}/{ties}/{losses}")).in_text(),
        rows.number("p", |(_, row)| row.test.map(|test| test.p)).unit(DIMENSIONLESS).in_files(),
        rows.text("p_from", |(_, row)| row.test.map(|test| test.distribution.name())).in_files(),
        rows.written("p_holm", |(_, row)| row.p_holm.map(probability)).unit(DIMENSIONLESS).latex("$p$ (Holm)"),
        rows.text("verdict", |(_, row)| row.verdict.name()),
    ]);
    columns
}
