//! What a crash leaves is readable to the last commit; what is damaged or not ours is said to be so.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use depthloom_graphs::contracts::Tap;
use depthloom_recording::{Recorder, Recording, RecordingError};
use proptest::prelude::{ProptestConfig, Strategy, any, proptest};
use proptest::{prop_assert, prop_assert_eq};

use crate::fixture::{CURVE, curve, frame, plan, record, record_frame, record_once_values, values};

const FRAMES: u64 = 6;
const TOPICS: [&str; 3] = ["/compare/fused/depth", "/compare/stereo/disparity", "/compare/score_fused/scores"];

/// A finished file, where each of its frames ends, and where its once-values do.
fn recorded() -> &'static (Vec<u8>, Vec<u64>, u64) {
    static RECORDED: OnceLock<(Vec<u8>, Vec<u64>, u64)> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("recording.mcap");
        let recorder = Recorder::create(&path, &plan()).expect("a recorder");
        let mut ends = Vec::new();
        for index in 0..FRAMES {
            record_frame(&recorder, 0, &frame(index), &values(&frame(index), 20, 12), false);
            ends.push(std::fs::metadata(&path).expect("the file").len());
        }
        record_once_values(&recorder, 0);
        let once_end = std::fs::metadata(&path).expect("the file").len();
        recorder.finish(&[]).expect("a finished file");
        (std::fs::read(&path).expect("the file"), ends, once_end)
    })
}

fn written(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("recording.mcap");
    std::fs::write(&path, bytes).unwrap_or_else(|error| panic!("{error}"));
    path
}

/// Opens and reads everything.
fn read_all(path: &Path) -> Result<usize, RecordingError> {
    let recording = Recording::open(path)?;
    let mut reader = recording.reader(0, &TOPICS)?;
    for position in 0..recording.frames(0).len() {
        reader.read(position)?;
    }
    for once in recording.once_values() {
        recording.once_value(once)?;
    }
    Ok(recording.frames(0).len())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_file_cut_anywhere_is_readable_up_to_its_last_commit(cut in (0..=recorded().0.len()).prop_map(|cut| cut as u64)) {
        let (bytes, ends, once_end) = recorded();
        let folder = tempfile::tempdir()?;
        let path = written(folder.path(), &bytes[..cut as usize]);
        let committed = ends.iter().filter(|end| **end <= cut).count();
        match Recording::open(&path) {
            Ok(recording) => {
                prop_assert_eq!(recording.frames(0).len(), committed);
                prop_assert_eq!(recording.whole(), cut == bytes.len() as u64);
                if let Some(last) = committed.checked_sub(1) {
                    prop_assert_eq!(recording.committed_bytes(), ends[last]);
                }
                let curves = recording.once_values().iter().filter(|once| once.value_type == "curve").count();
                prop_assert_eq!(curves == 1, cut >= *once_end);
                prop_assert!(recording.once_values().iter().all(|once| recording.once_value(once).is_ok()));
                let read = read_all(&path);
                prop_assert!(committed == 0 || read.is_ok_and(|frames| frames == committed));
            }
            // Cut within what comes before the frames: there is no plan yet.
            Err(RecordingError::NotMcap { .. }) => prop_assert!(cut < 8),
            Err(RecordingError::NotARecording { .. }) => prop_assert_eq!(committed, 0),
            Err(error) => prop_assert!(false, "{}", error),
        }
    }

    #[test]
    fn a_flipped_bit_is_an_error_or_harmless_but_no_panic(
        place in 0..recorded().0.len(),
        bit in 0..8_u32,
        cut in any::<bool>(),
    ) {
        let (bytes, ends, _) = recorded();
        let mut bytes = bytes.clone();
        bytes[place] ^= 1 << bit;
        if cut {
            bytes.truncate(ends[FRAMES as usize - 1] as usize);
        }
        let folder = tempfile::tempdir()?;
        let path = written(folder.path(), &bytes);
        if let Ok(frames) = read_all(&path) {
            prop_assert!(frames <= FRAMES as usize);
        }
    }
}

