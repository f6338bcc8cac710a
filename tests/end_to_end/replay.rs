//! Nodes recomputed from a recording: equal if nothing changed; otherwise the changed node is reported.

use std::path::{Path, PathBuf};

use depthloom_graphs::Value;
use depthloom_graphs::language::{Options, load};
use depthloom_graphs::plan::{FrameIndex, Plan, PlannedNode, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_recording::{Recorder, Recording};
use depthloom_runner::{Interrupt, Unwatched};
use serde_json::{Value as Json, json};

use crate::learning::learn;
use crate::support::{depthloom, succeed, workspace};

const FRAMES: u64 = 3;

/// `first-look.yaml` on three small frames, with additional keys.
fn look(folder: &Path, more: &str) -> PathBuf {
    let path = folder.join("look.yaml");
    let look = workspace().join("experiments/first-look.yaml");
    let small = "sources: { street: { with: { frames: 0..3, width: 320, height: 96 } } }";
    std::fs::write(&path, format!("extends: {}\nexperiment: look\n{small}\n{more}", look.display())).expect("written");
    path
}

fn run(experiment: &Path, out: &Path) {
    succeed(depthloom().args(["run", "--no-page"]).arg(experiment).args(["--quiet", "--out"]).arg(out));
}

/// Runs an experiment and records its values with a changed plan, as if a kind had changed after the recording.
fn recorded_as(experiment: &Path, recording: &Path, change: impl Fn(&mut PlannedNode)) {
    let registry = depthloom::registry();
    let plan = load(experiment, &registry, &Options::default()).expect("a valid experiment").plan;
    let ready = Ready::new(plan, &registry).unwrap_or_else(|missing| panic!("{missing:?}"));
    // Node hashes are complete only in the ready plan.
    let mut recorded_plan: Plan = ready.plan.clone();
    recorded_plan.runs.iter_mut().flat_map(|run| &mut run.nodes).for_each(change);
    let recorder = Recorder::create(recording, &recorded_plan).expect("a recording");
    let options = depthloom_runner::Options::default();
    depthloom_runner::run(ready, &recorder, &options, &Unwatched, &Interrupt::default()).expect("it runs");
    recorder.finish(&[]).expect("closed");
}

/// Exit code, standard output and standard error of `replay --check`.
fn check(run: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let output = depthloom().arg("verify").arg(run).args(more).output().expect("the binary starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

fn check_json(run: &Path, more: &[&str]) -> (Option<i32>, Json) {
    let (code, printed, stderr) = check(run, &[more, &["--json"]].concat());
    (code, serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{stderr}")))
}

/// The number of differing values per node.
fn different(report: &Json) -> Vec<(&str, u64)> {
    let nodes = report["nodes"].as_array().expect("a list").iter();
    nodes.map(|node| (node["node"].as_str().expect("a name"), node["different"].as_u64().expect("a count"))).collect()
}

#[test]
fn replay_recomputes_every_node_equally_including_training() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, out) = (folder.path().join("learnt.yaml"), folder.path().join("run"));
    let text = format!(
        "extends: {}\nexperiment: learnt\nsources:
  train: {{ with: {{ frames: 0..4, width: 320, height: 96 }} }}
  test: {{ with: {{ frames: 0..3, width: 320, height: 96 }} }}\nstages:\n{}",
        workspace().join("experiments/table1.yaml").display(),
        learn(10, 100),
    );
    std::fs::write(&path, text).expect("written");
    run(&path, &out);
    let (code, report) = check_json(&out, &["--workers", "3"]);
    assert_eq!((code, &report["equal"], &report["not_compared"]), (Some(0), &json!(true), &json!([])), "{report:#}");
    assert_eq!(check_json(&out, &["--workers", "1"]).1, report);
    // Every node with a value, on every frame; the trained network and its curve once.
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let nodes = report["nodes"].as_array().expect("a list");
    assert_eq!(nodes.len(), recording.plan().runs.iter().map(|run| run.nodes.len()).sum::<usize>());
    for node in nodes {
        let expected = match (node["stage"].as_str(), node["node"].as_str()) {
            (_, Some("samples")) => 1,
            (_, Some("train")) => 2,
            (Some("learn"), _) => 4,
            _ => 3,
        };
        assert_eq!((&node["compared"], node["numbers"].as_u64() > Some(0)), (&json!(expected), true), "{node}");
    }
    let (code, report) = check_json(&out, &["compare.fused", "trai*"]);
    assert_eq!(
        (code, different(&report).len()),
        (Some(0), 5),
        "four variants of the fused depth, and one training node"
    );
}

#[test]
fn an_unfinished_recording_is_verified_as_far_as_it_goes_with_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, out) = (look(folder.path(), ""), folder.path().join("run"));
    run(&experiment, &out);
    let path = out.join("recording.mcap");
    let bytes = std::fs::read(&path).expect("a recording");
    std::fs::write(&path, &bytes[..bytes.len() * 3 / 4]).expect("written");
    let (code, printed, stderr) = check(&out, &[]);
    assert_eq!(code, Some(0), "{printed}{stderr}");
    assert!(stderr.contains("is unfinished: its last ") && stderr.contains("only complete frames"), "{stderr}");
    // The experiment is there, and no frame.
    std::fs::write(&path, &bytes[..40_000]).expect("written");
    let (code, printed, stderr) = check(&out, &[]);
    assert_eq!((code, printed.as_str()), (Some(2), ""), "{stderr}");
    assert!(stderr.contains("no complete frame"), "{stderr}");
}

