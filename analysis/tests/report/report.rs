//! The files of a report.
#![expect(clippy::unwrap_used, reason = "what the tests share fails as they do")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use depthloom_analysis::{
    AnalysisError, FrameChoice, Question, Ranking, ReportOptions, Selection, Summary, answer, report,
};
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{NodeId, Origin as Wire, Plan, PlannedInput, PortId};
use depthloom_graphs::{Port, ValueType};
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;
use serde_json::{Value as Json, json};

use crate::fixture::{self, ESTIMATES, FRAMES};

/// The key columns, then the columns of `../shared/oracle/golden/ground_plane/scores.csv`.
const SCORE_COLUMNS: &str =
    "stage,variant,estimate,set,zone,position,frame,pixels,a1,a2,a3,abs_rel,sq_rel,rmse,rmse_log,silog,density";
const FILES: [&str; 10] = [
    "error_vs_distance.csv",
    "error_vs_distance.parquet",
    "error_vs_distance.svg",
    "scores.csv",
    "scores.parquet",
    "table.csv",
    "table.md",
    "table.parquet",
    "table.tex",
    "true_distances.csv",
];

fn report_of(folder: &Path, every: u64, keep_b: bool, options: ReportOptions) -> Summary {
    let path = folder.join("recording.mcap");
    fixture::record(&path, &fixture::plan(every, keep_b));
    let out = folder.join("report");
    fs::create_dir(&out).unwrap();
    report(&Recording::open(&path).unwrap(), &out, &options, &|| false).unwrap()
}

