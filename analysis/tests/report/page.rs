//! The contents of `report.html`: hostile names, failed frames, stopping.
#![expect(clippy::unwrap_used, reason = "what the tests share fails as they do")]

use std::fs;
use std::path::Path;

use depthloom_analysis::{PAGE, PAGE_MARK, ReportOptions, Surroundings, report, write_page};
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::fixture;

const HOSTILE: &str = "</script><script>alert(1)</script><!--\"'&";

/// The page of a recording, and its data.
fn page_of(folder: &Path, recording: &Path, surroundings: &Surroundings) -> (String, Json) {
    let recording = Recording::open(recording).unwrap();
    let summary = report(&recording, folder, &ReportOptions::default(), &|| false).unwrap();
    let written = write_page(&recording, folder, &summary, surroundings, &|| false).unwrap();
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
fn writing_a_page_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    fixture::record(&path, &fixture::plan(1, true));
    let recording = Recording::open(&path).unwrap();
    let summary = report(&recording, folder.path(), &ReportOptions::default(), &|| false).unwrap();
    let stopped = write_page(&recording, folder.path(), &summary, &Surroundings::default(), &|| true).unwrap_err();
    assert_eq!(stopped.to_string(), "stopped before it was finished");
    assert!(!folder.path().join(PAGE).exists());
}
