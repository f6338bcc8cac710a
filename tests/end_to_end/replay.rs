//! Nodes made again from a recording: equal where nothing changed, and where something did, it is that node which is
//! told.

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

/// The first look on three small frames, with whatever else is set.
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

/// Runs an experiment and records another plan with its values: what a kind that changed since then leaves.
fn recorded_as(experiment: &Path, recording: &Path, change: impl Fn(&mut PlannedNode)) {
    let registry = depthloom::registry();
    let plan = load(experiment, &registry, &Options::default()).expect("it is right").plan;
    let ready = Ready::new(plan, &registry).unwrap_or_else(|missing| panic!("{missing:?}"));
    // With the recipes that the run has: what a kind's results depend on besides is known only now.
    let mut told: Plan = ready.plan.clone();
    told.runs.iter_mut().flat_map(|run| &mut run.nodes).for_each(change);
    let recorder = Recorder::create(recording, &told).expect("a recording");
    let options = depthloom_runner::Options::default();
    depthloom_runner::run(ready, &recorder, &options, &Unwatched, &Interrupt::default()).expect("it runs");
    recorder.finish(&[]).expect("closed");
}

/// What `replay --check` ends with, prints and says.
fn check(run: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let output = depthloom().arg("replay").arg(run).arg("--check").args(more).output().expect("the binary starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

fn check_json(run: &Path, more: &[&str]) -> (Option<i32>, Json) {
    let (code, printed, said) = check(run, &[more, &["--json"]].concat());
    (code, serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{said}")))
}

/// By node, how many values differ.
fn different(told: &Json) -> Vec<(&str, u64)> {
    let nodes = told["nodes"].as_array().expect("a list").iter();
    nodes.map(|node| (node["node"].as_str().expect("a name"), node["different"].as_u64().expect("a count"))).collect()
}

#[test]
fn every_node_of_a_run_is_made_again_equal_learning_too() {
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
    let (code, told) = check_json(&out, &["--workers", "3"]);
    assert_eq!((code, &told["equal"], &told["not_compared"]), (Some(0), &json!(true), &json!([])), "{told:#}");
    assert_eq!(check_json(&out, &["--workers", "1"]).1, told);
    // Every node that gave a value, on every frame; what is learnt once, its curve too.
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let nodes = told["nodes"].as_array().expect("a list");
    assert_eq!(nodes.len(), recording.plan().runs.iter().map(|run| run.nodes.len()).sum::<usize>());
    for node in nodes {
        let expected = match (node["stage"].as_str(), node["node"].as_str()) {
            (_, Some("samples")) => 1,
            (_, Some("teacher")) => 2,
            (Some("learn"), _) => 4,
            _ => 3,
        };
        assert_eq!((&node["compared"], node["numbers"].as_u64() > Some(0)), (&json!(expected), true), "{node}");
    }
    let (code, told) = check_json(&out, &["compare.fused", "tea*"]);
    assert_eq!((code, different(&told).len()), (Some(0), 5), "a fused depth in each of four variants, one teacher");
}

#[test]
fn a_node_that_changed_is_told_with_its_first_and_its_worst_pixel_and_none_behind_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, recording) = (look(folder.path(), ""), folder.path().join("recording.mcap"));
    // Matched in blocks of 5 and recorded as of 9: as if the kind had changed, and its version had not.
    recorded_as(&experiment, &recording, |node| {
        if node.name == "stereo" {
            for params in [&mut node.params, &mut node.portable] {
                params["block"] = json!(9);
            }
        }
    });
    let (code, told) = check_json(&recording, &[]);
    assert_eq!((code, &told["equal"]), (Some(3), &json!(false)), "{told:#}");
    assert_eq!(different(&told), [("stereo", FRAMES), ("depth", 0), ("score.stereo", 0)]);
    assert_eq!(told["error"]["exit_code"], 3);

    // The same by a run of its own, and a loop.
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
    let node = &told["nodes"][0];
    let told_of = |which: &str| {
        let of = &node[which];
        assert_eq!((&of["topic"], &of["type"]), (&json!("/look/stereo/disparity"), &json!("disparity")));
        json!({ "frame": of["frame"], "pixel": of["pixel"], "recorded": of["recorded"], "now": of["now"] })
    };
    assert_eq!((told_of("first"), told_of("worst")), (first, worst.1));
    assert_eq!((&node["different_numbers"], &node["numbers"]), (&json!(count), &json!(320 * 96 * FRAMES)));

    let (code, printed, said) = check(&recording, &["stereo"]);
    assert_eq!((code, said.as_str()), (Some(3), "1 of 1 node gave other values than recorded\n"));
    assert!(
        printed.contains("\n  first  frame ") && printed.contains(", /look/stereo/disparity, pixel ("),
        "{printed}"
    );
    // What does not change is equal, also by name; no tolerance makes an answer of none.
    assert_eq!(check(&recording, &["depth", "look.score.*"]).0, Some(0));
    assert_eq!(check(&recording, &["--tolerance", "1e9"]).0, Some(3));
}

/// The parameters of stereo as recorded: with the block of 9, and the penalties of blocks of 5.
fn with_block_9(recording: &Path) -> Json {
    Recording::open(recording).expect("a recording").plan().runs[0].nodes[0].params.clone()
}

/// By frame its id, and the disparities, pixels; `None`: nothing found.
fn disparities(recording: &Path) -> Vec<(String, Vec<Option<f64>>)> {
    let recording = Recording::open(recording).expect("a recording");
    let mut reader = recording.reader(RunId(0), &["/look/stereo/disparity"]).expect("a topic");
    let frame = |position: usize| {
        let Some(Value::Disparity(map)) = reader.read(FrameIndex(position)).expect("a frame").remove(0) else {
            panic!("a map")
        };
        let of = |value: &i16| (i32::from(*value) != map.invalid()).then(|| f64::from(*value) / 16.0);
        let values = map.sixteenths_px.as_raw().iter().map(of).collect();
        (recording.frames(RunId(0))[position].id.to_string(), values)
    };
    (0..recording.frames(RunId(0)).len()).map(frame).collect()
}

#[test]
fn what_cannot_be_made_again_is_said_and_by_name_it_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = look(folder.path(), "");
    let recording = folder.path().join("recording.mcap");
    recorded_as(&experiment, &recording, |node| match node.name.as_str() {
        "stereo" => node.kind = "stereo/of-yore".to_owned(),
        "depth" => node.version += 1,
        _ => {}
    });
    let (code, told) = check_json(&recording, &[]);
    assert_eq!((code, different(&told)), (Some(0), vec![("depth", 0), ("score.stereo", 0)]), "{told:#}");
    assert_eq!(told["not_compared"][0]["why"], "this program has no kind `stereo/of-yore`");
    let remark = told["nodes"][0]["remarks"][0].as_str().expect("a remark");
    assert!(remark.starts_with("recorded by version ") && remark.contains("of its kind, recomputed by"), "{remark}");
    let (code, _, said) = check(&recording, &["stereo"]);
    assert!(code == Some(2) && said.contains("this program has no kind `stereo/of-yore`"), "{said}");
    let (code, _, said) = check(&recording, &["sterio"]);
    assert!(code == Some(2) && said.contains("did you mean `stereo`?"), "{said}");

    // Depth's input is not recorded, but can be made of what is; scores' truth cannot.
    let out = folder.path().join("some");
    run(&look(folder.path(), "record: [source/left, source/right, source/calibration, depth]\n"), &out);
    let (code, told) = check_json(&out, &[]);
    assert_eq!((code, different(&told)), (Some(0), vec![("depth", 0)]), "{told:#}");
    assert_eq!(told["nodes"][0]["remarks"], json!(["reads `stereo` recomputed, which is not recorded"]));
    let why = told["not_compared"][0]["why"].as_str().expect("why");
    assert!(why.starts_with("input `truth` was /look/source/depth, which is not in the recording"), "{why}");
    // Nothing at all that could be compared is no pass.
    let out = folder.path().join("scores");
    run(&look(folder.path(), "record: []\n"), &out);
    assert_eq!(check(&out, &[]).0, Some(2));

    let out = folder.path().join("every");
    run(&look(folder.path(), "record: { every: 2 }\n"), &out);
    let (code, told) = check_json(&out, &[]);
    assert_eq!((code, &told["nodes"][0]["compared"], &told["every"]), (Some(0), &json!(2), &json!(2)), "{told:#}");
}