#[test]
fn a_flipped_pixel_is_found() {
    let (bytes, ..) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), bytes);
    let recording = Recording::open(&path).unwrap();
    let fused = recording.reader(0, &TOPICS[..1]).unwrap().read(0).unwrap();
    let Some(depthloom_graphs::Value::Depth(depth)) = &fused[0] else { panic!("no depth") };
    // The row of a noisy map lies in the file as it is.
    let row: Vec<u8> = depth.metres.iter().skip(20).take(20).flat_map(|metres| metres.to_le_bytes()).collect();
    let place = bytes.windows(row.len()).position(|window| window == row).unwrap();
    let mut flipped = bytes.clone();
    flipped[place] ^= 1;
    let path = written(folder.path(), &flipped);
    let Err(error) = read_all(&path) else { panic!("the flip was not found") };
    assert!(matches!(error, RecordingError::Damaged { .. }), "{error}");
    assert!(error.to_string().contains("recording.mcap is damaged at byte"), "{error}");
    assert!(error.to_string().ends_with("a chunk's checksum differs"), "{error}");
    // Only who wants the damaged topics reads their chunk.
    let recording = Recording::open(&path).unwrap();
    let stereo = recording.reader(0, &["/compare/stereo/disparity", "/compare/source/left"]).unwrap().read(0).unwrap();
    assert!(stereo.iter().all(Option::is_some));
}

#[test]
fn points_of_a_curve_that_was_not_finished_belong_to_nothing() {
    let (bytes, ends, once_end) = recorded();
    let folder = tempfile::tempdir().unwrap();
    let digest_of = |end: u64| {
        let path = written(folder.path(), &bytes[..end as usize]);
        depthloom_recording::digest(&path).unwrap()["topics"].as_object().unwrap().clone()
    };
    let whole = digest_of(*once_end);
    assert_eq!(whole[CURVE]["count"], curve().points.len());
    // The last byte cut is one of the record that would commit the curve: its messages are all there.
    let cut = digest_of(once_end - 1);
    assert!(!cut.contains_key(CURVE));
    assert_eq!(cut.len() + 1, whole.len());
    assert_eq!(digest_of(ends[FRAMES as usize - 1]), cut);
}

#[test]
fn a_curve_that_lost_points_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    record(&path, &plan(), 0..1, 16, 16);
    let mut bytes = std::fs::read(&path).unwrap();
    // The number of messages in the record that commits the curve, as text with its length.
    let told = b"\x08\0\0\0messages\x01\0\0\x004";
    let place = bytes.windows(told.len()).position(|window| window == told).unwrap();
    bytes[place + told.len() - 1] = b'5';
    let recording = Recording::open(written(folder.path(), &bytes)).unwrap();
    let error = recording.once_value(&recording.once_values()[1]).unwrap_err();
    assert!(error.to_string().ends_with("the learning curve /compare/teacher/curve has 4 of its 5 points"), "{error}");
    let model = recording.once_value(&recording.once_values()[0]).unwrap();
    assert!(matches!(model, depthloom_graphs::Value::Model(_)), "the model is whole");
}

#[test]
fn other_files_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let text = written(folder.path(), b"experiment: table1\n");
    assert!(matches!(Recording::open(&text), Err(RecordingError::NotMcap { .. })));
    let path = folder.path().join("other.mcap");
    mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap().finish().unwrap();
    let error = Recording::open(&path).unwrap_err();
    assert!(matches!(error, RecordingError::NotARecording { .. }));
    assert_eq!(error.remedy().unwrap(), "give a recording that `depthloom run` made");
    assert!(matches!(Recording::open(folder.path().join("absent")), Err(RecordingError::Open { .. })));
}

#[test]
fn nothing_is_written_after_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let recorder = Recorder::create(&path, &plan()).unwrap();
    recorder.finish(&[]).unwrap();
    let size = std::fs::metadata(&path).unwrap().len();
    let commit =
        depthloom_graphs::contracts::Commit { run: 0, frame: &frame(0), source_key: None, keys: &[], failures: &[] };
    let error = recorder.write(&commit, Vec::new()).unwrap_err();
    assert!(error.to_string().ends_with("takes no more values: it is finished"), "{error}");
    assert!(recorder.finish(&[]).is_err());
    assert_eq!(std::fs::metadata(&path).unwrap().len(), size);
    assert_eq!(Recording::open(&path).unwrap().frames(0).len(), 0);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_said_to_be_full() {
    let Err(error) = Recorder::create("/dev/full", &plan()) else { panic!("/dev/full took bytes") };
    assert!(matches!(&error, RecordingError::Write { offset: 0, .. }), "{error}");
    assert!(error.remedy().unwrap().starts_with("free some space"), "{error}");
}

#[test]
fn equal_topics_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    let mut plan = plan();
    plan.runs[0].nodes[3].outputs[0].topic = "/compare/depth/depth".to_owned();
    let Err(error) = Recorder::create(&path, &plan) else { panic!("two outputs share a topic") };
    assert_eq!(error.to_string(), "topic /compare/depth/depth: two outputs have this topic");
    assert!(!path.exists());
    plan.runs[0].nodes[3].outputs[0].recorded = false;
    record(&path, &plan, 0..1, 16, 16);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.plan().runs[0].estimates[0].estimate_topic, None);
}
