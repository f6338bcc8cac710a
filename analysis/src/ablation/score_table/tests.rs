use depthloom_graphs::plan::{FrameIndex, RunId};
use std::sync::Arc;

use depthloom_graphs::Key;
use depthloom_recording::RecordedPlan;
use depthloom_scores::{ScoreRow, Settings};
use serde::Deserialize as _;
use serde_json::json;

use super::*;
use crate::estimates::Estimate;
use crate::scores::FrameScore;

fn estimate(variant: Option<&str>, name: &str, sets: &[PixelSet]) -> Estimate {
    let label = variant.map_or_else(|| name.to_owned(), |variant| format!("{variant}/{name}"));
    Estimate::of_depths(&label, variant, name, sets)
}

fn estimates() -> Vec<Estimate> {
    vec![
        estimate(None, "stereo", &[PixelSet::Valid, PixelSet::All]),
        estimate(Some("full"), "mono", &[PixelSet::All]),
        estimate(Some("full"), "fused", &[PixelSet::All]),
        estimate(Some("no_scaling"), "mono", &[PixelSet::All]),
        estimate(Some("no_scaling"), "fused", &[PixelSet::All]),
    ]
}

/// A score of frame `frame`: all eight metrics are `value`, except rmse, which is ten times it.
fn score(frame: &str, estimate: usize, set: PixelSet, value: f64) -> FrameScore {
    let values = Family::Depth.defaults().into_iter();
    let values = values.map(|metric| (metric, if metric.name == "rmse" { 10.0 * value } else { value }));
    let row = ScoreRow { pixels: 5, truth: 8, valid: 5, ..ScoreRow::new(set, "") };
    let row = values.fold(row, |row, (metric, value)| row.with(metric, value));
    FrameScore { frame: Arc::from(frame), position: FrameIndex(frame.parse().unwrap()), estimate, row }
}

/// A row with some scores changed.
fn changed(row: &ScoreRow, to: impl Fn(&str) -> Option<f64>) -> ScoreRow {
    let mut row = row.clone();
    row.scores.iter_mut().for_each(|(metric, value)| *value = to(metric.name).unwrap_or(*value));
    row
}

fn scores() -> Vec<FrameScore> {
    let mut scores = Vec::new();
    for (frame, shift) in [("0", 0.0), ("1", 0.2)] {
        scores.push(score(frame, 0, PixelSet::Valid, 0.7 + shift));
        for (estimate, value) in [0.3, 0.4, 0.5, 0.6, 0.7].into_iter().enumerate() {
            scores.push(score(frame, estimate, PixelSet::All, value + shift));
        }
    }
    scores
}

fn table(with_paper: bool) -> ScoreTable {
    table_of(&scores(), &estimates(), with_paper)
}

fn table_of(scores: &[FrameScore], estimates: &[Estimate], with_paper: bool) -> ScoreTable {
    table_of_sources(scores, estimates, with_paper, &|_, _| None)
}

fn table_of_sources(
    scores: &[FrameScore],
    estimates: &[Estimate],
    with_paper: bool,
    source: &dyn Fn(RunId, FrameIndex) -> Option<Key>,
) -> ScoreTable {
    let plan =
        json!({ "experiment": "street_1", "description": "", "variants": [], "every": 1, "view": false, "runs": [] });
    let plan = RecordedPlan::deserialize(plan).unwrap();
    let ablation = Ablation::new(&plan, estimates, scores, source, None);
    let all = Selection::default();
    let rows = ablation.rows_on_all_sets(&all).unwrap();
    ScoreTable::new(&ablation, &rows, &all, with_paper, None, &|| false).unwrap()
}

/// The marked columns of each line.
fn marked(table: &ScoreTable) -> [Vec<usize>; 8] {
    std::array::from_fn(|line| (0..table.rows.len()).filter(|row| table.rows[*row].marks[line] == Mark::Best).collect())
}

#[test]
fn means_are_over_the_frames_that_all_estimates_have() {
    let mut scores = scores();
    // An estimate failed on frame 2, so the frame does not count for any estimate.
    scores.extend((0..4).map(|estimate| score("2", estimate, PixelSet::All, 0.0)));
    let table = table_of(&scores, &estimates(), false);
    assert_eq!(table.rows.len(), 6);
    for (column, mean) in table.rows.iter().zip([0.8, 0.4, 0.5, 0.6, 0.7, 0.8]) {
        assert_eq!(column.frames, 2);
        assert!((column.values[0].unwrap() - mean).abs() < 1e-12, "{column:?}");
        assert!((column.values[5].unwrap() - 10.0 * mean).abs() < 1e-12, "{column:?}");
    }
    assert_eq!(table.about(), "mean over 2 frames");
}

