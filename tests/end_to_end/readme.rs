//! What the README says of other people's programs.

use std::process::Command;

use depthloom_graphs::Value;
use depthloom_recording::Recording;

use crate::support::{depthloom, python, succeed, workspace};

/// The only block of Python in the README.
fn snippet() -> String {
    let readme = std::fs::read_to_string(workspace().join("README.md")).expect("the README");
    let (_, rest) = readme.split_once("```python\n").expect("a block of Python");
    rest.split_once("```").expect("its end").0.to_owned()
}

#[test]
fn the_readmes_python_reads_depth_and_disparity_of_a_frame_by_its_id() {
    let Some(python) = python("the_readmes_python_reads_depth_and_disparity_of_a_frame_by_its_id") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, script, out) =
        (folder.path().join("look.yaml"), folder.path().join("read.py"), folder.path().join("run"));
    std::fs::write(&script, snippet()).expect("written");
    let look = workspace().join("experiments/first-look.yaml");
    let variants = "{ plain: {}, large: { look.stereo.with.block: 9 }, near: { look.stereo.with.block: 9, look.score.max_m: 40 } }";
    let text = format!(
        "extends: {}\nexperiment: look\nsources: {{ street: {{ with: {{ frames: 3..5, width: 320, height: 96 }} }} }}\nvariants: {variants}\n",
        look.display()
    );
    std::fs::write(&experiment, text).expect("written");
    succeed(depthloom().arg("run").arg(&experiment).args(["--quiet", "--out"]).arg(&out));
    let recording = out.join("recording.mcap");
    // `near` has the same stereo as `large`: one recording, two names.
    let topics = ["/look/plain/depth/depth", "/look/near/stereo/disparity"];
    let read = succeed(Command::new(python).arg(&script).arg(&recording).args(topics));
    let read = String::from_utf8(read.stdout).expect("text");

    let ours = Recording::open(&recording).expect("a recording");
    let mut expected = Vec::new();
    let mut reader = ours.reader(0, &["/look/large/stereo/disparity", topics[0]]).expect("topics");
    for (position, frame) in ours.frames(0).iter().enumerate() {
        let values = reader.read(position).expect("a frame");
        let [Some(Value::Disparity(disparity)), Some(Value::Depth(depth))] = &values[..] else { panic!("two maps") };
        let line = |topic: &str, (width, height): (u32, u32), numbers: Vec<f64>| {
            let (count, sum) = (numbers.len(), numbers.iter().sum::<f64>());
            (format!("{} {topic} {height} {width} {count}", frame.id), sum / count as f64)
        };
        let least = f64::from(disparity.min_disparity_px);
        let found = disparity.sixteenths_px.iter().map(|&of| f64::from(of) / 16.0).filter(|px| *px >= least);
        expected.push(line("/look/large/stereo/disparity", disparity.sixteenths_px.dimensions(), found.collect()));
        let metres = depth.metres.iter().filter(|metres| metres.is_finite()).map(|&metres| f64::from(metres));
        expected.push(line(topics[0], depth.metres.dimensions(), metres.collect()));
    }
    let mut found: Vec<(String, f64)> = read
        .lines()
        .map(|line| {
            let (rest, mean) = line.rsplit_once(' ').expect("a mean at the end");
            (rest.to_owned(), mean.parse().expect("a number"))
        })
        .collect();
    found.sort_by(|a, b| a.0.cmp(&b.0));
    expected.sort_by(|a, b| a.0.cmp(&b.0));
    assert_eq!(found.len(), 4, "{read}");
    for (found, expected) in found.iter().zip(&expected) {
        // NumPy adds up in f32.
        assert!(found.0 == expected.0 && (found.1 - expected.1).abs() < 1e-3 * expected.1, "{found:?} {expected:?}");
    }
}
