//! What a live run knows of its frames is stored with their commits.
#![expect(clippy::unwrap_used, reason = "helpers fail as tests do")]

use std::path::Path;

use depthloom_graphs::contracts::{Drops, LiveCommit};
use depthloom_graphs::plan::RunId;
use depthloom_recording::{Condition, LiveTotals, Recorder, Recording};

use crate::digest::digest;
use crate::fixture::{frame, plan_of, record_frame, record_live_frame, values};

/// What the fixture's live run knows of a frame.
pub(crate) const fn live(index: u64) -> LiveCommit {
    LiveCommit {
        drops: Drops { graph: index, recording: index % 2, source: 10 * index },
        latency_ns: 1_000_000 * index + 7,
    }
}

/// A batch stage with two frames, then a live one with four.
fn record(path: &Path) -> Recorder {
    let plan = plan_of(&["train", "compare"]);
    let recorder = Recorder::create(path, &plan).unwrap();
    for index in 0..2 {
        record_frame(&recorder, RunId(0), &frame(index), &values(&frame(index), 16, 12), false);
    }
    for index in 0..4 {
        let frame = frame(index);
        let values = values(&frame, 16, 12);
        record_live_frame(&recorder, RunId(1), (index as usize, &frame), &values, false, Some(live(index)));
    }
    recorder
}

#[test]
fn drops_and_latencies_of_live_frames_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = record(&path);
    let check = |condition: Condition| {
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.condition(), &condition);
        assert!(recording.frames(RunId(0)).iter().all(|frame| frame.live.is_none()));
        let read: Vec<_> = recording.frames(RunId(1)).iter().map(|frame| frame.live).collect();
        assert_eq!(read, (0..4).map(|index| Some(live(index))).collect::<Vec<_>>());
        let dropped = Drops { graph: 6, recording: 2, source: 60 };
        assert_eq!(recording.live_totals(), Some(LiveTotals { frames: 4, dropped }));
    };
    // Without a summary, the file is scanned.
    check(Condition::Unfinished { rest_bytes: 0 });
    recorder.finish(&[]).unwrap();
    check(Condition::Complete);
    assert_eq!(digest(&path)["topics"]["/compare/commit"]["count"], 4);
}

#[test]
fn only_live_commits_have_the_schema_of_live_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path).finish(&[]).unwrap();
    let summary = mcap::Summary::read(&std::fs::read(&path).unwrap()).unwrap().expect("a summary");
    let has_live = |topic: &str| {
        let channel = summary.channels.values().find(|channel| channel.topic == topic).expect("its channel");
        let schema = channel.schema.as_ref().expect("its schema");
        assert_eq!(schema.name, "depthloom.Commit");
        schema.data.windows(9).any(|bytes| bytes == b"depthloom")
            && schema.data.windows(4).any(|bytes| bytes == b"Live")
    };
    assert!(!has_live("/train/commit"));
    assert!(has_live("/compare/commit"));
}

#[test]
fn a_batch_recording_has_no_live_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    crate::fixture::record(&path, &crate::fixture::plan(), 0..2, 16, 12);
    assert_eq!(Recording::open(&path).unwrap().live_totals(), None);
    assert_eq!(Recording::open(&path).unwrap().windows(), []);
    assert!(!std::fs::read(&path).unwrap().windows(13).any(|bytes| bytes == b"dropped_graph"));
}