#[test]
fn a_frame_without_pixels_does_not_count_and_is_reported() {
    let mut scores = scores();
    scores[0].row = ScoreRow::new(PixelSet::Valid, "");
    let table = table_of(&scores, &estimates(), false);
    assert_eq!((table.rows[0].frames, table.rows[1].frames), (1, 2));
    assert!((table.rows[0].values[0].unwrap() - 0.9).abs() < 1e-12);
    assert_eq!(table.about(), "mean over 2 frames (stereo on valid: 1)");
}

#[test]
fn means_over_pixels_weigh_all_pixels_equally_and_are_described() {
    let estimate_with = |mean| Estimate { mean, ..estimate(None, "mono", &[PixelSet::All]) };
    let mut rows = [score("0", 0, PixelSet::All, 0.5), score("1", 0, PixelSet::All, 0.8)];
    // 5 pixels of 8, and 15 of 16.
    (rows[1].row.pixels, rows[1].row.valid, rows[1].row.truth) = (15, 15, 16);
    let table = |mean| table_of(&rows, &[estimate_with(mean)], false);
    let (frames, pixels) = (table(Mean::Frames), table(Mean::Pixels));
    let close = |ours: Option<f64>, expected: f64| assert!((ours.unwrap() - expected).abs() < 1e-12, "{ours:?}");
    close(frames.rows[0].values[0], 0.65);
    close(pixels.rows[0].values[0], (5.0 * 0.5 + 15.0 * 0.8) / 20.0);
    close(pixels.rows[0].values[5], ((5.0 * 25.0 + 15.0 * 64.0_f64) / 20.0).sqrt());
    close(pixels.rows[0].density, 20.0 / 24.0);
    assert_eq!((frames.about(), pixels.about()), ("mean over 2 frames".into(), "over all pixels of 2 frames".into()));
}

#[test]
fn no_scores_make_a_table_of_dashes() {
    let table = table_of(&[], &estimates(), false);
    assert!(table.rows.iter().all(|column| column.frames == 0 && column.values == vec![None; 8]));
    assert!(table.table().markdown().contains("| a1 (< 1.25) ↑ | - | - |"), "{}", table.table().markdown());
    assert_eq!(marked(&table), [const { Vec::<usize>::new() }; 8]);
    assert_eq!(table.marks(), None);
}

#[test]
fn the_long_form_identifies_each_row() {
    let csv = String::from_utf8(table(true).table().csv()).unwrap();
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let mut expected = ["stage", "variant", "estimate", "set"].map(str::to_owned).to_vec();
    let eight = || Family::Depth.defaults().into_iter().map(|metric| metric.name);
    expected.extend(eight().map(str::to_owned));
    expected.push("frames".to_owned());
    expected.extend(eight().map(|name| format!("paper_{name}")));
    expected.push("density".to_owned());
    assert_eq!(lines[0], expected);
    let rows = serde_json::to_value(table(true).json_rows()).unwrap();
    assert_eq!(rows[0].as_object().unwrap().keys().collect::<Vec<_>>(), lines[0]);
    let keys: Vec<String> = lines[1..].iter().map(|line| line[..4].join(" ")).collect();
    let expected = ["s  stereo valid", "s  stereo all", "s full mono all", "s full fused all", "s no_scaling mono all"];
    assert_eq!((&keys[..5], lines[6][13]), (expected.map(str::to_owned).as_slice(), "0.85"));
}

#[test]
fn the_best_value_is_among_rows_over_all_pixels() {
    let marked = marked(&table(false));
    assert_eq!((&marked[0][..], &marked[5][..]), ([5].as_slice(), [1].as_slice()));
    assert_eq!(table(false).marks(), Some("best over all pixels with ground truth"));
}