#[test]
fn a_recording_that_was_cut_is_compared_as_far_as_it_is_whole_and_a_damaged_one_does_not_pass() {
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
    let (code, told) = check_json(&cut, &[]);
    assert_eq!((code, &told["nodes"][0]["compared"]), (Some(0), &json!(frames)), "{told:#}");

    // A bit of something that is read, wherever that lies.
    let is_read_wrong = |path: &PathBuf| {
        let recording = Recording::open(path).expect("its plan is sound");
        let mut reader = recording.reader(RunId(0), &["/look/stereo/disparity"]).expect("a topic");
        (0..recording.frames(RunId(0)).len()).any(|position| reader.read(FrameIndex(position)).is_err())
    };
    let mut flipped = (1..128).map(|part| {
        let (mut flipped, at) = (bytes.clone(), bytes.len() * part / 128);
        flipped[at] ^= 0x10;
        write("flipped.mcap", &flipped)
    });
    let flipped = flipped.find(is_read_wrong).expect("disparities lie somewhere");
    let (code, told) = check_json(&flipped, &[]);
    assert_eq!((code, told["damage"].as_array().map(Vec::len)), (Some(3), Some(1)), "{told:#}");
    assert_eq!(told["nodes"][0]["compared"], 2, "the frames beside it are compared");
}