fn lines(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

/// The variant and name of a label, as columns have them.
fn named(label: &str) -> [String; 2] {
    let (variant, name) = label.split_once('/').unwrap_or(("", label));
    [variant.to_owned(), name.to_owned()]
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap_or_else(|error| panic!("`{cell}`: {error}"))
}

#[test]
fn scores_equal_the_recorded_ones_in_the_order_of_the_oracle() {
    let folder = tempfile::tempdir().unwrap();
    report_of(folder.path(), 1, true, ReportOptions::default());
    let written = lines(&folder.path().join("report/scores.csv"));
    assert_eq!(written[0].join(","), SCORE_COLUMNS);
    let mut expected = Vec::new();
    for index in (0..FRAMES).filter(|&index| fixture::has_truth(index)) {
        let rows = fixture::rows(index);
        // Shared estimates come first; all pixels before the valid ones.
        for (set, estimates) in [(PixelSet::All, [2, 0, 1].as_slice()), (PixelSet::Valid, &[2])] {
            for &i in estimates.iter().filter(|&&i| fixture::valid(index, i)) {
                let row = rows[i].iter().find(|row| row.set == set).unwrap();
                expected.push((index, ESTIMATES[i].0, row.clone()));
            }
        }
    }
    assert_eq!(written.len() - 1, expected.len());
    for (cells, (index, label, row)) in written[1..].iter().zip(expected) {
        assert_eq!(cells[1..3], named(label));
        assert_eq!((&*cells[0], &*cells[3], &*cells[4]), ("compare", row.set.name(), ""));
        assert_eq!(cells[5..8], [index.to_string(), format!("{index:06}_10"), row.pixels.to_string()]);
        let scores: Vec<f64> = cells[8..].iter().map(|cell| number(cell)).collect();
        let expected = row.scores.iter().map(|(_, score)| *score).chain(row.density());
        assert_eq!(scores, expected.collect::<Vec<_>>());
    }
}

#[test]
fn the_table_is_the_mean_over_complete_frames() {
    let folder = tempfile::tempdir().unwrap();
    let summary = report_of(folder.path(), 1, true, ReportOptions { paper: true, ..ReportOptions::default() });
    let table = lines(&folder.path().join("report/table.csv"));
    let common: Vec<u64> = (0..FRAMES - 2).collect();
    for cells in &table[1..] {
        let i = ESTIMATES.iter().position(|(label, ..)| named(label) == cells[1..3]).unwrap();
        let row = |index: &u64| fixture::rows(*index)[i].iter().find(|row| row.set.name() == cells[3]).unwrap().clone();
        for score in 0..8 {
            let mean = common.iter().map(|index| row(index).scores[score].1).sum::<f64>() / common.len() as f64;
            assert!((number(&cells[4 + score]) - mean).abs() < 1e-12, "{cells:?}");
        }
        assert_eq!(cells[12], common.len().to_string());
    }
    assert_eq!(table.len(), 1 + 4);
    assert!(summary.text.starts_with("mean over 7 frames"), "{}", summary.text);
    assert!(summary.text.contains("1 frame failed"), "{}", summary.text);
    // The paper has stereo on both pixel sets, and no variants `a` and `b`.
    let rows = serde_json::to_value(&summary.rows).unwrap();
    let paper: Vec<bool> = rows.as_array().unwrap().iter().map(|row| row["paper_a1"].is_number()).collect();
    assert_eq!(paper, [true, true, false, false]);
}

#[test]
fn errors_against_distance_equal_those_of_the_recorded_maps() {
    let folder = tempfile::tempdir().unwrap();
    report_of(folder.path(), 1, true, ReportOptions::default());
    let written = lines(&folder.path().join("report/error_vs_distance.csv"));
    assert_eq!(
        written[0].join(","),
        "stage,variant,estimate,set,bin_from_m,bin_to_m,count,error_p5_m,error_p25_m,error_p50_m,error_p75_m,error_p95_m"
    );
    let (written, common): (Vec<_>, Vec<_>) = written[1..].iter().cloned().partition(|cells| cells[3] == "valid");
    assert!(!common.is_empty() && common.iter().all(|cells| cells[3] == "common"));
    // On the common pixels, each estimate has the same count in a bin.
    let counts = |estimate: &str| -> Vec<(String, String)> {
        let own = common.iter().filter(|cells| cells[1..3] == named(estimate));
        own.map(|cells| (cells[4].clone(), cells[6].clone())).collect()
    };
    assert!(ESTIMATES.iter().all(|(label, ..)| counts(label) == counts("stereo")));
    let mut expected = Vec::new();
    for i in [2, 0, 1] {
        let mut bins: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
        for index in (0..FRAMES).filter(|&index| fixture::has_truth(index) && fixture::valid(index, i)) {
            let maps = fixture::maps(index);
            for (t, y) in maps[0].iter().zip(&maps[1 + i]).filter(|(t, y)| **t < 80.0 && y.is_finite()) {
                bins.entry(*t as u32).or_default().push((f64::from(*y).min(80.0) - f64::from(*t)).abs());
            }
        }
        for (metre, mut errors) in bins {
            errors.sort_by(f64::total_cmp);
            let percentile = |p: f64| {
                let at = p / 100.0 * (errors.len() - 1) as f64;
                let (below, above) = (errors[at.floor() as usize], errors[at.ceil() as usize]);
                below + (above - below) * at.fract()
            };
            let percentiles = [5.0, 25.0, 50.0, 75.0, 95.0].map(percentile);
            expected.push((ESTIMATES[i].0.to_owned(), metre, errors.len(), percentiles));
        }
    }
    assert_eq!(written.len(), expected.len());
    for (cells, (label, metre, count, percentiles)) in written.iter().zip(expected) {
        assert_eq!(cells[1..3], named(&label));
        assert_eq!(cells[4..7], [metre.to_string(), (metre + 1).to_string(), count.to_string()]);
        for (ours, theirs) in cells[7..].iter().zip(percentiles) {
            assert!((number(ours) - theirs).abs() < 1e-6 * (1.0 + theirs), "{cells:?}: {theirs}");
        }
    }
    let truth = lines(&folder.path().join("report/true_distances.csv"));
    assert_eq!(truth[0].join(","), "stage,variant,bin_from_m,bin_to_m,count");
    let pixels: usize = truth[1..].iter().map(|cells| number(&cells[4]) as usize).sum();
    let scored = |index| fixture::maps(index)[0].iter().filter(|t| **t < 80.0).count();
    assert_eq!(pixels, (0..FRAMES - 1).map(scored).sum::<usize>());
}

#[test]
fn equal_recordings_give_equal_and_complete_files() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    for folder in &folders {
        report_of(folder.path(), 1, true, ReportOptions { paper: true, ..ReportOptions::default() });
    }
    let mut found: Vec<String> = Vec::new();
    for entry in fs::read_dir(folders[0].path().join("report")).unwrap() {
        found.push(entry.unwrap().file_name().into_string().unwrap());
    }
    found.sort();
    assert_eq!(found, FILES);
    for file in FILES {
        let [one, other] = [0, 1].map(|i: usize| fs::read(folders[i].path().join("report").join(file)).unwrap());
        assert!(one == other, "{file} differs between two reports of equal recordings");
    }
}

