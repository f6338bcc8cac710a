//! `process/source` with `stream: true`: frames, deadlines, restarts.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant, SystemTime};

use depthloom_graphs::contracts::{NextFrame, StreamFrame, StreamingSource};
use depthloom_graphs::values::{Image, Pixels};
use depthloom_graphs::{Fault, Value};
use depthloom_test_needs::{python, workspace};
use serde_json::{Value as Json, json};

const LONG: Duration = Duration::from_secs(60);

fn stream(params: &Json) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
    let registry = depthloom_nodes::registry();
    let entry = registry.source_kind("process/source").unwrap();
    let resolved = entry.resolve(params).map_err(|error| Fault::new(error.what))?;
    entry.stream(&resolved)
}

/// The parameters of a Python program with the package of this workspace; `more` replaces some of them.
fn program(python: &Path, file: &Path, more: &Json) -> Json {
    depthloom_nodes::process::permission::allow();
    let mut params = json!({
        "command": [python, file],
        "outputs": { "left": "image" },
        "stream": true,
        "version": 1,
        "env": { "PYTHONPATH": workspace().join("python/src") },
    });
    params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    params
}

/// Starts a program of these lines in a generator.
fn started(python: &Path, folder: &Path, lines: &str, more: &Json) -> Box<dyn StreamingSource> {
    stream(&written(python, folder, lines, more)).unwrap_or_else(|fault| panic!("{}", fault.chain())).unwrap()
}

fn written(python: &Path, folder: &Path, lines: &str, more: &Json) -> Json {
    let mut text = String::from(
        "import os, pathlib, sys, time\nimport numpy as np\nimport depthloom\n\n\
         def image(grey):\n    return {\"left\": np.full((3, 4), grey, np.uint8)}\n\n\
         @depthloom.stream(outputs={\"left\": \"image\"})\ndef camera():\n",
    );
    text.extend(lines.trim_matches('\n').lines().map(|line| format!("    {line}\n")));
    text.push_str("\ndepthloom.serve(camera)\n");
    let file = folder.join("stream.py");
    std::fs::write(&file, text).unwrap();
    program(python, &file, more)
}

fn next(stream: &mut dyn StreamingSource) -> Option<StreamFrame> {
    match stream.next(Instant::now() + LONG).unwrap_or_else(|fault| panic!("{}", fault.chain())) {
        NextFrame::Captured(frame) => Some(*frame),
        NextFrame::Ended => None,
        NextFrame::TimedOut => panic!("no frame within {LONG:?}"),
    }
}

fn bytes(image: &Image) -> &[u8] {
    match image.pixels() {
        Pixels::Grey(grey) => grey,
        Pixels::Rgb(rgb) => rgb,
    }
}

fn grey(frame: &StreamFrame) -> u8 {
    let (_, value) = frame.read.outputs.entries().next().expect("a value");
    let Value::Image(image) = value else { panic!("a {}", value.value_type()) };
    bytes(image)[0]
}

#[test]
fn a_stream_has_no_list_of_frames() {
    let params = json!({ "command": ["camera"], "outputs": { "left": "image" }, "version": 1 });
    assert!(stream(&params).unwrap().is_none(), "its frames are listed");
    let with = |more: Json| {
        let mut params = params.clone();
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    };
    let fault = super::call::open("process/source", &with(json!({ "stream": true }))).err().unwrap();
    let message = fault.chain();
    assert!(message.contains("the frames of a source with `stream: true` cannot be listed"), "{message}");
    assert!(fault.remedy_text().unwrap().contains("`depthloom live`"));
    for (parameter, value) in [("frames", json!("0..4")), ("reads", json!("{frame}.png"))] {
        let fault = stream(&with(json!({ "stream": true, parameter: value }))).err().unwrap();
        assert!(fault.chain().starts_with(parameter), "{}", fault.chain());
    }
}

