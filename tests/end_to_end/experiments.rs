//! The shipped experiments, the generated files, and the commands around them.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::support::{Row, depthloom, label, number, read_csv, set, succeed, workspace};

fn stdout(output: &std::process::Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

#[test]
fn every_shipped_experiment_is_valid() {
    let model = tempfile::NamedTempFile::new().expect("a file");
    // The outputs of the source `mcap` are declared by a recording.
    let folder = tempfile::tempdir().expect("a folder");
    let first = folder.path().join("first");
    let small = ["--set", "sources.street.with={ frames: 0..1, width: 320, height: 96 }", "--quiet", "--out"];
    succeed(depthloom().args(["run", "experiments/first-look.yaml"]).args(small).arg(&first));
    for folder in ["experiments", "tests/experiments"] {
        for entry in std::fs::read_dir(workspace().join(folder)).expect("the folder") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|e| e == "yaml") {
                // `check` opens no data: neither the data set nor ONNX Runtime needs to exist.
                let mut check = depthloom();
                check.env("KITTI_STEREO_2015", "/nowhere").env("MONO_MODEL", model.path()).env("FROM_RUN", &first);
                check.env("VGG16_WEIGHTS", model.path());
                succeed(check.env("ORT_DYLIB_PATH", "/nowhere/libonnxruntime.so").arg("check").arg(&path));
            }
        }
    }
}

#[test]
fn the_committed_schema_is_up_to_date() {
    let printed = stdout(&succeed(depthloom().arg("schema")));
    let committed =
        std::fs::read_to_string(workspace().join("experiments/experiment.schema.json")).expect("the schema");
    assert!(printed == committed, "stale: cargo run --release -- schema > experiments/experiment.schema.json");
}

#[test]
fn every_workspace_crate_is_tested_with_overflow_checks() {
    let read =
        |path: &str| std::fs::read_to_string(workspace().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    let (workspace, checked) = (read("Cargo.toml"), read(".ci/checked.toml"));
    let members = workspace.lines().find_map(|line| line.strip_prefix("members = ")).expect("members on one line");
    let members: Vec<String> = serde_json::from_str(members).expect("a list in JSON syntax");
    let supporting = std::fs::read_dir(crate::support::workspace().join("crates")).expect("a folder");
    let supporting = supporting.map(|entry| format!("crates/{}", entry.expect("read").file_name().display()));
    let members: Vec<String> = members.into_iter().filter(|member| member != "crates/*").chain(supporting).collect();
    for member in &members {
        let manifest = read(&format!("{member}/Cargo.toml"));
        let name = manifest.lines().find_map(|line| line.strip_prefix("name = ")).expect("a name").trim_matches('"');
        let (package, settings) = (format!("{name} = {{"), "overflow-checks = true, debug-assertions = true }");
        let checked = checked.lines().any(|line| line.starts_with(&package) && line.ends_with(settings));
        assert!(checked, ".ci/checked.toml lacks: {package} {settings}");
    }
    assert!(members.len() > 10);
}

#[test]
fn stereo_runs_once_per_frame_for_all_variants() {
    let plan = stdout(&succeed(depthloom().args(["plan", "experiments/table1.yaml", "--json"])));
    let plan: Value = serde_json::from_str(&plan).expect("JSON");
    let nodes = plan["runs"][1]["nodes"].as_array().expect("nodes");
    let stereo: Vec<_> = nodes.iter().filter(|node| node["name"] == "stereo").collect();
    assert_eq!(stereo.len(), 1, "stereo is shared by all variants");
    assert_eq!(stereo[0]["variants"].as_array().map(Vec::len), Some(4));
}

#[test]
fn a_run_writes_every_file_and_prints_its_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("look");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    let output = succeed(depthloom().args(["run", "experiments/first-look.yaml", "--out"]).arg(&out).args(small));
    let printed = stdout(&output);
    assert_eq!(printed.lines().last(), Some(format!("run: {}", out.display()).as_str()));
    for file in [
        "recording.mcap",
        "scores.csv",
        "scores.parquet",
        "table.csv",
        "table.md",
        "table.tex",
        "table.parquet",
        "error_vs_distance.csv",
        "error_vs_distance.parquet",
        "error_vs_distance.svg",
        "experiment.yaml",
        "experiment.resolved.yaml",
        "environment.json",
        "timings.parquet",
    ] {
        assert!(out.join(file).is_file(), "{file} is missing");
    }
    assert!(!folder.path().join("look.partial").exists());
    // An existing run is not replaced.
    let again = depthloom().args(["run", "experiments/first-look.yaml", "--out"]).arg(&out).output().expect("started");
    assert_eq!(again.status.code(), Some(2));
    // `report` recreates the table from the recording.
    let table = std::fs::read(out.join("table.csv")).expect("a table");
    std::fs::remove_file(out.join("table.csv")).expect("removed");
    succeed(depthloom().arg("report").arg(&out));
    assert_eq!(std::fs::read(out.join("table.csv")).expect("a table"), table);
    let timings = stdout(&succeed(depthloom().args(["runs", "timings"]).arg(&out)));
    assert!(timings.contains("stereo"), "{timings}");
}

