use super::{ExitCode, PartialContent, RunFolder};
use std::fs;
use std::path::Path;

fn create(out: &Path, overwrite: bool) -> Result<RunFolder, ExitCode> {
    RunFolder::create(out, overwrite, &[], |_| PartialContent::Other).map_err(|stop| stop.exit)
}

/// A finished run with one file.
fn whole_run(out: &Path, content: &str) {
    let folder = create(out, true).unwrap();
    folder.write("scores.csv", content).unwrap();
    assert_eq!(folder.finish().unwrap(), out);
}

fn content(out: &Path) -> String {
    fs::read_to_string(out.join("scores.csv")).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn fault_06_a_folder_of_a_person_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["t", "t.partial"] {
        let thesis = folder.path().join(name);
        fs::create_dir(&thesis).unwrap();
        fs::write(thesis.join("thesis"), "years").unwrap();
        for overwrite in [false, true] {
            assert_eq!(create(&folder.path().join("t"), overwrite).err(), Some(ExitCode::Usage));
        }
        assert_eq!(fs::read_to_string(thesis.join("thesis")).unwrap(), "years");
        fs::remove_dir_all(&thesis).unwrap();
    }
}

#[test]
fn fault_06_what_appears_while_a_run_goes_on_stays() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for overwrite in [false, true] {
        let run = create(&out, overwrite).unwrap();
        run.write("scores.csv", "new").unwrap();
        fs::create_dir(&out).unwrap();
        fs::write(out.join("thesis"), "years").unwrap();
        let stop = run.finish().unwrap_err();
        assert_eq!(stop.exit, ExitCode::Engine);
        assert!(stop.message.remedy.unwrap().contains("out.partial"));
        assert_eq!(fs::read_to_string(out.join("thesis")).unwrap(), "years");
        assert_eq!(content(&folder.path().join("out.partial")), "new");
        fs::remove_dir_all(&out).unwrap();
        fs::remove_dir_all(folder.path().join("out.partial")).unwrap();
    }
}

#[test]
fn fault_41_a_run_that_goes_on_is_not_replaced_and_one_that_is_over_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let live = create(&out, false).unwrap();
    live.write("scores.csv", "first").unwrap();
    assert_eq!(create(&out, true).err(), Some(ExitCode::Usage), "its partial folder is being written");
    live.finish().unwrap();
    assert_eq!(create(&out, false).err(), Some(ExitCode::Usage), "without --overwrite it is refused");

    let next = create(&out, true).unwrap();
    assert_eq!(content(&out), "first", "until the new run is whole the old one stays");
    assert_eq!(create(&out, true).err(), Some(ExitCode::Usage), "the old run is to be replaced already");
    next.write("scores.csv", "second").unwrap();
    next.finish().unwrap();
    assert_eq!(content(&out), "second");
    assert_eq!(names(folder.path()), ["out"]);
}

#[test]
fn an_unfinished_run_that_nobody_writes_any_more_is_replaced_when_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    drop(create(&out, false).unwrap());
    assert_eq!(create(&out, false).err(), Some(ExitCode::Usage));
    whole_run(&out, "new");
    assert_eq!((content(&out).as_str(), names(folder.path())), ("new", vec!["out".to_owned()]));
}

#[test]
fn fault_41_a_run_that_holds_what_is_read_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    whole_run(&out, "experiment");
    let experiment = out.join("scores.csv");
    let stop = RunFolder::create(&out, true, &[experiment], |_| PartialContent::Other).err().unwrap();
    assert_eq!(stop.exit, ExitCode::Usage);
    assert_eq!(content(&out), "experiment");
}

#[test]
fn fault_41_the_folder_of_checkpoints_is_no_run() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(create(&folder.path().join("checkpoints"), true).err(), Some(ExitCode::Usage));
}

#[test]
fn fault_28_runs_of_one_second_have_folders_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let new = || RunFolder::create_new(folder.path(), "2026-11-21T08-30-05Z").unwrap();
    let (first, second) = (new(), new());
    assert_eq!(first.finish().unwrap().file_name().unwrap(), "2026-11-21T08-30-05Z");
    let third = new();
    assert_eq!(second.finish().unwrap().file_name().unwrap(), "2026-11-21T08-30-05Z-2");
    assert_eq!(third.finish().unwrap().file_name().unwrap(), "2026-11-21T08-30-05Z-3");
}

#[cfg(unix)]
#[test]
fn fault_50_a_dangling_link_is_found_before_any_frame() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::os::unix::fs::symlink(folder.path().join("nowhere"), &out).unwrap();
    for overwrite in [false, true] {
        assert_eq!(create(&out, overwrite).err(), Some(ExitCode::Usage));
    }
    assert_eq!(names(folder.path()), ["out"]);
}

