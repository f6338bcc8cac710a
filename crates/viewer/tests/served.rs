//! Clients that are not ours, written in Python: they receive what a recording stores, and cannot slow a run.
#![expect(clippy::unwrap_used, reason = "helpers fail as tests do")]

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot};
use depthloom_graphs::plan::{FrameIndex, PartId, PortId, RunId};
use depthloom_graphs::values::Pixels;
use depthloom_graphs::{Frame, Key, Value};
use depthloom_recording::{Recorder, Recording, StoredMessage};
use depthloom_test_needs::{viewer_client, workspace};
use depthloom_viewer::{ServeAddress, Viewer, ViewerSink};
use serde_json::Value as Json;

#[expect(dead_code, reason = "some of the fixture is only for recordings")]
#[path = "../../../recording/tests/recording/fixture.rs"]
mod fixture;

use fixture::{frame, plan, record_live_frame, values};

const RUN: RunId = RunId(0);
const LEFT: &str = "/compare/source/left/image";
const RIGHT: &str = "/compare/source/right/image";
const CALIBRATION: &str = "/compare/source/left/calibration";
const DISPARITY: &str = "/compare/stereo/disparity";
const DEPTH: &str = "/compare/fused/depth";
const VIEW: &str = "/compare/view/fused.depth";
const PATIENCE: Duration = Duration::from_secs(60);

fn viewer(topics: &[&str]) -> Viewer {
    let address = ServeAddress::parse("127.0.0.1:0").expect("an address");
    let topics: Vec<String> = topics.iter().map(|&topic| topic.to_owned()).collect();
    Viewer::start(&plan(), address, &topics, "depthloom test").expect("a server")
}

/// A running client, which is ended when it is dropped.
struct Client {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Client {
    fn start(python: &Path, viewer: &Viewer, count: &str, topics: &[&str]) -> Self {
        let script = workspace().join("tests/python/watch_viewer.py");
        let mut command = Command::new(python);
        command.arg(script).arg(format!("ws://{}", viewer.address())).arg(count).args(topics);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("Python starts");
        let lines = BufReader::new(child.stdout.take().expect("a pipe"));
        Self { child, lines }
    }

    fn line(&mut self) -> Json {
        let mut line = String::new();
        self.lines.read_line(&mut line).expect("text");
        serde_json::from_str(&line).expect("a line of JSON")
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_client_receives_the_messages_of_the_recording() {
    const COUNT: usize = 5;
    let Some(python) = viewer_client("a_client_receives_the_messages_of_the_recording") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    let mut viewer = viewer(&[]);
    let topics = [LEFT, RIGHT, CALIBRATION, DISPARITY, DEPTH, VIEW];
    let mut written = 0;
    {
        let sink = ViewerSink::new(&recorder, Some(&viewer));
        let mut write = || {
            let frame = frame(written);
            record_live_frame(&sink, RUN, (written as usize, &frame), &values(&frame, 40, 24), false, None);
            written += 1;
        };
        (0..8).for_each(|_| write());
        assert_eq!(viewer.counts().messages, 0, "nothing is sent without clients");
        let mut client = Client::start(&python, &viewer, &COUNT.to_string(), &topics);
        let began = Instant::now();
        let received = std::thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let offered = client.line();
                (offered, (0..COUNT * topics.len()).map(|_| client.line()).collect::<Vec<Json>>())
            });
            while !reader.is_finished() {
                assert!(began.elapsed() < PATIENCE, "the client received too little");
                write();
                std::thread::sleep(Duration::from_millis(10));
            }
            reader.join().expect("a client")
        });
        let (offered, messages) = received;
        assert!(offered["offered"].as_array().unwrap().iter().any(|topic| topic == "/compare/score_fused/scores"));
        viewer.finish();
        recorder.finish(&[]).unwrap();
        check(&path, &messages, COUNT);
    }
    let counts = viewer.counts();
    assert!(counts.messages >= (COUNT * topics.len()) as u64, "{counts:?}");
    assert!(viewer.take_error().is_none());
}