#[test]
fn every_command_has_help_and_every_kind_a_reference() {
    let list = stdout(&succeed(depthloom().arg("nodes")));
    let kinds: Vec<&str> = list.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert!(kinds.contains(&"stereo/sgbm") && kinds.contains(&"synthetic/road"), "{list}");
    for kind in kinds {
        let reference = stdout(&succeed(depthloom().args(["nodes", kind])));
        assert!(reference.contains(kind), "{reference}");
    }
    for command in ["run", "check", "plan", "graph", "report", "runs", "nodes", "synth", "doctor", "schema"] {
        succeed(depthloom().args([command, "--help"]));
    }
    for format in ["mermaid", "dot"] {
        let drawing = stdout(&succeed(depthloom().args(["graph", "experiments/table1.yaml", "--format", format])));
        assert!(drawing.contains("stereo"), "{drawing}");
    }
    assert!(stdout(&succeed(depthloom().arg("man"))).contains("depthloom"));
    assert!(stdout(&succeed(depthloom().args(["completions", "bash"]))).contains("depthloom"));
    assert!(stdout(&succeed(depthloom().arg("doctor"))).contains("cores"));
}

#[test]
fn threads_follow_the_cores_of_a_task_of_slurm() {
    let all = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let doctor = |cores: Option<&str>| -> (Option<u64>, String) {
        let mut command = depthloom();
        command.env_remove("SLURM_CPUS_PER_TASK").args(["doctor", "--json"]);
        command.envs(cores.map(|cores| ("SLURM_CPUS_PER_TASK", cores)));
        let printed: Value = serde_json::from_slice(&succeed(&mut command).stdout).expect("JSON");
        (printed["cores"].as_u64(), printed["cores_from"].as_str().expect("text").to_owned())
    };
    for not_limiting in [None, Some("100000"), Some("0"), Some("many")] {
        assert_eq!(doctor(not_limiting), (Some(all), "system".to_owned()), "{not_limiting:?}");
    }
    let from = if all > 1 { "SLURM_CPUS_PER_TASK" } else { "system" };
    assert_eq!(doctor(Some("1")), (Some(1), from.to_owned()));

    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    let mut command = depthloom();
    command.args([
        "run",
        "experiments/first-look.yaml",
        "--set",
        "sources.street.with.frames=0..1",
        "--no-page",
        "--out",
    ]);
    succeed(command.arg(&run).env("SLURM_CPUS_PER_TASK", "1"));
    let environment = std::fs::read(run.join("environment.json")).expect("written");
    let environment: Value = serde_json::from_slice(&environment).expect("JSON");
    assert_eq!((&environment["cores"], &environment["workers"]), (&1.into(), &1.into()));
}