#[cfg(unix)]
#[test]
fn a_link_to_a_run_is_not_replaced_by_whatever_way_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (run, link) = (folder.path().join("run"), folder.path().join("link"));
    whole_run(&run, "kept");
    std::os::unix::fs::symlink(&run, &link).unwrap();
    for way in ["link", "link/", "./link//", "link/."] {
        assert_eq!(create(&folder.path().join(way), true).err(), Some(ExitCode::Usage), "{way}");
    }
    assert_eq!((content(&run).as_str(), names(folder.path())), ("kept", vec!["link".to_owned(), "run".to_owned()]));
}

#[test]
fn a_run_that_holds_what_no_run_wrote_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    whole_run(&out, "kept");
    for name in ["thesis.txt", "runs", "models/notes.txt", "scores.csv.old"] {
        let path = out.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        if name == "runs" { fs::create_dir(&path) } else { fs::write(&path, "years") }.unwrap();
        let stop = RunFolder::create(&out, true, &[], |_| PartialContent::Other).err().unwrap();
        assert_eq!(stop.exit, ExitCode::Usage);
        assert!(stop.message.what.contains(name.split('/').next().unwrap()), "{}", stop.message.what);
        assert!(path.exists() && content(&out) == "kept");
        if name == "runs" { fs::remove_dir(&path) } else { fs::remove_file(&path) }.unwrap();
    }
    // What a killed report left is a run's own.
    fs::write(out.join("table.csv.partial"), "").unwrap();
    fs::write(out.join(".table.csv.0123abcd.partial"), "").unwrap();
    whole_run(&out, "new");
    assert_eq!(content(&out), "new");
}

#[test]
fn a_way_through_the_folder_itself_replaces_it_as_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    whole_run(&out, "before");
    let run = create(&out.join("../out"), true).unwrap();
    run.write("scores.csv", "after").unwrap();
    run.finish().unwrap();
    assert_eq!((content(&out).as_str(), names(folder.path())), ("after", vec!["out".to_owned()]));
    assert_eq!(create(&folder.path().join("none/../out"), true).err(), Some(ExitCode::Usage));
    assert_eq!(names(folder.path()), ["out"], "nothing was made on the way");
    let run = create(&out.join("../new/er/run"), false).unwrap();
    run.finish().unwrap();
    assert!(folder.path().join("new/er/run").is_dir(), "folders that are missing behind `..` are made");
}

#[test]
fn a_run_that_ended_as_it_began_is_in_nobodys_way() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for overwrite in [false, true] {
        fs::create_dir(folder.path().join("out.partial")).unwrap();
        drop(create(&out, overwrite).unwrap());
        // Marked before anything else is in it: at no moment a kill leaves what is not known again.
        assert_eq!(names(&folder.path().join("out.partial")), [crate::files::MARKER]);
        create(&out, true).unwrap().discard();
        assert_eq!(names(folder.path()), Vec::<String>::new());
    }
    // Under the final name it is foreign all the same.
    fs::create_dir(&out).unwrap();
    assert_eq!(create(&out, true).err(), Some(ExitCode::Usage));
    assert_eq!(names(folder.path()), ["out"]);
}

#[test]
fn a_name_too_long_for_what_comes_behind_it_is_found_before_any_frame() {
    let folder = tempfile::tempdir().unwrap();
    for length in [245, 250, 300] {
        let stop = RunFolder::create(&folder.path().join("x".repeat(length)), true, &[], |_| PartialContent::Other)
            .err()
            .unwrap();
        assert_eq!(stop.exit, ExitCode::Usage);
        assert!(stop.message.remedy.is_some_and(|remedy| remedy.contains("a shorter --out")), "{}", stop.message.what);
    }
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn a_name_for_what_is_not_whole_is_no_name_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(create(&folder.path().join("out.partial"), false).err(), Some(ExitCode::Usage));
}

#[test]
fn a_partial_recording_that_cannot_be_read_is_named_as_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    drop(create(&out, false).unwrap());
    let classify = |_: &Path| PartialContent::Unreadable("recording.mcap is not an MCAP file".to_owned());
    let stop = RunFolder::create(&out, false, &[], classify).err().expect("it is refused");
    assert!(stop.message.what.contains("out.partial: recording.mcap is not an MCAP file"), "{}", stop.message.what);
    assert!(RunFolder::create(&out, true, &[], classify).is_ok());
}
