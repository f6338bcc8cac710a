//! Memory is bounded by the window, not by the number of frames.

use crate::support::{depthloom, succeed, workspace};

#[test]
fn two_thousand_frames_take_no_more_memory_than_a_hundred() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    let text = format!(
        "extends: {}\nexperiment: small\nsources:\n  train: {{ with: {{ frames: 0..2, width: 320, height: 96 }} }}\n  test: {{ with: {{ frames: 0..100, width: 320, height: 96 }} }}\n\
         stages:\n  learn:\n    nodes:\n      samples: {{ with: {{ size: [64, 32] }} }}\n      teacher: {{ with: {{ steps: 1, batch: 1 }} }}\n",
        table1.display()
    );
    std::fs::write(&experiment, text).expect("written");
    let peak = |frames: &str| -> f64 {
        let out = folder.path().join(frames);
        let set = format!("sources.test.with.frames=0..{frames}");
        // One arena: with several, what glibc keeps back in each differs from run to run by more than what is looked for.
        let mut run = depthloom();
        run.env("MALLOC_ARENA_MAX", "1")
            .args(["run", "--workers", "2", "--set", &set, "--out"])
            .arg(&out)
            .arg(&experiment);
        succeed(&mut run);
        let environment = std::fs::read_to_string(out.join("environment.json")).expect("an environment");
        let environment: serde_json::Value = serde_json::from_str(&environment).expect("JSON");
        std::fs::remove_dir_all(&out).expect("removed");
        environment["peak_resident_bytes"].as_f64().expect("a size")
    };
    let (few, many) = (peak("100"), peak("2000"));
    assert!(many <= 1.1 * few, "100 frames took {:.1} MB, 2,000 took {:.1} MB", few / 1e6, many / 1e6);
}