#[test]
fn only_a_changed_node_is_reported_with_its_first_and_worst_pixel() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, recording) = (look(folder.path(), ""), folder.path().join("recording.mcap"));
    // Computed with blocks of 5 and recorded with 9: as if the kind had changed without a new version.
    recorded_as(&experiment, &recording, |node| {
        if node.name == "stereo" {
            for params in [&mut node.params, &mut node.portable] {
                params["block"] = json!(9);
            }
        }
    });
    let (code, report) = check_json(&recording, &[]);
    assert_eq!((code, &report["equal"]), (Some(3), &json!(false)), "{report:#}");
    assert_eq!(different(&report), [("stereo", FRAMES), ("depth", 0), ("score.stereo", 0)]);
    assert_eq!(report["error"]["exit_code"], 3);

    // The expected differences, from a run with blocks of 9.
    let out = folder.path().join("nine");
    succeed(
        depthloom()
            .args(["run", "--no-page"])
            .arg(look(folder.path(), ""))
            .args(["--quiet", "--set"])
            .arg(format!("look.stereo.with={}", with_block_9(&recording)))
            .arg("--out")
            .arg(&out),
    );
    let (was, is) = (disparities(&recording), disparities(&out.join("recording.mcap")));
    let (mut first, mut worst, mut count) = (Json::Null, (0.0, Json::Null), 0);
    for (frame, ((id, was), (_, is))) in was.iter().zip(&is).enumerate() {
        for (at, (a, b)) in was.iter().zip(is).enumerate().filter(|(_, (a, b))| a != b) {
            let by = a.zip(*b).map_or(f64::INFINITY, |(a, b)| (a - b).abs());
            let place = json!({ "frame": id, "pixel": [at % 320, at / 320], "recorded": a, "now": b });
            if count == 0 {
                assert_eq!(frame, 0);
                first = place.clone();
            }
            if by > worst.0 {
                worst = (by, place);
            }
            count += 1;
        }
    }
    let node = &report["nodes"][0];
    let reported = |which: &str| {
        let pixel = &node[which];
        assert_eq!((&pixel["topic"], &pixel["type"]), (&json!("/look/stereo/disparity"), &json!("disparity")));
        json!({ "frame": pixel["frame"], "pixel": pixel["pixel"], "recorded": pixel["recorded"], "now": pixel["now"] })
    };
    assert_eq!((reported("first"), reported("worst")), (first, worst.1));
    assert_eq!((&node["different_numbers"], &node["numbers"]), (&json!(count), &json!(320 * 96 * FRAMES)));

    let (code, printed, stderr) = check(&recording, &["stereo"]);
    assert_eq!((code, stderr.as_str()), (Some(3), "1 of 1 node computed other values than recorded\n"));
    assert!(
        printed.contains("\n  first  frame ") && printed.contains(", /look/stereo/disparity, pixel ("),
        "{printed}"
    );
    // Unchanged nodes are equal, also if selected by name. No tolerance makes invalid and valid pixels equal.
    assert_eq!(check(&recording, &["depth", "look.score.*"]).0, Some(0));
    assert_eq!(check(&recording, &["--tolerance", "1e9"]).0, Some(3));
}

