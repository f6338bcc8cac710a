//! How long it takes to find the values of many recordings: one for each part of an experiment that ran in parts.
//!
//! `cargo bench -p depthloom-recording --bench earlier_runs -- 1000 42` opens 1000 recordings of 42 frames each, which
//! have 20 keys per frame, and looks up every key. It prints seconds.

use std::time::Instant;

use depthloom_graphs::contracts::{Commit, Sink as _, SlotKey, Store as _};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key};
use depthloom_recording::{EarlierRuns, Recorder};

#[expect(dead_code, reason = "the bench takes the plan from the tests' fixture")]
#[path = "../tests/recording/fixture.rs"]
mod fixture;

const NODES: usize = 19;

fn plan() -> Plan {
    let mut plan = fixture::plan();
    let nodes = &mut plan.runs[0].nodes;
    for map in nodes.len()..NODES {
        let mut node = nodes[NodeId(3)].clone();
        node.outputs.iter_mut().for_each(|output| output.topic = format!("/compare/map{map}/depth"));
        nodes.push(node);
    }
    plan
}

fn source_key(frame: &Frame) -> Key {
    Key::build("source").number(frame.index).finish()
}

fn main() {
    let numbers: Vec<usize> = std::env::args().filter_map(|argument| argument.parse().ok()).collect();
    let (recordings, frames) = match *numbers {
        [recordings, frames] => (recordings, frames),
        _ => (20, 5),
    };
    let (folder, plan) = (tempfile::tempdir().expect("a folder"), plan());
    let paths: Vec<_> = (0..recordings).map(|number| folder.path().join(format!("{number}.mcap"))).collect();
    for (number, path) in paths.iter().enumerate() {
        let recorder = Recorder::create(path, &plan).expect("a recording");
        for position in 0..frames {
            let frame = fixture::frame((number * frames + position) as u64);
            let parts = (0..recorder.parts(RunId(0)))
                .map(|part| recorder.encode(RunId(0), (FrameIndex(position), &frame), PartId(part), &[]));
            let parts = parts.collect::<Result<_, _>>().expect("no values");
            let keys: Vec<_> =
                NodeId::all(NODES).map(|node| SlotKey { node, key: fixture::key(&frame, node) }).collect();
            let commit = Commit {
                run: RunId(0),
                frame: &frame,
                source_key: Some(source_key(&frame)),
                keys: &keys,
                failures: &[],
                absent: &[],
                warnings: &[],
                live: None,
            };
            recorder.write(&commit, parts).expect("written");
        }
        recorder.finish(&[]).expect("finished");
    }

    let start = Instant::now();
    let store = EarlierRuns::new(&paths, &plan);
    println!("open {recordings} recordings: {:.3} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    assert!(store.find(&source_key(&fixture::frame(0))).is_some());
    println!("first lookup: {:.3} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    for index in 0..recordings * frames {
        let frame = fixture::frame(index as u64);
        assert!(store.find(&source_key(&frame)).is_some());
        for node in NodeId::all(NODES) {
            assert!(store.find(&fixture::key(&frame, node)).is_some());
        }
    }
    println!("{} lookups: {:.3} s", recordings * frames * (NODES + 1), start.elapsed().as_secs_f64());
    // As many that are in no recording.
    let start = Instant::now();
    for number in 0..recordings * frames * (NODES + 1) {
        assert!(store.find(&Key::build("unknown").number(number as u64).finish()).is_none());
    }
    println!("as many lookups of unknown keys: {:.3} s", start.elapsed().as_secs_f64());
}
