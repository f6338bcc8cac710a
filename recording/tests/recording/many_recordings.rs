//! Values of hundreds of recordings are found in the newest one that has them undamaged, with few files open.

use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::{Store as _, StoredState};
use depthloom_graphs::plan::NodeId;
use depthloom_recording::EarlierRuns;
use mcap::Summary;

use crate::fixture::{frame, key, plan, record};

/// More than stay open at once.
const RECORDINGS: usize = 300;
const NODE: NodeId = NodeId(3);
const PORT: &str = "depth";

/// Recordings of two frames each: every frame but the first and the last is in two of them.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let path = |number: usize| folder.join(format!("{number:03}.mcap"));
    let plan = plan();
    std::thread::scope(|scope| {
        for thread in 0..8 {
            let plan = &plan;
            scope.spawn(move || {
                for number in (thread..RECORDINGS).step_by(8) {
                    record(&path(number), plan, number as u64..number as u64 + 2, 4, 2);
                }
            });
        }
    });
    (0..RECORDINGS).map(path).collect()
}

#[cfg(target_os = "linux")]
fn open_files(folder: &Path) -> usize {
    let all = std::fs::read_dir("/proc/self/fd").expect("a Linux").flatten();
    all.filter(|file| std::fs::read_link(file.path()).is_ok_and(|path| path.starts_with(folder))).count()
}

#[test]
fn hundreds_of_recordings_are_one_store_and_few_of_them_are_open() {
    let folder = tempfile::tempdir().unwrap();
    let paths = recordings(folder.path());
    // In recording 7, the first frame is damaged: frame 7 is found in recording 6, and the undamaged frame 8 in 7.
    let mut bytes = std::fs::read(&paths[7]).unwrap();
    let chunks = Summary::read(&bytes).unwrap().expect("a summary").chunk_indexes;
    let first = chunks.iter().min_by_key(|chunk| chunk.chunk_start_offset).expect("a chunk");
    bytes[(first.chunk_start_offset + first.chunk_length - 1) as usize] ^= 1;
    std::fs::write(&paths[7], bytes).unwrap();

    let newest_first: Vec<&PathBuf> = paths.iter().rev().collect();
    let store = EarlierRuns::new(&newest_first, &plan());
    assert_eq!(store.unreadable().len(), 0);
    for _ in 0..2 {
        for index in 0..=RECORDINGS {
            let key = key(&frame(index as u64), NODE);
            let expected = match index {
                7 => 6,
                RECORDINGS => RECORDINGS - 1,
                index => index,
            };
            assert_eq!(store.origin(&key, PORT), Some(paths[expected].display().to_string()), "frame {index}");
            let ports = store.find(&key).expect("the key is known");
            assert!(ports.iter().all(|port| port.port != PORT || port.state == StoredState::Stored));
        }
        #[cfg(target_os = "linux")]
        assert!(open_files(folder.path()) <= 256, "{} files are open", open_files(folder.path()));
    }
    let value = store.value(&key(&frame(0), NODE), PORT).unwrap();
    assert!(value.is_some());
    assert_eq!(store.damage().len(), 1, "{:?}", store.damage());
    assert_eq!(store.damage()[0].0, paths[7]);
}

#[test]
fn a_recording_whose_run_finishes_meanwhile_is_read_in_its_new_folder() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("first.partial");
    std::fs::create_dir(&run).unwrap();
    record(&run.join("recording.mcap"), &plan(), 1000..1001, 4, 2);
    let mut paths = vec![run.join("recording.mcap")];
    paths.extend(recordings(folder.path()));
    // The first file is closed: 300 others were opened after it.
    let store = EarlierRuns::new(&paths, &plan());
    for index in 0..=RECORDINGS {
        assert!(store.find(&key(&frame(index as u64), NODE)).is_some());
    }
    std::fs::rename(&run, folder.path().join("first")).unwrap();
    assert!(store.value(&key(&frame(1000), NODE), PORT).unwrap().is_some());
    assert_eq!(store.damage().len(), 0, "{:?}", store.damage());
}
