//! Memory is bounded by the window, not by the number of frames; of what is learned from, each sample is held once.

use std::path::Path;

use crate::support::{depthloom, full, succeed, workspace};

/// The largest memory that a run of so many frames of a source ever had, in bytes.
fn peak(experiment: &Path, source: &str, frames: u32) -> f64 {
    let out = experiment.with_file_name(frames.to_string());
    let set = format!("sources.{source}.with.frames=0..{frames}");
    // One arena: with several, what glibc keeps back in each differs from run to run by more than what is looked for.
    let mut run = depthloom();
    // One worker and a small window: which values several workers hold at one time is chance, and differs with what else the machine does.
    run.env("MALLOC_ARENA_MAX", "1").args([
        "run",
        "--no-page",
        "--workers",
        "1",
        "--window",
        "2",
        "--set",
        &set,
        "--out",
    ]);
    run.arg(&out).arg(experiment);
    succeed(&mut run);
    let environment = std::fs::read_to_string(out.join("environment.json")).expect("an environment");
    let environment: serde_json::Value = serde_json::from_str(&environment).expect("JSON");
    std::fs::remove_dir_all(&out).expect("removed");
    environment["peak_resident_bytes"].as_f64().expect("a size")
}

/// What is kept of a frame: where its 40 chunks lie, 16 rows of scores, its keys. One map of a frame of 320 x 96 pixels, a number of 4 bytes for
/// every pixel, has 123 kB. What is kept does not depend on the size, so that smaller frames show it in a fifth of the time.
///
/// Compared with 500 frames, not with fewer: which values of the window are held at one time is chance, so that the peak of 100 frames
/// was seen between 89 and 107 MB and that of longer runs lies at its upper end.
#[test]
fn of_a_frame_a_run_keeps_less_than_a_tenth_of_one_map() {
    if !full("of_a_frame_a_run_keeps_less_than_a_tenth_of_one_map") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    let text = format!(
        "extends: {}\nexperiment: small\nsources:\n  train: {{ with: {{ frames: 0..2, width: 160, height: 48 }} }}\n  test: {{ with: {{ frames: 0..100, width: 160, height: 48 }} }}\n\
         stages:\n  learn:\n    nodes:\n      samples: {{ with: {{ size: [64, 32] }} }}\n      teacher: {{ with: {{ steps: 1, batch: 1 }} }}\n",
        table1.display()
    );
    std::fs::write(&experiment, text).expect("written");
    let (few, many) = (peak(&experiment, "test", 500), peak(&experiment, "test", 2000));
    let kept = (many - few) / 1500.0;
    let map = f64::from(320 * 96 * 4);
    assert!(
        kept < map / 10.0,
        "{kept:.0} bytes a frame: 500 took {:.1} MB, 2,000 took {:.1} MB",
        few / 1e6,
        many / 1e6
    );
}

#[test]
fn a_sample_is_held_once_while_a_network_learns() {
    if !full("a_sample_is_held_once_while_a_network_learns") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("learn.yaml");
    let text = "experiment: learn
sources: { street: { kind: synthetic/road, with: { width: 160, height: 64 } } }
stages:
  learn:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: stereo/disparity, mask: edges/mask }
        with: { size: [160, 64] }
      teacher: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 2, batch: 1 } }
";
    std::fs::write(&experiment, text).expect("written");
    let (few, many) = (50, 550);
    let grown = peak(&experiment, "street", many) - peak(&experiment, "street", few);
    let held = grown / f64::from(many - few);
    // Three bytes of colour and an IEEE half for every pixel.
    let sample = f64::from(160 * 64 * (3 + 2));
    assert!(held >= 0.5 * sample, "{held:.0} bytes a sample of {sample}: what was measured are not samples");
    assert!(held <= 1.8 * sample, "a sample of {sample} bytes takes {held:.0}");
}