#[test]
fn a_generated_street_is_readable_as_kitti() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("street");
    let size = ["--width", "320", "--height", "96", "--frames", "2", "--seed", "7"];
    succeed(depthloom().arg("synth").arg(&data).args(size));
    let experiment = folder.path().join("kitti.yaml");
    let look = workspace().join("experiments/first-look.yaml");
    let text = format!(
        "extends: {}\nsources:\n  street: {{ kind: kitti/stereo2015, with: {{ root: street, ground_truth: occ }} }}\n",
        look.display()
    );
    std::fs::write(&experiment, text).expect("written");
    let run = folder.path().join("run");
    succeed(depthloom().arg("run").arg(&experiment).arg("--out").arg(&run));
    // The paper's numbers are for KITTI, so they are quoted only there, not for estimates of the same names on other
    // data.
    let other = folder.path().join("other");
    let few = ["--set", "sources.street.with={ frames: 0..2, width: 320, height: 96 }", "--quiet", "--no-page"];
    succeed(depthloom().args(["run", "experiments/first-look.yaml"]).args(few).arg("--out").arg(&other));
    let explained = |run: &Path| stdout(&succeed(depthloom().arg("explain").arg(run).args(["abs_rel", "stereo"])));
    assert!(explained(&run).contains("in Table I of Martins et al. 2018"), "{}", explained(&run));
    assert!(!explained(&other).contains("Table I"), "{}", explained(&other));
}

#[test]
fn new_writes_a_valid_experiment_and_replaces_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let new = |name: &str| depthloom().current_dir(folder.path()).args(["new", name]).output().unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let refused = |name: &str| {
        let output = new(name);
        assert_eq!(output.status.code(), Some(2), "{name}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(new("mine.yaml").status.success());
    let (experiment, network) = (read("mine.yaml"), read("street-network.onnx"));
    let few = ["--set", "sources.street.with.frames=0..1"];
    succeed(depthloom().current_dir(folder.path()).args(["run", "mine.yaml"]).args(few));
    assert!(refused("mine.yaml").contains("mine.yaml exists already"));
    // A second experiment shares the network.
    assert!(new("second.yaml").status.success());
    assert_eq!((read("mine.yaml"), read("second.yaml")), (experiment.clone(), experiment));
    assert_eq!(read("street-network.onnx"), network);
    // A file of that name that is not the network stays, and no experiment is written.
    std::fs::write(folder.path().join("street-network.onnx"), "mine").unwrap();
    assert!(refused("third.yaml").contains("street-network.onnx exists already"));
    assert!(!folder.path().join("third.yaml").exists());
    assert_eq!(read("street-network.onnx"), b"mine");
    assert!(refused("street-network.onnx").contains("street-network.onnx is the network's file"));
    assert!(refused("-").contains("`-` is not a file name"));
    assert!(!folder.path().join("-").exists());
}

#[test]
fn in_the_first_experiment_fusion_is_better_than_stereo() {
    let folder = tempfile::tempdir().unwrap();
    succeed(depthloom().current_dir(folder.path()).args(["new", "first.yaml"]));
    let run = ["run", "first.yaml", "--no-page", "--quiet", "--out", "run"];
    succeed(depthloom().current_dir(folder.path()).args(run));
    let rows = read_csv(&folder.path().join("run/table.csv"));
    let value = |estimate: &str, metric: &str| {
        let is_wanted = |row: &&Row| label(row) == format!("base/{estimate}") && set(row) == "all";
        number(rows.iter().find(is_wanted).expect("a row"), metric)
    };
    for (metric, more_is_better) in [("abs_rel", false), ("rmse", false), ("a1", true)] {
        for other in ["stereo", "mono"] {
            let (fused, other) = (value("fused", metric), value(other, metric));
            assert!(if more_is_better { fused > other } else { fused < other }, "{metric}: {fused}, {other}");
        }
    }
    // The network was trained on other streets than it is evaluated on.
    let seeds = |file: &str, source: &str| -> BTreeSet<String> {
        let plan: Value = serde_json::from_slice(
            &succeed(depthloom().current_dir(folder.path()).args(["plan", "--json", file])).stdout,
        )
        .unwrap();
        let of_source = |run: &&Value| run["source"]["name"] == source;
        let runs = plan["runs"].as_array().unwrap().iter().filter(of_source);
        runs.flat_map(|run| run["source"]["parts"].as_array().unwrap())
            .map(|part| part["with"]["seed"].to_string())
            .collect()
    };
    let training = workspace().join("experiments/street-network.yaml");
    let trained_on = seeds(&training.to_string_lossy(), "train");
    assert_eq!(trained_on.len(), 5);
    assert!(trained_on.is_disjoint(&seeds("first.yaml", "street")));
}
