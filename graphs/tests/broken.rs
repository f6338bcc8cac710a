//! Diagnostics as documents: every file in `broken/` has the snapshot of what it prints.

mod toys;

use std::path::{Path, PathBuf};

use depthloom_graphs::language::{Options, load};

fn said(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("the file is there");
    let given = |option: &str| -> Vec<String> {
        text.lines().filter_map(|line| Some(line.strip_prefix(option)?.to_owned())).collect()
    };
    let pairs = |option: &str| -> Vec<(String, String)> {
        let pair =
            |argument: &String| argument.split_once('=').map(|(path, value)| (path.to_owned(), value.to_owned()));
        given(option).iter().filter_map(pair).collect()
    };
    let options = Options {
        set: pairs("# --set "),
        matrix: pairs("# --matrix "),
        only: given("# --variant "),
        text: None,
        env: Box::new(|name| (name == "KITTI").then(|| "/data/kitti".to_owned())),
    };
    match load(path, &toys::registry(), &options) {
        Ok(loaded) => panic!("{} is not broken: {}", path.display(), loaded.warnings),
        Err(diagnostics) => {
            assert!(diagnostics.has_errors());
            for diagnostic in &diagnostics {
                let text = &diagnostic.file.text;
                assert!(text.get(diagnostic.span.clone()).is_some(), "spans lie in their file, on whole characters");
                let lower = |text: &str| !text.starts_with(char::is_uppercase);
                assert!(lower(&diagnostic.message) && lower(&diagnostic.label), "fragments: {}", diagnostic.message);
            }
            diagnostics.to_string()
        }
    }
}

#[test]
fn every_broken_file_says_what_is_wrong_and_where() {
    // Relative, so that messages name files alike on every machine: tests run in the folder of their crate.
    let folder = Path::new("tests/broken");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("the folder is there")
        .map(|entry| entry.expect("it can be listed").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "yaml"))
        .collect();
    files.sort();
    assert!(files.len() >= 40, "the folder holds the cases");
    let snapshots = std::fs::read_dir(folder.join("snapshots")).expect("the snapshots are there").count();
    assert!(snapshots <= files.len(), "a snapshot without its file: {snapshots} for {} files", files.len());
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path("broken/snapshots");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| {
        for path in &files {
            let name = path.file_stem().expect("it has a name").to_string_lossy().into_owned();
            insta::assert_snapshot!(name, said(path));
        }
    });
}
