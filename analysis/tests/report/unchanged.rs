//! Error against distance reused from an earlier report: all files equal those of a report without reuse.
#![expect(clippy::unwrap_used, reason = "what the tests share fails as they do")]

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use depthloom_analysis::{Prepared, ReportOptions, report, report_with};
use depthloom_graphs::Key;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{NodeId, Plan};
use depthloom_recording::Recording;
use polars::prelude::{
    DataFrame, IntoColumn as _, KeyValueMetadata, NamedFrom as _, ParquetReader, ParquetWriter, SerReader as _, Series,
};
use serde_json::Value as Json;

use crate::fixture;

/// The name of what the rows were computed from, in the metadata of the table.
const ORIGIN: &str = "depthloom.computed_from";
const ERRORS: [&str; 5] = ["error_p5_m", "error_p25_m", "error_p50_m", "error_p75_m", "error_p95_m"];

/// The folder of an earlier run, and one of a run with its report.
struct Runs {
    folder: tempfile::TempDir,
}

impl Runs {
    /// An earlier run of the fixture's maps, and its report.
    fn new() -> Self {
        Self::with_plan(&fixture::plan(1, true))
    }

    /// The same with another plan.
    fn with_plan(plan: &Plan) -> Self {
        let runs = Self { folder: tempfile::tempdir().unwrap() };
        let earlier = runs.folder.path().join("earlier");
        fs::create_dir(&earlier).unwrap();
        fixture::record_complete(&earlier.join("recording.mcap"), plan, |_| {});
        report(&recording(&earlier), &earlier, &ReportOptions::default(), &|| false).unwrap();
        runs
    }

    fn earlier(&self) -> PathBuf {
        self.folder.path().join("earlier")
    }

    /// The files of a run's report, with and without reuse of the earlier report.
    fn reports(&self, plan: &Plan, change: impl Fn(&mut [Vec<f32>; 4])) -> [Vec<(String, Vec<u8>)>; 2] {
        let run = self.folder.path().join("run");
        fs::create_dir(&run).unwrap();
        fixture::record_complete(&run.join("recording.mcap"), plan, change);
        let recording = recording(&run);
        let reports = [vec![self.earlier()], Vec::new()].map(|reports| {
            let out = tempfile::tempdir().unwrap();
            let prepared = Prepared { samples: None, reports };
            report_with(&recording, out.path(), &ReportOptions::default(), prepared, &|| false).unwrap();
            files(out.path())
        });
        fs::remove_dir_all(run).unwrap();
        reports
    }

    /// Checks that a report with reuse has the same bytes as one without.
    fn assert_as_fresh(&self, plan: &Plan, change: impl Fn(&mut [Vec<f32>; 4])) {
        let [reusing, fresh] = self.reports(plan, change);
        let names: Vec<&String> = fresh.iter().map(|(name, _)| name).collect();
        assert!(names.iter().any(|name| *name == "error_vs_distance.parquet"), "{names:?}");
        for ((name, bytes), (of_fresh, fresh)) in reusing.iter().zip(&fresh) {
            assert!(name == of_fresh && bytes == fresh, "{name} differs");
        }
        assert_eq!(reusing.len(), fresh.len());
    }

    /// Raises the median errors of an estimate in the earlier report, and updates the checksum of the rows.
    fn change_earlier(&self, estimate: &str, variant: Option<&str>) {
        let path = self.earlier().join("error_vs_distance.parquet");
        let mut reader = ParquetReader::new(File::open(&path).unwrap());
        let metadata = reader.get_metadata().unwrap().clone();
        let mut table = reader.finish().unwrap();
        let (names, variants) = (table.column("estimate").unwrap(), table.column("variant").unwrap());
        let is_of =
            |row: usize| names.str().unwrap().get(row) == Some(estimate) && variants.str().unwrap().get(row) == variant;
        let errors = table.column("error_p50_m").unwrap().f64().unwrap();
        let changed: Vec<f64> =
            (0..table.height()).map(|row| errors.get(row).unwrap() + if is_of(row) { 1000.0 } else { 0.0 }).collect();
        table.with_column(Series::new("error_p50_m".into(), changed).into_column()).unwrap();
        let entries = metadata.key_value_metadata().clone().unwrap().into_iter().map(|entry| {
            let mut text = entry.value.unwrap();
            if entry.key.as_str() == ORIGIN {
                let mut origin: Json = serde_json::from_str(&text).unwrap();
                origin["rows"] = checksum(&origin, &table).to_string().into();
                text = origin.to_string();
            }
            (entry.key, text)
        });
        let entries = KeyValueMetadata::from_static(entries.collect());
        let file = File::create(&path).unwrap();
        ParquetWriter::new(file).with_key_value_metadata(Some(entries)).finish(&mut table).unwrap();
    }
}

