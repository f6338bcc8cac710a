//! Files that cannot be read, and files from a stranger.

mod toys;

use std::path::Path;

use depthloom_graphs::language::{Options, load};

/// The error about a file, without the path of its folder.
fn message(folder: &Path, name: &str) -> String {
    let diagnostics = load(&folder.join(name), &toys::registry(), &Options::default()).expect_err("it is broken");
    assert_eq!(diagnostics.iter().count(), 1, "{diagnostics}");
    diagnostics.to_string().replace(folder.to_str().expect("the path is text"), "")
}

#[test]
fn files_that_cannot_be_read_are_named_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert!(message(path, "nowhere.yaml").contains("failed to read `/nowhere.yaml`: there is no such file"));
    assert!(message(path, ".").contains("it is a folder"));
    std::fs::create_dir(path.join("run")).unwrap();
    std::fs::write(path.join("run/experiment.yaml"), "").unwrap();
    assert!(message(path, "run").contains("the experiment of that run is `/run/experiment.yaml`"));
    std::fs::write(path.join("latin1.yaml"), b"experiment: caf\xe9\n").unwrap();
    assert!(message(path, "latin1.yaml").contains("it is not UTF-8 text (at byte 15)"));
    let huge = std::fs::File::create(path.join("huge.yaml")).unwrap();
    huge.set_len(1 << 40).unwrap();
    assert!(message(path, "huge.yaml").contains("it is larger than 4 MiB, which no experiment needs"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_without_an_end_is_not_read() {
    let error = load(Path::new("/dev/zero"), &toys::registry(), &Options::default()).unwrap_err();
    assert!(error.to_string().contains("it is not a regular file"), "{error}");
}

#[test]
fn a_file_with_too_many_values_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = format!("experiment: large\ndescription: [{}]\n", "1,".repeat(200_000));
    std::fs::write(folder.path().join("large.yaml"), text).unwrap();
    assert!(message(folder.path(), "large.yaml").contains("the file has more than 100000 values"));
}

#[test]
fn a_long_chain_of_files_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for i in 0..40 {
        let text = format!("experiment: e\nextends: {}.yaml\n", i + 1);
        std::fs::write(folder.path().join(format!("{i}.yaml")), text).unwrap();
    }
    assert!(message(folder.path(), "0.yaml").contains("reads more than 64 files, or more than 16 in one chain"));
}

#[test]
fn an_experiment_of_many_nodes_and_variants_is_planned() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from(
        "experiment: long\nsources: { test: { kind: synthetic/road } }\nstages:\n  compare:\n    source: test\n    nodes:\n      n0: { kind: filter/median, inputs: { depth: source/depth } }\n",
    );
    for i in 1..300 {
        text.push_str(&format!("      n{i}: {{ kind: filter/median, inputs: {{ depth: n{}/depth }} }}\n", i - 1));
    }
    text.push_str("variants:\n  full: {}\n");
    for i in 1..100 {
        text.push_str(&format!("  v{i}: {{ compare.n{i}.with.size: 3 }}\n"));
    }
    std::fs::write(folder.path().join("long.yaml"), text).unwrap();
    let loaded = load(&folder.path().join("long.yaml"), &toys::registry(), &Options::default());
    let plan = loaded.unwrap_or_else(|diagnostics| panic!("{diagnostics}")).plan;
    // Variant i shares its first i nodes with the full one, and has the other 300 - i to itself.
    assert_eq!(plan.runs[0].nodes.len(), 300 + (1..100).map(|i| 300 - i).sum::<usize>());
}
