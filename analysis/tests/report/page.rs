//! The contents of `report.html`: hostile names, failed frames, stopping.
#![expect(clippy::unwrap_used, reason = "what the tests share fails as they do")]

use std::fs;
use std::path::Path;

use depthloom_analysis::{
    CompareOptions, ComparedRun, PAGE, PAGE_MARK, PageOptions, ReportOptions, Side, Surroundings, compare, report,
    write_page,
};
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::fixture;

const HOSTILE: &str = "</script><script>alert(1)</script><!--\"'&";

/// The page of a recording, and its data.
fn page_of(folder: &Path, recording: &Path, surroundings: &Surroundings) -> (String, Json) {
    let recording = Recording::open(recording).unwrap();
    let summary = report(&recording, folder, &ReportOptions::default(), &|| false).unwrap();
    let written = write_page(&recording, folder, &summary, surroundings, PageOptions::default(), &|| false).unwrap();
    let page = fs::read_to_string(folder.join(PAGE)).unwrap();
    assert_eq!(written.bytes, page.len() as u64);
    assert!(page.starts_with(PAGE_MARK) && page.trim_end().ends_with("</html>"));
    let (_, data) = page.split_once("id=\"data\">").unwrap();
    let data = serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap();
    (page, data)
}

#[test]
fn names_with_markup_are_escaped_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = fixture::plan(1, true);
    plan.experiment = HOSTILE.to_owned();
    plan.description = HOSTILE.to_owned();
    plan.runs[0].source.name = HOSTILE.to_owned();
    plan.runs[0].nodes.iter_mut().for_each(|node| node.name = format!("{HOSTILE}{}", node.name));
    plan.variants[1] = HOSTILE.to_owned();
    fixture::record(&path, &plan);
    let environment = json!({ "arguments": ["depthloom", "run", HOSTILE] });
    let (page, data) = page_of(folder.path(), &path, &Surroundings { environment, timings: Vec::new() });
    assert!(!page.contains("alert(1)</script>"), "a name became markup");
    assert!(page.contains("<title>&lt;/script&gt;"));
    assert_eq!(data["experiment"], HOSTILE);
    assert_eq!(data["environment"]["arguments"][2], HOSTILE);
}

#[test]
fn a_page_lists_failures_and_missing_maps_and_has_the_numbers_of_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record(&path, &fixture::plan(1, false));
    let (page, data) = page_of(folder.path(), &path, &Surroundings::default());
    // `b/mono` failed on a frame, and its maps were not kept.
    assert_eq!(data["failures"]["in_all"], 1);
    let failed = &data["failures"]["listed"][0];
    assert_eq!((failed["position"].as_u64(), failed["node"].as_str()), (Some(fixture::FRAMES - 2), Some("b/mono")));
    let layers: Vec<&str> =
        data["pictures"][0]["layers"].as_array().unwrap().iter().map(|layer| layer["name"].as_str().unwrap()).collect();
    assert_eq!(layers, ["source/depth", "a_mono/depth", "stereo/depth"]);
    assert!(data["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains("not recorded")));
    assert_eq!(page.matches("<script type=\"text/plain\"").count(), usize::try_from(fixture::FRAMES).unwrap());
    let csv = fs::read_to_string(folder.path().join("table.csv")).unwrap();
    let cells: Vec<&str> = csv.lines().nth(1).unwrap().split(',').collect();
    let a1 = csv.lines().next().unwrap().split(',').position(|name| name == "a1").unwrap();
    let ours: f64 = cells[a1].parse().unwrap();
    let theirs = data["table"]["rows"][0]["means"][0].as_f64().unwrap();
    assert!((ours - theirs).abs() <= 1e-6 * ours, "{ours} and {theirs}");
    assert_eq!(data["environment"], Json::Null);
    // Equal recordings give equal pages.
    let again = tempfile::tempdir().unwrap();
    assert!(page_of(again.path(), &path, &Surroundings::default()).0 == page);
}

#[test]
fn rows_are_compared_with_the_best_row_as_by_compare() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record(&path, &fixture::plan(1, true));
    let (_, data) = page_of(folder.path(), &path, &Surroundings::default());
    let table = &data["table"];
    let row = |name: &str, variant: Option<&str>| {
        let rows = table["rows"].as_array().unwrap();
        rows.iter()
            .find(|row| row["estimate"] == name && row["variant"] == json!(variant) && row["set"] == "all")
            .unwrap()
    };
    assert_eq!(table["metrics"][table["leading"].as_u64().unwrap() as usize]["name"], "abs_rel");
    // All pixels before valid ones; in each the smallest error first.
    let order: Vec<usize> =
        table["best_first"].as_array().unwrap().iter().map(|row| row.as_u64().unwrap() as usize).collect();
    let shown = order.iter().map(|&row| &table["rows"][row]);
    let shown: Vec<_> = shown.map(|row| (row["estimate"].as_str(), row["set"].as_str())).collect();
    let [mono, stereo] = ["mono", "stereo"].map(Some);
    let [all, valid] = ["all", "valid"].map(Some);
    assert_eq!(shown, [(mono, all), (stereo, all), (mono, all), (stereo, valid)]);
    let recording = Recording::open(&path).unwrap();
    let side = |name: &str| Side { run: 0, name: Some(name.to_owned()) };
    let options = CompareOptions { scores: vec!["abs_rel".to_owned()], ..CompareOptions::default() };
    let run = ComparedRun { called: "run", recording: &recording };
    let sides = [side("a/mono"), side("b/mono"), side("stereo")];
    let compared = serde_json::to_value(compare(&[run], &sides, &options, &|| false).unwrap().output).unwrap();
    let compared = compared["rows"].as_array().unwrap();
    let expected = |name: &str| {
        let row = compared.iter().find(|row| row["estimate"] == name).unwrap();
        (row["verdict"].clone(), row["p_holm"].clone())
    };
    assert_eq!(row("mono", Some("a"))["verdict"], Json::Null, "the best row");
    for (row, name) in [(row("mono", Some("b")), "mono"), (row("stereo", None), "stereo")] {
        assert_eq!((row["verdict"]["name"].clone(), row["verdict"]["p"].clone()), expected(name), "{name}");
        assert_eq!(row["verdict"]["name"], "worse");
    }
    let texts = table["tested"].as_array().unwrap();
    assert!(texts.len() == 2 && texts[0].as_str().unwrap().contains("2 tests"), "{texts:?}");
    assert!(texts[1].as_str().unwrap().contains("depthloom report RUN --ci"), "{texts:?}");
}