fn recording(run: &Path) -> Recording {
    Recording::open(run.join("recording.mcap")).unwrap()
}

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let file = |entry: std::io::Result<fs::DirEntry>| {
        let path = entry.unwrap().path();
        (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap())
    };
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(file).collect();
    files.sort();
    files
}

/// The checksum: by estimate what its rows were computed from; then by estimate and bin the metre, whether it has
/// shared pixels, and of all and of the shared pixels their number and errors.
fn checksum(origin: &Json, table: &DataFrame) -> Key {
    let bins = table.column("bin_from_m").unwrap().u32().unwrap();
    let counts = table.column("count").unwrap().u64().unwrap();
    let errors = ERRORS.map(|name| table.column(name).unwrap().f64().unwrap());
    let (mut numbers, mut row) = (Vec::new(), 0);
    for estimate in origin["estimates"].as_array().unwrap() {
        let input = u128::from_le_bytes(*Key::parse(estimate["input"].as_str().unwrap()).unwrap().as_bytes());
        numbers.extend([input as u64, (input >> 64) as u64]);
        numbers.extend(["group", "valid_rows", "common_rows", "beyond"].map(|name| estimate[name].as_u64().unwrap()));
    }
    let spread = |row: usize| {
        let errors = errors.iter().map(move |errors| errors.get(row).unwrap().to_bits());
        std::iter::once(counts.get(row).unwrap()).chain(errors)
    };
    for estimate in origin["estimates"].as_array().unwrap() {
        let [valid, common] = ["valid_rows", "common_rows"].map(|name| estimate[name].as_u64().unwrap() as usize);
        for valid_row in row..row + valid {
            let bin = bins.get(valid_row).unwrap();
            let common_row = (row + valid..row + valid + common).find(|row| bins.get(*row) == Some(bin));
            numbers.extend([u64::from(bin), u64::from(common_row.is_some())]);
            numbers.extend(spread(valid_row).chain(common_row.into_iter().flat_map(spread)));
        }
        row += valid + common;
    }
    let bytes: Vec<u8> = numbers.into_iter().flat_map(u64::to_le_bytes).collect();
    Key::of_content(&bytes)
}

fn csv(files: &[(String, Vec<u8>)]) -> &[u8] {
    &files.iter().find(|(name, _)| name == "error_vs_distance.csv").unwrap().1
}

/// Another estimate with the same pixels.
fn scaled(map: &mut [f32]) {
    map.iter_mut().for_each(|metres| *metres *= 1.25);
}

#[test]
fn reuse_does_not_change_the_report_after_any_change_of_maps() {
    let (runs, plan) = (Runs::new(), fixture::plan(1, true));
    runs.assert_as_fresh(&plan, |_| {});
    runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
    runs.assert_as_fresh(&plan, |[_, a, b, _]| std::mem::swap(a, b));
    // Fewer pixels are shared, more are, and others.
    runs.assert_as_fresh(&plan, |[_, _, b, _]| b.iter_mut().step_by(3).for_each(|metres| *metres = f32::NAN));
    runs.assert_as_fresh(&plan, |[.., stereo]| stereo.fill(20.0));
    runs.assert_as_fresh(&plan, |[truth, ..]| scaled(truth));
    // An estimate without valid pixels.
    runs.assert_as_fresh(&plan, |[_, a, ..]| a.fill(f32::NAN));
}