/// The recorded parameters of stereo: block 9, with the penalties of block 5.
fn with_block_9(recording: &Path) -> Json {
    Recording::open(recording).expect("a recording").plan().runs[0].nodes[0].params.clone()
}

/// Per frame its id and its disparities in pixels; `None` for invalid pixels.
fn disparities(recording: &Path) -> Vec<(String, Vec<Option<f64>>)> {
    let recording = Recording::open(recording).expect("a recording");
    let mut reader = recording.reader(RunId(0), &["/look/stereo/disparity"]).expect("a topic");
    let frame = |position: usize| {
        let Some(Value::Disparity(map)) = reader.read(FrameIndex(position)).expect("a frame").remove(0) else {
            panic!("a map")
        };
        let pixels = |value: &i16| (i32::from(*value) != map.invalid()).then(|| f64::from(*value) / 16.0);
        let values = map.sixteenths_px.as_raw().iter().map(pixels).collect();
        (recording.frames(RunId(0))[position].id.to_string(), values)
    };
    (0..recording.frames(RunId(0)).len()).map(frame).collect()
}

#[test]
fn nodes_that_cannot_be_recomputed_are_noted_or_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = look(folder.path(), "");
    let recording = folder.path().join("recording.mcap");
    recorded_as(&experiment, &recording, |node| match node.name.as_str() {
        "stereo" => node.kind = "stereo/removed".to_owned(),
        "depth" => node.version += 1,
        _ => {}
    });
    let (code, report) = check_json(&recording, &[]);
    assert_eq!((code, different(&report)), (Some(0), vec![("depth", 0), ("score.stereo", 0)]), "{report:#}");
    assert_eq!(report["not_compared"][0]["why"], "this version has no kind `stereo/removed`");
    let remark = report["nodes"][0]["remarks"][0].as_str().expect("a remark");
    assert!(remark.starts_with("recorded by version ") && remark.contains("of its kind, recomputed by"), "{remark}");
    let (code, _, stderr) = check(&recording, &["stereo"]);
    assert!(code == Some(2) && stderr.contains("this version has no kind `stereo/removed`"), "{stderr}");
    let (code, _, stderr) = check(&recording, &["sterio"]);
    assert!(code == Some(2) && stderr.contains("did you mean `stereo`?"), "{stderr}");

    // The input of `depth` is not recorded, but can be recomputed; the ground truth of scores cannot.
    let out = folder.path().join("some");
    run(&look(folder.path(), "record: [source/left, source/right, source/calibration, depth]\n"), &out);
    let (code, report) = check_json(&out, &[]);
    assert_eq!((code, different(&report)), (Some(0), vec![("depth", 0)]), "{report:#}");
    assert_eq!(report["nodes"][0]["remarks"], json!(["reads `stereo` recomputed, which is not recorded"]));
    let why = report["not_compared"][0]["why"].as_str().expect("why");
    assert!(why.starts_with("input `ground_truth` was /look/source/depth, which is not in the recording"), "{why}");
    // It is an error if nothing can be compared.
    let out = folder.path().join("scores");
    run(&look(folder.path(), "record: []\n"), &out);
    assert_eq!(check(&out, &[]).0, Some(2));

    let out = folder.path().join("every");
    run(&look(folder.path(), "record: { every: 2 }\n"), &out);
    let (code, report) = check_json(&out, &[]);
    assert_eq!(
        (code, &report["nodes"][0]["compared"], &report["every"]),
        (Some(0), &json!(2), &json!(2)),
        "{report:#}"
    );
}