#[test]
fn frames_have_numbers_times_and_keys_of_their_content() {
    let Some(python) = python("frames_have_numbers_times_and_keys_of_their_content") else { return };
    let folder = tempfile::tempdir().unwrap();
    let lines = r#"
yield image(1)
yield depthloom.StreamFrame(image(2), missed=3)
yield depthloom.StreamFrame(image(1), id="last", index=9, time_ns=5, captured_ns=time.monotonic_ns() - 2_000_000_000)
depthloom.warn("is warm")
"#;
    let mut stream = started(&python, folder.path(), lines, &json!({}));
    let before = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_nanos() as u64;
    let frames = [0; 3].map(|_| next(&mut *stream).expect("a frame"));
    assert!(next(&mut *stream).is_none() && next(&mut *stream).is_none(), "the end is final");
    assert_eq!(stream.take_warnings(), ["is warm"]);
    assert!(stream.take_warnings().is_empty());
    let facts = frames.each_ref().map(|frame| (&*frame.frame.id, frame.frame.index, frame.missed, grey(frame)));
    assert_eq!(facts, [("000000", 0, 0, 1), ("000004", 4, 3, 2), ("last", 9, 4, 1)]);
    let [first, second, last] = &frames;
    assert!(first.frame.time_ns.abs_diff(before) < LONG.as_nanos() as u64 && last.frame.time_ns == 5);
    assert!(last.captured.elapsed() >= Duration::from_secs(2) && first.captured < second.captured);
    assert!(first.read.key == last.read.key && first.read.key != second.read.key);
    let mut other = started(&python, folder.path(), lines, &json!({ "version": 2 }));
    assert_ne!(next(&mut *other).expect("a frame").read.key, first.read.key, "the program is part of the key");
}

#[test]
fn a_call_stays_outstanding_after_the_deadline() {
    let Some(python) = python("a_call_stays_outstanding_after_the_deadline") else { return };
    let folder = tempfile::tempdir().unwrap();
    let lines = "
yield image(1)
time.sleep(1)
yield image(2)
time.sleep(60)
";
    let mut stream = started(&python, folder.path(), lines, &json!({}));
    assert_eq!(grey(&next(&mut *stream).expect("a frame")), 1);
    let start = Instant::now();
    let found = stream.next(start + Duration::from_millis(100)).unwrap();
    assert!(matches!(found, NextFrame::TimedOut) && start.elapsed() < Duration::from_millis(900), "{found:?}");
    std::thread::sleep(Duration::from_millis(1500));
    let second = next(&mut *stream).expect("a frame");
    assert_eq!((grey(&second), second.frame.index), (2, 1));
    assert!(second.captured.elapsed() >= Duration::from_millis(200), "it was captured before it was collected");
    let found = stream.next(Instant::now()).unwrap();
    assert!(matches!(found, NextFrame::TimedOut));
    let start = Instant::now();
    drop(stream);
    assert!(start.elapsed() < Duration::from_secs(8), "a program that is busy is terminated");
}

#[test]
fn a_program_that_exits_or_hangs_is_started_again() {
    let Some(python) = python("a_program_that_exits_or_hangs_is_started_again") else { return };
    let folder = tempfile::tempdir().unwrap();
    let lines = r#"
runs = pathlib.Path(__file__).with_name("runs.txt")
run = len(runs.read_text()) if runs.exists() else 0
runs.write_text("x" * (run + 1))
for k in range(2):
    yield depthloom.StreamFrame(image(10 * run + k), index=k)
if run == 0:
    print("no signal", file=sys.stderr)
    os._exit(3)
if run == 1:
    raise OSError("the cable is loose")
if run == 2:
    time.sleep(60)
if run == 3:
    yield {"left": 7}
"#;
    // What a Python program opens late is in no key of a stream.
    let mut stream = started(&python, folder.path(), lines, &json!({ "timeout_s": 2 }));
    let frames: Vec<StreamFrame> = std::iter::from_fn(|| next(&mut *stream)).collect();
    let facts: Vec<_> = frames.iter().map(|frame| (frame.frame.index, grey(frame), frame.missed)).collect();
    let expected: Vec<_> = (0..10).map(|index| (index, (10 * (index / 2) + index % 2) as u8, 0)).collect();
    assert_eq!(facts, expected);
    let warnings = stream.take_warnings();
    let ends = [
        "ended with exit code 3 after 2 frames (no signal); started again",
        "failed: OSError: the cable is loose after 2 frames; started again",
        "sent no frame within 2 s after 2 frames; started again",
        "failed: ValueError: the value of output 'left' has the shape (), and the shape of a image is (height, width) or (height, width, 3) after 2 frames; started again",
    ];
    assert_eq!(warnings.len(), ends.len(), "{warnings:?}");
    for (warning, end) in warnings.iter().zip(ends) {
        assert!(warning.ends_with(end) && warning.contains("stream.py`"), "{warning}");
    }
}