/// Compares received messages with those of the recording, and decoded pixels with the values that were sent.
fn check(path: &Path, messages: &[Json], count: usize) {
    let mut stored: BTreeMap<(String, u64), u32> = BTreeMap::new();
    let mut positions: BTreeMap<u64, u64> = BTreeMap::new();
    let recording = Recording::open(path).unwrap();
    for (position, frame) in recording.frames(RUN).iter().enumerate() {
        positions.insert(frame.time_ns, position as u64);
    }
    let read = recording.each_message(|StoredMessage { topic, time_ns, data, .. }| {
        stored.insert((topic.to_owned(), time_ns), crc32fast::hash(data));
        Ok(())
    });
    read.unwrap();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for message in messages {
        let (topic, time_ns) = (message["topic"].as_str().unwrap(), message["time_ns"].as_u64().unwrap());
        *counts.entry(topic).or_default() += 1;
        // Topics in a recording have the names of the plan.
        let planned = match topic {
            LEFT => "/compare/source/left",
            RIGHT => "/compare/source/right",
            CALIBRATION => "/compare/source/calibration",
            other => other,
        };
        let found = stored.get(&(planned.to_owned(), time_ns)).or_else(|| stored.get(&(topic.to_owned(), time_ns)));
        assert_eq!(found.map(|crc| Json::from(*crc)), Some(message["crc32"].clone()), "{message}");
        let frame = frame(positions[&time_ns]);
        let sent = values(&frame, 40, 24);
        let value = |slot: Slot| &sent.iter().find(|(of, _)| *of == slot).expect("a value").1;
        match (topic, value(Slot::Source { port: PortId(usize::from(topic == RIGHT)) })) {
            (LEFT, Value::Image(image)) => {
                let bytes = &image.encoded().expect("the file's bytes").bytes;
                assert_eq!(
                    (&message["format"], &message["data_crc32"]),
                    (&"png".into(), &crc32fast::hash(bytes).into())
                );
            }
            (RIGHT, Value::Image(image)) => {
                let Pixels::Grey(grey) = image.pixels() else { panic!("a grey image") };
                assert_eq!(message["encoding"], "mono8");
                assert_eq!(message["pixels_crc32"], crc32fast::hash(grey));
                assert_eq!(message["size"], serde_json::json!([40, 24]));
            }
            (CALIBRATION, _) => assert_eq!(message["focal_px"], 721.5377 + frame.index as f64 / 3.0),
            (DISPARITY, _) => {
                let disparity = sent.iter().find_map(|(_, value)| match value {
                    Value::Disparity(disparity) => Some(disparity),
                    _ => None,
                });
                // 0 = invalid, else value / 16 + min_disparity_px - 1 pixels.
                let pixels = disparity.expect("a disparity").sixteenths_px.iter().map(|&of| (of + 4 * 16) as u16);
                let bytes: Vec<u8> = pixels.flat_map(u16::to_le_bytes).collect();
                assert_eq!(message["pixels_crc32"], crc32fast::hash(&bytes));
            }
            (DEPTH, _) => assert_eq!(message["schema"], "depthloom.FloatMap"),
            (VIEW, _) => {
                assert_eq!((&message["format"], &message["frame_id"]), (&"png".into(), &"compare/view".into()));
            }
            _ => panic!("{message}"),
        }
    }
    assert!(counts.len() == 6 && counts.values().all(|found| *found == count), "{counts:?}");
}

/// Takes all parts, and measures nothing else than what is around it.
#[derive(Default)]
struct Nowhere(Mutex<u64>);

impl Sink for Nowhere {
    type Part = ();

    fn parts(&self, _: RunId) -> usize {
        1
    }

    fn part(&self, _: RunId, _: Slot) -> Option<PartId> {
        Some(PartId(0))
    }

    fn encode(&self, _: RunId, _: (FrameIndex, &Frame), _: PartId, _: &[(Slot, Value)]) -> Result<(), ErrorMessage> {
        *self.0.lock().expect("no panic") += 1;
        Ok(())
    }

    fn write(&self, _: &Commit<'_>, _: Vec<()>) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn once(&self, _: RunId, _: Slot, _: &Key, _: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        Ok(())
    }
}

#[test]
fn a_client_that_never_reads_does_not_slow_the_run() {
    const FRAMES: usize = 300;
    let Some(python) = viewer_client("a_client_that_never_reads_does_not_slow_the_run") else { return };
    let (sink, viewer) = (Nowhere::default(), viewer(&[LEFT, RIGHT, "*/depth", "*/disparity"]));
    let shown = ViewerSink::new(&sink, Some(&viewer));
    let all = values(&frame(0), 1242, 375);
    let encode = |index: u64| {
        let began = Instant::now();
        shown.encode(RUN, (FrameIndex(index as usize), &frame(index)), PartId(0), &all).unwrap();
        began.elapsed()
    };
    encode(0);
    let topics = [LEFT, RIGHT, DEPTH, VIEW, DISPARITY];
    let mut clients = [(); 2].map(|()| Client::start(&python, &viewer, "stall", &topics));
    clients.iter_mut().for_each(|client| drop(client.line()));
    let began = Instant::now();
    while viewer.counts().messages == 0 {
        assert!(began.elapsed() < PATIENCE, "the clients did not subscribe");
        encode(0);
        std::thread::sleep(Duration::from_millis(10));
    }
    // As fast as the run can: more than can be encoded.
    let mut times: Vec<Duration> = (1..=FRAMES as u64)
        .map(|index| {
            let time = encode(index);
            std::thread::sleep(Duration::from_millis(1));
            time
        })
        .collect();
    times.sort_unstable();
    let (median, slowest) = (times[FRAMES / 2], times[FRAMES - 1]);
    let counts = viewer.counts();
    println!("encode of the sink: median {median:?}, slowest {slowest:?}; {counts:?}");
    assert!(median < Duration::from_millis(2), "{median:?}");
    assert!(slowest < Duration::from_millis(500), "{slowest:?}");
    assert!(counts.dropped_frames > FRAMES as u64 / 2, "{counts:?}");
    // The thread still works for other clients, although these two do not read.
    let before = counts.messages;
    let began = Instant::now();
    while viewer.counts().messages < before + 20 {
        assert!(began.elapsed() < PATIENCE, "the viewer's thread stands still");
        encode(FRAMES as u64 + 1);
        std::thread::sleep(Duration::from_millis(20));
    }
    let began = Instant::now();
    drop(viewer);
    assert!(began.elapsed() < Duration::from_secs(5), "the end does not wait for clients");
}