#[test]
fn truncated_recordings_are_compared_and_damaged_ones_fail() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    run(&look(folder.path(), ""), &out);
    let bytes = std::fs::read(out.join("recording.mcap")).expect("a recording");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("written");
        path
    };
    let cut = write("cut.mcap", &bytes[..bytes.len() / 2]);
    let frames = Recording::open(&cut).expect("a recording").frames(RunId(0)).len();
    assert!((1..3).contains(&frames));
    let (code, report) = check_json(&cut, &[]);
    assert_eq!((code, &report["nodes"][0]["compared"]), (Some(0), &json!(frames)), "{report:#}");

    // A changed bit in a value that is read.
    let is_read_wrong = |path: &PathBuf| {
        let recording = Recording::open(path).expect("a readable plan");
        let mut reader = recording.reader(RunId(0), &["/look/stereo/disparity"]).expect("a topic");
        (0..recording.frames(RunId(0)).len()).any(|position| reader.read(FrameIndex(position)).is_err())
    };
    let mut flipped = (1..128).map(|part| {
        let (mut flipped, at) = (bytes.clone(), bytes.len() * part / 128);
        flipped[at] ^= 0x10;
        write("flipped.mcap", &flipped)
    });
    let flipped = flipped.find(is_read_wrong).expect("a bit of a disparity map");
    let (code, report) = check_json(&flipped, &[]);
    assert_eq!((code, report["damage"].as_array().map(Vec::len)), (Some(3), Some(1)), "{report:#}");
    assert_eq!(report["nodes"][0]["compared"], 2, "the other frames are compared");
}

#[test]
fn a_failing_node_does_not_stop_the_comparison_of_others() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = |record: &str| {
        let source = "train: { kind: synthetic/road, with: { frames: 0..3, width: 320, height: 96, seed: 4 } }";
        format!("experiment: learnt\nsources: {{ {source} }}\n{record}stages:\n{}", learn(4, 100))
    };
    let experiment = folder.path().join("learnt.yaml");
    let recording = folder.path().join("recording.mcap");
    let recorded = |record: &str, name: &str, set: &[(&str, Json)]| {
        std::fs::write(&experiment, text(record)).expect("written");
        recorded_as(&experiment, &recording, |node| {
            for (key, value) in set.iter().filter(|_| node.name == name) {
                for params in [&mut node.params, &mut node.portable] {
                    params[key] = value.clone();
                }
            }
        });
        check_json(&recording, &[])
    };
    let failed = |report: &Json| -> Vec<(String, String)> {
        let failed = report["failed"].as_array().expect("a list").iter();
        let text = |node: &Json, key: &str| node[key].as_str().expect("text").to_owned();
        failed.map(|node| (text(node, "node"), text(node, "why"))).collect()
    };
    // An aggregate node.
    let (code, report) = recorded("", "train", &[("learning_rate", json!(1e30))]);
    assert_eq!(
        (code, &report["equal"], different(&report)),
        (Some(3), &json!(false), vec![("stereo", 0), ("edges", 0), ("samples", 0), ("train", 2),]),
        "{report:#}"
    );
    assert_eq!(failed(&report).len(), 1);
    assert!(failed(&report)[0].1.starts_with("training diverged"), "{report:#}");
    assert_eq!(report["error"]["message"], "1 node failed");
    assert!(
        report["nodes"][3]["first"]["now"]
            .as_str()
            .is_some_and(|now| now.starts_with("none, because it failed: training"))
    );

    // An ordered node that fails on its first frame. Its outputs are recorded, so its consumers are compared.
    let size = [("size", json!([640, 32]))];
    let (code, report) = recorded("", "samples", &size);
    assert_eq!((code, different(&report)[2..].to_vec()), (Some(3), vec![("samples", 1), ("train", 0)]), "{report:#}");
    assert!(failed(&report)[0].1.starts_with("frame `000000_10`: `image` is 320x96, smaller"), "{report:#}");
    // Its outputs are not recorded, so its consumers are not compared.
    let (code, report) = recorded("record: [source, stereo, edges, train]\n", "samples", &size);
    assert_eq!((code, different(&report)), (Some(3), vec![("stereo", 0), ("edges", 0)]), "{report:#}");
    assert_eq!(report["not_compared"][0]["why"], "it reads `samples` recomputed, which failed");
    let (code, printed, stderr) = check(&recording, &[]);
    assert_eq!((code, stderr.as_str()), (Some(3), "1 node failed\n"));
    assert!(printed.contains("\nfailed: learn.samples: frame `000000_10`: `image`"), "{printed}");
}