#[test]
fn fault_18_a_stopped_report_leaves_only_complete_files() {
    let folder = tempfile::tempdir().unwrap();
    report_of(folder.path(), 1, true, ReportOptions::default());
    let recording = Recording::open(folder.path().join("recording.mcap")).unwrap();
    let options = ReportOptions { samples_in_memory: 100, ..ReportOptions::default() };
    let expected = |file: &fs::DirEntry| fs::read(folder.path().join("report").join(file.file_name())).ok();
    let mut stopped = 0;
    // Every file and frame; then here and there while the percentiles are taken, bin by bin.
    for allowed in (0..60).chain((60..).step_by(97)) {
        let out = folder.path().join("stopped").join(allowed.to_string());
        fs::create_dir_all(&out).unwrap();
        let polls = AtomicUsize::new(0);
        let ended = report(&recording, &out, &options, &|| polls.fetch_add(1, Ordering::Relaxed) >= allowed);
        for file in fs::read_dir(&out).unwrap() {
            let file = file.unwrap();
            assert_eq!(fs::read(file.path()).ok(), expected(&file), "{:?} after {allowed}", file.file_name());
        }
        if ended.is_ok() {
            break;
        }
        assert!(matches!(ended, Err(AnalysisError::Stopped)), "{ended:?}");
        stopped += 1;
    }
    assert!(stopped > 60, "stopped {stopped} times");
}

#[test]
fn spilled_samples_do_not_change_files() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    for (folder, samples_in_memory) in folders.iter().zip([usize::MAX, 100]) {
        report_of(folder.path(), 1, true, ReportOptions { samples_in_memory, ..ReportOptions::default() });
    }
    for file in FILES {
        let [one, other] = [0, 1].map(|i: usize| fs::read(folders[i].path().join("report").join(file)).unwrap());
        assert!(one == other, "{file} differs where samples are spilled");
    }
}

#[test]
fn learning_curves_equal_the_recorded_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = fixture::plan_that_learns();
    fixture::record(&path, &plan);
    let out = folder.path().join("report");
    fs::create_dir(&out).unwrap();
    let summary = report(&Recording::open(&path).unwrap(), &out, &ReportOptions::default(), &|| false).unwrap();
    assert_eq!(summary.learning_curves, 1);
    let end = serde_json::to_value(&summary.curve_ends[0]).unwrap();
    assert_eq!((&end["stage"], &end["variant"], &end["node"]), (&"compare".into(), &Json::Null, &"train".into()));
    assert_eq!((&end["points"], &end["step"]), (&40.into(), &1950.into()));
    assert_eq!((&end["loss"], &end["validation"]), (&0.05.into(), &(2.5 / 37.0 + 0.1).into()));
    let written = lines(&out.join("learning_curves.csv"));
    assert_eq!(written[0].join(","), "stage,variant,node,step,loss,validation,learning_rate");
    let points = fixture::curve().points;
    assert_eq!(written.len() - 1, points.len());
    for (cells, point) in written[1..].iter().zip(&points) {
        assert_eq!(cells[..4].join(" "), format!("compare  train {}", point.step));
        assert_eq!((number(&cells[4]), number(&cells[6])), (point.loss, point.learning_rate));
        match point.validation {
            Some(validation) => assert_eq!(number(&cells[5]), validation),
            None => assert_eq!(cells[5], "", "not measured"),
        }
    }
    let svg = fs::read_to_string(out.join("learning_curves.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("compare/train") && svg.contains("validation"));
    assert!(out.join("learning_curves.parquet").exists());

    // Learning curves are reported even if nothing is scored.
    plan.runs[0].estimates.clear();
    fixture::record(&path, &plan);
    let out = folder.path().join("without scores");
    fs::create_dir(&out).unwrap();
    let summary = report(&Recording::open(&path).unwrap(), &out, &ReportOptions::default(), &|| false).unwrap();
    assert_eq!(summary.curve_ends.len(), 1);
    assert_eq!(lines(&out.join("learning_curves.csv")), written);
}

#[test]
fn unrecorded_maps_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let summary = report_of(folder.path(), 1, false, ReportOptions::default());
    let note = "no error against distance of b/mono: the estimate was not recorded: add it to `record:`";
    assert!(summary.text.contains(note), "{}", summary.text);
    let written = lines(&folder.path().join("report/error_vs_distance.csv"));
    assert!(written[1..].iter().all(|cells| cells[1] != "b"));
    // Its scores are still reported.
    let scores = lines(&folder.path().join("report/scores.csv"));
    assert!(scores.iter().any(|cells| cells[1..3] == named("b/mono")));
}