#[test]
fn disparities_have_a_best_value_on_every_comparable_set() {
    let d1 = Metric::named("d1").unwrap();
    let disparity = |variant: &str| Estimate {
        family: Family::Disparity,
        settings: None,
        metrics: vec![d1],
        sets: PixelSet::ALL.to_vec(),
        ..estimate(Some(variant), "disparity", &[])
    };
    let mut estimates = estimates();
    estimates.extend([disparity("full"), disparity("no_scaling")]);
    let mut scores = scores();
    for frame in ["0", "1"] {
        for (estimate, value) in [(5, 0.3), (6, 0.2)] {
            for set in PixelSet::ALL {
                let row = ScoreRow { pixels: 8, truth: 8, valid: 7, ..ScoreRow::new(set, "") }.with(d1, value);
                scores.push(FrameScore { row, ..score(frame, estimate, set, 0.0) });
            }
        }
    }
    let table = table_of(&scores, &estimates, false);
    let line = table.metrics.iter().position(|metric| metric.name == "d1").unwrap();
    let marked: Vec<(&str, PixelSet)> = (0..table.rows.len())
        .filter(|row| table.rows[*row].marks[line] == Mark::Best)
        .map(|row| (table.rows[row].label.as_str(), table.rows[row].set))
        .collect();
    assert_eq!(marked, [("no_scaling/disparity", PixelSet::Filled), ("no_scaling/disparity", PixelSet::All)]);
    assert!(table.table().latex().contains("\\textbf{") && table.table().markdown().contains("**"));
}

#[test]
fn fault_02_frames_are_identified_by_position_not_by_id() {
    // The same frame requested twice, and a frame of another street with the same id.
    let mut scores = Vec::new();
    for (position, shift) in [(0, 0.0), (1, 0.0), (2, 0.3)] {
        let rows = [(0, PixelSet::Valid), (0, PixelSet::All), (1, PixelSet::All)];
        let row =
            |(estimate, set)| FrameScore { position: FrameIndex(position), ..score("7", estimate, set, 0.3 + shift) };
        scores.extend(rows.map(row));
    }
    let table = table_of(&scores, &estimates()[..2], false);
    assert_eq!(table.about(), "mean over 3 frames");
    assert!(table.rows.iter().all(|column| (column.values[0].unwrap() - 0.4).abs() < 1e-12), "{table:?}");
}

#[test]
fn fault_20_only_comparable_values_are_marked() {
    let none = [const { Vec::<usize>::new() }; 8];
    let two = |first: &Estimate, second: &Estimate, frames: [&[&str]; 2]| {
        let rows = |i: usize| frames[i].iter().map(move |frame| score(frame, i, PixelSet::All, 0.5 + 0.1 * i as f64));
        table_of(&rows(0).chain(rows(1)).collect::<Vec<_>>(), &[first.clone(), second.clone()], false)
    };
    let (mono, fused) = (estimate(Some("a"), "mono", &[PixelSet::All]), estimate(Some("a"), "fused", &[PixelSet::All]));
    let same = two(&mono, &fused, [&["0", "1"], &["0", "1"]]);
    assert_eq!((&marked(&same)[0][..], &marked(&same)[3][..]), ([1].as_slice(), [0].as_slice()));
    let elsewhere = Estimate { run: RunId(1), ..fused.clone() };
    assert_eq!(
        marked(&two(&mono, &elsewhere, [&["0", "1"], &["0", "1"]])),
        marked(&same),
        "another run on the same frames"
    );
    assert_eq!(marked(&two(&mono, &elsewhere, [&["0", "1"], &["0", "2"]])), none, "other frames");
    assert_eq!(marked(&two(&mono, &elsewhere, [&["0", "1"], &["0"]])), none, "fewer frames");
    let capped = Settings { max_m: 50.0, ..Settings::default() };
    let capped = Estimate { settings: Some(capped), ..fused.clone() };
    assert_eq!(marked(&two(&mono, &capped, [&["0"], &["0"]])), none, "scored in another way");
    let other_truth = Estimate { truth_output: Some("/s/lidar/depth".to_owned()), ..fused };
    assert_eq!(marked(&two(&mono, &other_truth, [&["0"], &["0"]])), none, "against other ground truth");
    assert_eq!(
        marked(&table_of(&[score("0", 0, PixelSet::All, 0.5)], std::slice::from_ref(&mono), false)),
        none,
        "alone"
    );
    let valid = [mono.clone(), mono].map(|mono| Estimate { sets: vec![PixelSet::Valid], ..mono });
    let rows = [0, 1].map(|i| score("0", i, PixelSet::Valid, 0.5));
    assert_eq!(marked(&table_of(&rows, &valid, false)), none, "on the pixels valid in each");
}