#[test]
fn labels_do_not_affect_reuse() {
    let (runs, mut plan) = (Runs::new(), fixture::plan(1, true));
    let [a, b, _] = &mut *plan.runs[0].estimates else { unreachable!("three estimates") };
    std::mem::swap(&mut a.estimate, &mut b.estimate);
    std::mem::swap(&mut a.score_node, &mut b.score_node);
    runs.assert_as_fresh(&plan, |_| {});
    plan.runs[0].estimates.remove(1);
    runs.assert_as_fresh(&plan, |_| {});
    // Without the stereo estimate other pixels are shared.
    plan.runs[0].estimates.pop();
    runs.assert_as_fresh(&plan, |_| {});
    assert!(matches!(plan.runs[0].estimates[0].estimate, Slot::Node { node: NodeId(1), .. }));
}

#[test]
fn changed_limits_prevent_reuse() {
    let (runs, mut plan) = (Runs::new(), fixture::plan(1, true));
    for node in plan.runs[0].nodes.iter_mut().filter(|node| node.name.starts_with("score_")) {
        node.params["max_m"] = 40.0.into();
    }
    runs.assert_as_fresh(&plan, |_| {});
}

#[test]
fn bins_of_unchanged_estimates_are_not_computed_again() {
    let (runs, plan) = (Runs::new(), fixture::plan(1, true));
    runs.change_earlier("mono", Some("b"));
    let [reusing, fresh] = runs.reports(&plan, |[_, a, ..]| scaled(a));
    assert_ne!(csv(&reusing), csv(&fresh), "the rows of b/mono are those of the earlier report");
    // Changed estimates are not reused.
    runs.assert_as_fresh(&plan, |[_, a, b, _]| {
        scaled(a);
        scaled(b);
    });
}

#[test]
fn an_earlier_report_that_differs_where_it_is_checked_is_not_used() {
    let (runs, plan) = (Runs::new(), fixture::plan(1, true));
    runs.change_earlier("mono", Some("b"));
    runs.change_earlier("stereo", None);
    runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
}

#[test]
fn an_earlier_report_that_is_damaged_is_not_used() {
    let (runs, plan) = (Runs::new(), fixture::plan(1, true));
    let path = runs.earlier().join("error_vs_distance.parquet");
    let whole = fs::read(&path).unwrap();
    for place in (0..whole.len()).step_by(307) {
        let mut damaged = whole.clone();
        damaged[place] ^= 4;
        fs::write(&path, damaged).unwrap();
        runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
    }
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
}

/// Estimates with the same ground truth and different bounds: `true_distances.csv` counts the pixels of all of them,
/// regardless of the reading order.
#[test]
fn bounds_of_single_estimates_count_their_pixels() {
    for estimate in ["a/mono", "b/mono", "stereo"] {
        for (bound, metres) in [("max_m", 40.0), ("min_m", 10.0)] {
            let mut plan = fixture::plan(1, true);
            let name = format!("score_{estimate}");
            let node = plan.runs[0].nodes.iter_mut().find(|node| node.name == name).unwrap();
            node.params[bound] = metres.into();
            let runs = Runs::with_plan(&plan);
            runs.assert_as_fresh(&plan, |_| {});
            runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
            let of_all = Runs::new().reports(&fixture::plan(1, true), |_| {});
            let truth = |files: &[(String, Vec<u8>)]| {
                files.iter().find(|(name, _)| name == "true_distances.csv").map(|(_, bytes)| bytes.clone())
            };
            assert_eq!(truth(&runs.reports(&plan, |_| {})[0]), truth(&of_all[0]), "{estimate} {bound}");
        }
    }
}

#[test]
fn a_changed_origin_is_not_used() {
    let (runs, plan) = (Runs::new(), fixture::plan(1, true));
    let path = runs.earlier().join("error_vs_distance.parquet");
    let whole = fs::read(&path).unwrap();
    let beyond = b"\"beyond\":0";
    let places: Vec<usize> = (0..whole.len() - beyond.len()).filter(|at| whole[*at..].starts_with(beyond)).collect();
    assert!(!places.is_empty(), "the metadata is plain text");
    for place in places {
        let mut changed = whole.clone();
        changed[place + beyond.len() - 1] = b'1';
        fs::write(&path, changed).unwrap();
        runs.assert_as_fresh(&plan, |[_, a, ..]| scaled(a));
    }
}