#[test]
fn scores_of_frames_without_recorded_maps_count() {
    let folder = tempfile::tempdir().unwrap();
    let summary = report_of(folder.path(), 3, true, ReportOptions::default());
    assert!(summary.text.starts_with("mean over 7 frames"), "{}", summary.text);
    assert!(summary.text.contains("covers only every 3rd frame"), "{}", summary.text);
    let written = lines(&folder.path().join("report/error_vs_distance.csv"));
    let of_a = |cells: &&Vec<String>| cells[1..3] == named("a/mono") && cells[3] == "valid";
    let samples: f64 = written[1..].iter().filter(of_a).map(|cells| number(&cells[6])).sum();
    let scored = |index| fixture::maps(index)[0].iter().filter(|t| **t < 80.0).count() as f64;
    assert_eq!(samples, [0, 3, 6].map(scored).iter().sum::<f64>());
}

#[test]
fn frames_with_an_absent_estimate_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record_absent(&path, &fixture::plan(1, true));
    let recording = Recording::open(&path).unwrap();
    let summary = report(&recording, folder.path(), &ReportOptions::default(), &|| false).unwrap();
    let note = "stage `compare`: means exclude 1 of 9 frames, which have no value of `b/mono`";
    assert!(summary.text.starts_with("mean over 7 frames") && summary.text.contains(note), "{}", summary.text);
    let unscored =
        "stage `compare`: means exclude 1 of 9 frames, which have no ground truth or no value of any estimate";
    assert!(summary.text.contains(unscored), "{}", summary.text);
    let question = Question::Ranking(Ranking::default());
    let answer = answer(&recording, None, &Selection::default(), &question, &|| false).unwrap();
    assert!(answer.terminal(200).contains(note), "{}", answer.terminal(200));
}

#[test]
fn selected_frames_by_id_are_the_only_ones_in_notes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record_absent(&path, &fixture::plan(1, true));
    let recording = Recording::open(&path).unwrap();
    let table = |frames: &str, question: &Question| {
        let selection = Selection { frames: Some(FrameChoice::parse(frames).unwrap()), ..Selection::default() };
        answer(&recording, None, &selection, question, &|| false).map(|table| table.terminal(200))
    };
    let ranking = Question::Ranking(Ranking::default());
    let text = table("000001_10,000003_10", &ranking).unwrap();
    assert!(text.contains("mean over 2 frames") && !text.contains("means exclude"), "{text}");
    // The estimate is absent on frame 7.
    let text = table("6,7", &ranking).unwrap();
    let note = "stage `compare`: means exclude 1 of 2 frames, which have no value of `b/mono`";
    assert!(text.contains("mean over 1 frame") && text.contains(note), "{text}");
    assert!(table("6,7", &Question::Scores(None)).unwrap().contains(note));
    assert_eq!(table("000077_10", &ranking).unwrap_err().to_string(), "there is no frame `000077_10`");
}

/// A report of an unfinished recording.
fn report_of_killed(folder: &Path, plan: &Plan, frames: &[u64]) -> (Summary, Vec<String>) {
    let path = folder.join("recording.mcap");
    fixture::record_unfinished(&path, plan, frames);
    let out = folder.join("report");
    fs::create_dir(&out).unwrap();
    let summary = report(&Recording::open(&path).unwrap(), &out, &ReportOptions::default(), &|| false).unwrap();
    let mut files: Vec<String> =
        fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    files.sort();
    (summary, files)
}

#[test]
fn a_stage_without_frames_is_reported_and_no_empty_table_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (summary, files) = report_of_killed(folder.path(), &fixture::plan_of_two_stages(), &[4, 0]);
    let expected = "note: no table: no frame was scored\n\
                    note: the recording is unfinished; it has 4 complete frames\n\
                    note: stage `compare` has no frames: the recording ends before its first\n";
    assert_eq!(summary.text, expected);
    assert_eq!(files, [] as [&str; 0]);
    assert!(!summary.scored && !summary.table);
    let stages = json!([{ "stage": "learn", "variant": null, "frames": 4 }, { "stage": "compare", "variant": null, "frames": 0 }]);
    assert_eq!(serde_json::to_value(&summary.recording).unwrap()["stages"], stages);
    assert!(summary.rows.is_empty());
    assert_eq!(summary.notes.len(), 3);
}