#[test]
fn a_stream_gives_up_after_restarts_without_a_frame() {
    let Some(python) = python("a_stream_gives_up_after_restarts_without_a_frame") else { return };
    let folder = tempfile::tempdir().unwrap();
    let lines = r#"
runs = pathlib.Path(__file__).with_name("runs.txt")
is_first = not runs.exists()
runs.write_text("x")
if is_first:
    yield image(1)
print("no camera", file=sys.stderr)
sys.exit(4)
"#;
    let mut stream = started(&python, folder.path(), lines, &json!({ "restarts": 2 }));
    assert!(next(&mut *stream).is_some());
    let start = Instant::now();
    let fault = stream.next(Instant::now() + LONG).unwrap_err();
    assert!(start.elapsed() >= Duration::from_millis(300), "pauses of 0.1 s and 0.2 s");
    let message = fault.chain();
    let what = "ended with exit code 4 after 0 frames, and 2 restarts gave no frame; its standard error:\n  no camera";
    assert!(message.contains(what), "{message}");
    assert_eq!(stream.take_warnings().len(), 2);
    assert!(matches!(stream.next(Instant::now() + LONG), Ok(NextFrame::Ended)), "it has ended");

    // A first start that fails is not repeated.
    let params = written(&python, folder.path(), "yield 1", &json!({ "outputs": { "right": "image" } }));
    let message = stream_fault(&params);
    assert!(message.contains("failed when it was started: TypeError: the outputs of the node"), "{message}");
    let params = json!({ "command": ["no-such-camera"], "outputs": { "left": "image" }, "stream": true, "version": 1 });
    assert!(stream_fault(&params).contains("`no-such-camera` cannot be started"));
}

fn stream_fault(params: &Json) -> String {
    stream(params).err().expect("it does not start").chain()
}

#[test]
fn the_example_camera_streams_a_video_file() {
    let Some(python) = python("the_example_camera_streams_a_video_file") else { return };
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("pair.avi");
    let code = "import sys, cv2, numpy as np\n\
        video = cv2.VideoWriter(sys.argv[1], cv2.VideoWriter_fourcc(*'MJPG'), 50, (1280, 480))\n\
        assert video.isOpened()\n\
        for k in range(3):\n    \
            image = np.zeros((480, 1280, 3), np.uint8)\n    \
            image[:, :640], image[:, 640:] = (0, 0, 200), (200, 0, 40 * k)\n    \
            video.write(image)\n\
        video.release()\n";
    assert!(Command::new(&python).args(["-c", code]).arg(&video).status().unwrap().success());
    let camera = workspace().join("examples/camera.py");
    let outputs = json!({ "left": "image", "right": "image", "calibration": "calibration" });
    let params = program(&python, &camera, &json!({ "command": [python, camera, video], "outputs": outputs }));
    let mut stream = stream(&params).unwrap().unwrap();
    for k in 0..3_u8 {
        let frame = next(&mut *stream).expect("a frame");
        let image = |name: &str| {
            let (_, value) = frame.read.outputs.entries().find(|(port, _)| *port == name).unwrap();
            let Value::Image(image) = value else { panic!("a {}", value.value_type()) };
            assert_eq!(image.dimensions(), (640, 480));
            let bytes = bytes(image);
            [bytes[0], bytes[1], bytes[2]]
        };
        let is_near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 8);
        assert!(is_near(image("left"), [200, 0, 0]), "{:?}", image("left"));
        assert!(is_near(image("right"), [40 * k, 0, 200]), "{:?}", image("right"));
    }
    assert!(next(&mut *stream).is_none(), "{:?}", stream.take_warnings());

    let params = program(
        &python,
        &camera,
        &json!({ "command": [python, camera, folder.path().join("none.avi")], "outputs": outputs, "restarts": 0 }),
    );
    let mut stream = self::stream(&params).unwrap().unwrap();
    let message = stream.next(Instant::now() + LONG).unwrap_err().chain();
    assert!(message.contains("none.avi sends no image after 0 frames"), "{message}");
}
