//! Diagnostics as documents: every file in `tests/broken/` has the snapshot of what it prints with the kinds of `toys`.

mod toys;

use std::path::{Path, PathBuf};

use depthloom_graphs::language::{self, Options, load};

/// The arguments that comments of the file give to an option.
fn arguments(text: &str, option: &str) -> Vec<String> {
    text.lines().filter_map(|line| Some(line.strip_prefix(option)?.to_owned())).collect()
}

/// Such arguments of the form `PATH=VALUE`.
fn pairs(text: &str, option: &str) -> Vec<(String, String)> {
    let arguments = arguments(text, option);
    arguments.iter().filter_map(|pair| pair.split_once('=')).map(|(path, value)| (path.into(), value.into())).collect()
}

fn printed(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("the file is there");
    let options = Options {
        set: pairs(&text, "# --set "),
        matrix: pairs(&text, "# --matrix "),
        only: arguments(&text, "# --variant "),
        text: None,
        open_texts: Vec::new(),
        env: Box::new(|name| (name == "KITTI").then(|| "/data/kitti".to_owned())),
    };
    match load(path, &toys::registry(), &options) {
        Ok(loaded) => panic!("{} is not broken: {}", path.display(), loaded.warnings),
        Err(diagnostics) => {
            assert!(diagnostics.has_errors());
            for diagnostic in &diagnostics {
                let language::Place { file, span } = &diagnostic.place;
                assert!(file.text.get(span.clone()).is_some(), "spans are within their file, on whole characters");
                let lower = |text: &str| !text.starts_with(char::is_uppercase);
                assert!(lower(&diagnostic.message) && lower(&diagnostic.label), "fragments: {}", diagnostic.message);
            }
            diagnostics.to_string()
        }
    }
}

#[test]
fn every_broken_file_has_the_expected_diagnostics() {
    // Relative, so that messages name files alike on every machine. It is the only test of this program, so no other
    // one sees the change.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).expect("the workspace is there");
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
    settings.set_snapshot_path("../../tests/broken/snapshots");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| {
        for path in &files {
            let name = path.file_stem().expect("it has a name").to_string_lossy().into_owned();
            insta::assert_snapshot!(name, printed(path));
        }
    });
}