#[test]
fn a_node_that_fails_ends_no_comparison_of_others() {
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
    let failed = |told: &Json| -> Vec<(String, String)> {
        let failed = told["failed"].as_array().expect("a list").iter();
        let text = |node: &Json, key: &str| node[key].as_str().expect("text").to_owned();
        failed.map(|node| (text(node, "node"), text(node, "why"))).collect()
    };
    // A once-node.
    let (code, told) = recorded("", "teacher", &[("learning_rate", json!(1e30))]);
    assert_eq!(
        (code, &told["equal"], different(&told)),
        (Some(3), &json!(false), vec![("stereo", 0), ("edges", 0), ("samples", 0), ("teacher", 2),]),
        "{told:#}"
    );
    assert_eq!(failed(&told).len(), 1);
    assert!(failed(&told)[0].1.starts_with("learning diverged"), "{told:#}");
    assert_eq!(told["error"]["message"], "1 node failed");
    assert!(
        told["nodes"][3]["first"]["now"].as_str().is_some_and(|now| now.starts_with("none, for it failed: learning"))
    );

    // An ordered node, on its first frame; what it did not give is recorded for who reads it.
    let size = [("size", json!([640, 32]))];
    let (code, told) = recorded("", "samples", &size);
    assert_eq!((code, different(&told)[2..].to_vec()), (Some(3), vec![("samples", 1), ("teacher", 0)]), "{told:#}");
    assert!(failed(&told)[0].1.starts_with("frame `000000_10`: `image` is 320x96, smaller"), "{told:#}");
    // Or is not: then who reads it is not compared.
    let (code, told) = recorded("record: [source, stereo, edges, teacher]\n", "samples", &size);
    assert_eq!((code, different(&told)), (Some(3), vec![("stereo", 0), ("edges", 0)]), "{told:#}");
    assert_eq!(told["not_compared"][0]["why"], "it reads `samples` recomputed, which failed");
    let (code, printed, said) = check(&recording, &[]);
    assert_eq!((code, said.as_str()), (Some(3), "1 node failed\n"));
    assert!(printed.contains("\nfailed: learn.samples: frame `000000_10`: `image`"), "{printed}");
}