#[test]
fn a_stage_with_fewer_frames_than_another_stage_of_its_source_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = fixture::plan_of_two_stages();
    let (summary, files) = report_of_killed(folder.path(), &plan, &[4, 2]);
    assert!(summary.text.starts_with("mean over 2 frames"), "{}", summary.text);
    let note = "note: stage `compare` has 2 frames, but stage `learn` has 4 frames of the same source\n";
    assert!(summary.text.contains(note), "{}", summary.text);
    assert!(FILES.iter().all(|file| files.iter().any(|found| found == file)), "{files:?}");

    // Stages of different sources are not compared.
    plan.runs[0].source.parts[0].portable = json!({ "frames": "0..4" });
    let folder = tempfile::tempdir().unwrap();
    let (summary, _) = report_of_killed(folder.path(), &plan, &[4, 2]);
    assert!(!summary.text.contains("of the same source"), "{}", summary.text);
}

#[test]
fn an_estimate_without_scores_is_named_and_the_others_have_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = fixture::plan(1, true);
    // An estimate without scores on any frame.
    let node = plan.runs[0].nodes[5].clone();
    plan.runs[0].nodes.push(node);
    plan.runs[0].nodes[6].outputs[0].topic = "/compare/never/rows".to_owned();
    let mut never = plan.runs[0].estimates[2].clone();
    (never.label, never.name, never.score_node) = ("never".to_owned(), "never".to_owned(), NodeId(6));
    plan.runs[0].estimates.push(never);
    let (summary, files) = report_of_killed(folder.path(), &plan, &[2]);
    assert!(summary.text.starts_with("mean over 2 frames"), "{}", summary.text);
    let note = "note: `never` is excluded: it has no score on any frame\n";
    assert!(summary.text.contains(note), "{}", summary.text);
    assert!(files.contains(&"scores.csv".to_owned()) && files.contains(&"table.csv".to_owned()), "{files:?}");

    // An output of the source that has no value on any frame.
    let mut lidar = plan.runs[0].source.outputs[0].clone();
    lidar.port = Port::frame("lidar", ValueType::Depth, "").optional();
    lidar.topic = "/compare/source/lidar".to_owned();
    plan.runs[0].source.outputs.push(lidar);
    if let Some(estimate) = plan.runs[0].estimates.last_mut() {
        estimate.truth = Slot::Source { port: PortId(1) };
    }
    let folder = tempfile::tempdir().unwrap();
    let (summary, _) = report_of_killed(folder.path(), &plan, &[2]);
    let note = "note: `never` is excluded: no frame has its ground truth `compare/source/lidar`; \
                enable it in the parameters of the source\n";
    assert!(summary.text.starts_with("mean over 2 frames") && summary.text.contains(note), "{}", summary.text);
}

#[test]
fn unrecorded_maps_are_reported_in_one_note() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = fixture::plan(1, true);
    let run = &mut plan.runs[0];
    run.source.outputs[0].recorded = false;
    for node in 0..3 {
        run.nodes[node].outputs[0].recorded = false;
        // As the language wires a score.
        let port = |name| Port::frame(name, ValueType::Depth, "");
        let estimate = Some(Wire::Here(Slot::Node { node: NodeId(node), port: PortId(0) }));
        let truth = Some(Wire::Here(Slot::Source { port: PortId(0) }));
        let input = |name, from| PlannedInput { port: port(name), from, shown: None };
        run.nodes[3 + node].inputs = vec![input("estimate", estimate), input("ground_truth", truth)];
    }
    let (summary, _) = report_of_killed(folder.path(), &plan, &[2]);
    let note = "note: no error against distance: the ground truth `compare.source/depth` and the estimates `compare.a/mono/depth`, \
                `compare.b/mono/depth`, `compare.stereo/depth` were not recorded: add them to `record:`\n";
    assert!(summary.text.ends_with(note), "{}", summary.text);
    assert_eq!(summary.text.matches("error against distance").count(), 1);
}