#[test]
fn too_few_frames_for_a_verdict_are_stated_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let plan = fixture::plan(1, true);
    fixture::record_unfinished(&path, &plan, &[4]);
    let (_, data) = page_of(folder.path(), &path, &Surroundings::default());
    let table = &data["table"];
    assert!(table["rows"].as_array().unwrap().iter().all(|row| row["verdict"].is_null()));
    let texts = table["tested"].as_array().unwrap();
    let text = texts[0].as_str().unwrap();
    assert!(texts.len() == 2 && text.contains("4 frames are too few") && text.contains("0.250"), "{text}");
}

#[test]
fn a_bad_map_does_not_stretch_the_colour_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record_complete(&path, &fixture::plan(1, true), |[truth, a, b, _]| {
        truth[0] = 1e6;
        a.iter_mut().step_by(50).for_each(|metres| *metres = 1e6);
        b.fill(1e6);
    });
    let (_, data) = page_of(folder.path(), &path, &Surroundings::default());
    let ends = &data["pictures"][0]["colours"]["depth"];
    let (low, high) = (ends[0].as_f64().unwrap(), ends[1].as_f64().unwrap());
    assert!((2.0..4.0).contains(&low) && (75.0..83.0).contains(&high), "{ends}");
}

#[test]
fn variants_have_hues_and_shared_estimates_keep_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record(&path, &fixture::plan(1, true));
    let (_, data) = page_of(folder.path(), &path, &Surroundings::default());
    let colours: Vec<&str> =
        data["estimates"].as_array().unwrap().iter().map(|estimate| estimate["colour"].as_str().unwrap()).collect();
    assert_eq!(colours[0], depthloom_figures::BLUE, "stereo, which both variants share");
    assert!(colours[1] != colours[2] && !colours[1..].contains(&colours[0]), "{colours:?}");
    for row in data["table"]["rows"].as_array().unwrap() {
        let same = |one: &&Json| one["name"] == row["estimate"] && one["variant"] == row["variant"];
        let estimate = data["estimates"].as_array().unwrap().iter().find(same).unwrap();
        assert_eq!((&row["colour"], &row["dash"]), (&estimate["colour"], &estimate["dash"]));
    }
}

#[test]
fn writing_a_page_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record(&path, &fixture::plan(1, true));
    let recording = Recording::open(&path).unwrap();
    let summary = report(&recording, folder.path(), &ReportOptions::default(), &|| false).unwrap();
    let stopped =
        write_page(&recording, folder.path(), &summary, &Surroundings::default(), PageOptions::default(), &|| true)
            .unwrap_err();
    assert_eq!(stopped.to_string(), "stopped before it was finished");
    assert!(!folder.path().join(PAGE).exists());
}