#[test]
fn fault_20_frames_of_different_sources_with_equal_ids_differ() {
    let estimates = [estimate(Some("a"), "mono", &[PixelSet::All]), estimate(Some("b"), "mono", &[PixelSet::All])];
    let estimates = [estimates[0].clone(), Estimate { run: RunId(1), ..estimates[1].clone() }];
    let rows = [score("0", 0, PixelSet::All, 0.5), score("0", 1, PixelSet::All, 0.6)];
    let key = |run: RunId, _: FrameIndex| Some(Key::of_content(&[run.0 as u8]));
    let table = table_of_sources(&rows, &estimates, false, &key);
    assert_eq!(table.marks(), None);
    assert!(table_of(&rows, &estimates, false).marks().is_some(), "of one source they would be");
}

#[test]
fn fault_42_an_estimate_without_valid_pixels_is_never_best() {
    let mut rows = vec![score("0", 0, PixelSet::All, 0.5), score("0", 1, PixelSet::All, 0.6)];
    // An estimate that is invalid everywhere: no pixel is near, and the spread of the log error is that of the ground
    // truth.
    rows.push(FrameScore {
        row: changed(&rows[0].row, |metric| match metric {
            "a1" | "a2" | "a3" => Some(0.0),
            "silog" => Some(0.01),
            _ => None,
        }),
        estimate: 2,
        ..rows[0].clone()
    });
    let estimates = ["mono", "fused", "absent"].map(|name| estimate(None, name, &[PixelSet::All]));
    assert_eq!(marked(&table_of(&rows, &estimates, false))[7], [0]);
    // A mean that is not finite is never best, in either direction.
    rows[2].row = changed(&rows[0].row, |metric| match metric {
        "a1" => Some(f64::INFINITY),
        "silog" => Some(f64::NEG_INFINITY),
        _ => None,
    });
    let marked = marked(&table_of(&rows, &estimates, false));
    assert_eq!((&marked[0][..], &marked[7][..]), ([1].as_slice(), [0].as_slice()));
}

#[test]
fn terminal_text() {
    insta::assert_snapshot!("terminal", table(false).table().terminal(200));
    insta::assert_snapshot!("terminal_narrow_with_paper", table(true).table().terminal(70));
}

#[test]
fn markdown_text() {
    insta::assert_snapshot!("markdown", table(true).table().markdown());
}

#[test]
fn fault_38_latex_tables_fit_the_page() {
    let names: Vec<String> = (0..48).map(|i| format!("variant_{i}")).collect();
    let of_variant = |name: &String| ["mono", "fused"].map(|kind| estimate(Some(name), kind, &[PixelSet::All]));
    let many: Vec<Estimate> = names.iter().flat_map(of_variant).collect();
    let rows: Vec<FrameScore> = (0..many.len()).map(|i| score("0", i, PixelSet::All, 0.5)).collect();
    let latex = table_of(&rows, &many, false).table().latex();
    assert!(!latex.contains("resizebox"));
    let blocks: Vec<usize> = latex
        .lines()
        .filter_map(|line| line.strip_prefix("\\begin{tabular}"))
        .map(|columns| columns.matches('r').count())
        .collect();
    assert_eq!(blocks.iter().sum::<usize>(), 96);
    assert!(blocks.iter().all(|columns| (2..=8).contains(columns)), "{blocks:?}");

    let lone = table_of(&rows[..1], &many[..1], true).table().latex();
    assert!(lone.contains("\\begin{table}[t]") && lone.contains("\\label{tab:street-1-scores}"), "{lone}");
    assert!(!lone.contains("\\textbf{0") && !lone.contains("in bold"), "a single column has no best: {lone}");
    let with_paper = table(true);
    for text in [with_paper.table().latex(), with_paper.table().markdown()] {
        assert!(
            text.contains("{0.800} (0.85)") || text.contains("**0.800** (0.85)"),
            "the published number is not bold: {text}"
        );
    }
}

#[test]
fn latex_text() {
    insta::assert_snapshot!("latex", table(true).table().latex());
}
