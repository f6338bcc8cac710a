//! What a release publishes: the wheel, the archive, the source distribution; and the files that build them elsewhere.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_test_needs::packaging;
use serde_json::Value as Json;

use crate::support::{succeed, system_python, workspace};

fn read(path: &str) -> String {
    fs::read_to_string(workspace().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn cargo_metadata(folder: &Path, arguments: &[&str]) -> Json {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--offline", "--format-version", "1"]).args(arguments).current_dir(folder);
    serde_json::from_slice(&succeed(&mut cargo).stdout).expect("JSON")
}

/// The package `depthloom`, as cargo knows it.
fn package() -> Json {
    let metadata = cargo_metadata(workspace(), &["--no-deps"]);
    let packages = metadata["packages"].as_array().expect("a list");
    packages.iter().find(|package| package["name"] == "depthloom").expect("our package").clone()
}

/// The lines of a TOML file from a line that begins so, to the line that closes its list.
fn toml_list<'a>(text: &'a str, start: &str) -> Vec<&'a str> {
    let lines = text.lines().skip_while(|line| !line.starts_with(start));
    let mut open = true;
    lines.take_while(|line| std::mem::replace(&mut open, !line.ends_with(']'))).collect()
}

fn toml_line<'a>(text: &'a str, key: &str) -> &'a str {
    let value = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
    value.unwrap_or_else(|| panic!("no line `{key} = `"))
}

#[test]
fn wheel_and_python_module_have_the_same_metadata() {
    let (wheel, module, package) = (read("pyproject.toml"), read("python/pyproject.toml"), package());
    for list in ["dependencies", "node"] {
        let start = format!("{list} = [");
        assert!(!toml_list(&wheel, &start).is_empty(), "{list}");
        assert_eq!(toml_list(&wheel, &start), toml_list(&module, &start), "{list}");
    }
    for key in ["name", "license", "requires-python", "classifiers"] {
        assert_eq!(toml_line(&wheel, key), toml_line(&module, key), "{key}");
    }
    // The wheel has the version of Cargo.toml.
    assert!(toml_line(&wheel, "dynamic").starts_with(r#"["version"]"#));
    assert_eq!(toml_line(&module, "version"), package["version"].to_string());
    assert_eq!(toml_line(&module, "license"), package["license"].to_string());
}

#[test]
fn the_conda_recipe_has_the_metadata_of_the_wheel() {
    let (recipe, package) = (yaml("packaging/conda/recipe.yaml"), package());
    assert_eq!(recipe["context"]["version"], package["version"]);
    assert_eq!(recipe["about"]["license"], package["license"]);
    assert_eq!(recipe["about"]["summary"], package["description"]);
    let wheel = read("pyproject.toml");
    let requires = toml_list(&wheel, "dependencies = [").into_iter().filter_map(|line| line.trim().strip_prefix('"'));
    let spaced = |requirement: &str| requirement.trim_end_matches("\",").replacen(">=", " >=", 1);
    let mut expected: BTreeSet<String> = requires.map(spaced).collect();
    expected.insert(format!("python {}", toml_line(&wheel, "requires-python").trim_matches('"')));
    let listed = recipe["requirements"]["run"].as_array().expect("a list").iter();
    assert_eq!(listed.map(|item| item.as_str().expect("text").to_owned()).collect::<BTreeSet<_>>(), expected);
}

fn yaml(path: &str) -> Json {
    serde_saphyr::from_str(&read(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The targets for which `release.yml` builds archives.
fn released_targets() -> BTreeSet<String> {
    let workflow = yaml(".github/workflows/release.yml");
    let jobs = workflow["jobs"].as_object().expect("jobs");
    let include = jobs.values().filter_map(|job| job["strategy"]["matrix"]["include"].as_array()).flatten();
    include.filter_map(|entry| entry["target"].as_str()).map(str::to_owned).collect()
}

#[test]
fn a_release_has_the_targets_whose_dependencies_are_checked() {
    let deny = read("deny.toml");
    let checked: BTreeSet<String> =
        toml_line(&deny, "targets").split('"').skip(1).step_by(2).map(str::to_owned).collect();
    assert_eq!(released_targets(), checked);
}

/// `cargo binstall` finds an archive of this name, and the program in it.
#[test]
fn the_template_of_binstall_is_the_name_of_the_archive() {
    let package = package();
    let version = package["version"].as_str().expect("text");
    let template = |key: &str| {
        let template = package["metadata"]["binstall"][key].as_str().expect("a template");
        let repository = package["repository"].as_str().expect("text");
        let words = [("repo", repository), ("name", "depthloom"), ("version", version), ("bin", "depthloom")];
        let expanded =
            words.iter().fold(template.to_owned(), |text, (key, value)| text.replace(&format!("{{ {key} }}"), value));
        expanded.replace("{ binary-ext }", "")
    };
    let script = read("packaging/archive.sh");
    assert!(script.contains("name=depthloom-$version-$target\n"), "the name of the folder");
    assert!(script.contains("\"$folder/$name.tar.gz\"\n"), "the name of the archive");
    assert!(script.contains("\"$work/$name/depthloom\"\n"), "the place of the program");
    for target in released_targets() {
        let name = format!("depthloom-{version}-{target}");
        let url = template("pkg-url").replace("{ target }", &target);
        assert_eq!(url, format!("https://github.com/depthloom/depthloom/releases/download/v{version}/{name}.tar.gz"));
        assert_eq!(template("bin-dir").replace("{ target }", &target), format!("{name}/depthloom"));
    }
}

#[test]
fn every_script_of_the_release_exists() {
    let workflow = read(".github/workflows/release.yml");
    let words = workflow.split_whitespace().filter(|word| word.starts_with("packaging/"));
    let scripts: BTreeSet<&str> = words.collect();
    assert!(scripts.len() > 2, "{scripts:?}");
    for script in scripts {
        assert!(workspace().join(script).is_file(), "{script}");
    }
}

/// All places that build with a certain Rust name that of Cargo.toml.
#[test]
fn all_builds_use_the_same_rust() {
    let package = package();
    let version = package["rust_version"].as_str().expect("text");
    let expected = version.trim_end_matches(".0");
    assert!(read("packaging/Dockerfile").contains(&format!("FROM rust:{expected}-")), "Dockerfile: {expected}");
    for workflow in ["fast", "full", "release"] {
        let text = read(&format!(".github/workflows/{workflow}.yml"));
        assert!(text.contains(&format!(" {expected}.0")), "{workflow}: {expected}.0");
    }
}

fn built() -> PathBuf {
    PathBuf::from(env!("CARGO_BIN_EXE_depthloom"))
}

/// The program of the archive, and command and module of the wheel, in an environment of their own. The release
/// workflow runs `packaging/smoke.sh`, too, before it publishes. maturin makes the wheel of the program under test.
#[cfg(target_os = "linux")]
#[test]
fn wheel_and_archive_run_an_experiment() {
    let Some(python) = packaging("wheel_and_archive_run_an_experiment") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("dist");
    let wheel = succeed(
        Command::new(&python)
            .arg(workspace().join("packaging/wheel.py"))
            .arg(built())
            .arg(&out)
            .current_dir(workspace()),
    );
    let wheel = String::from_utf8(wheel.stdout).expect("a path");
    // A wheel for one Python, or for no known Linux, would not be what a release publishes.
    assert!(wheel.contains("-py3-none-manylinux_2_"), "{wheel}");
    let stripped = folder.path().join("depthloom");
    succeed(Command::new("strip").arg("-o").args([&stripped, &built()]));
    let target = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let archive = workspace().join("packaging/archive.sh");
    let archive = succeed(Command::new("bash").arg(archive).arg(&stripped).arg(&target).arg(&out));
    let archive = PathBuf::from(String::from_utf8(archive.stdout).expect("a path").trim());
    succeed(Command::new("sha256sum").arg("--check").arg(archive.with_extension("gz.sha256")).current_dir(&out));
    let files = succeed(Command::new("tar").arg("-tzf").arg(&archive));
    let files = String::from_utf8(files.stdout).expect("names");
    for expected in
        ["LICENSE-MIT", "LICENSE-APACHE", "man/depthloom.1", "man/depthloom-run.1", "completions/depthloom.zsh"]
    {
        assert!(files.lines().any(|file| file.ends_with(expected)), "{expected} is not in\n{files}");
    }
    let smoke = workspace().join("packaging/smoke.sh");
    let output = succeed(Command::new("bash").arg(smoke).arg("python3").arg(&out).env_remove("DEPTHLOOM_FRESH"));
    let printed = String::from_utf8(output.stdout).expect("text");
    assert!(printed.ends_with("both run, and write the same recording\n"), "{printed}");
}

#[test]
fn the_licences_of_all_linked_crates_are_printed() {
    if !system_python("the_licences_of_all_linked_crates_are_printed") {
        return;
    }
    let script = workspace().join("packaging/licences.py");
    let text = String::from_utf8(succeed(Command::new("python3").arg(script)).stdout).expect("text");
    let mut tree = Command::new(env!("CARGO"));
    tree.args(["tree", "--offline", "--package", "depthloom", "--edges", "normal,no-proc-macro", "--prefix", "none"]);
    let tree = String::from_utf8(succeed(tree.current_dir(workspace())).stdout).expect("text");
    let of_others = tree.lines().filter(|line| !line.is_empty() && !line.contains(" (/"));
    for name in of_others.map(|line| line.split_once(" (").map_or(line, |(name, _)| name).replacen(" v", " ", 1)) {
        assert!(text.contains(&format!("- {name} (")), "{name}");
    }
    for name in ["DejaVu Sans", "uPlot"] {
        assert!(text.contains(&format!("- {name}")), "{name}");
    }
}

/// cargo resolves the unpacked sources without changing their lock file, and they are small.
#[cfg(target_os = "linux")]
#[test]
fn the_source_distribution_resolves_and_leaves_out_the_tests() {
    const TEST: &str = "the_source_distribution_resolves_and_leaves_out_the_tests";
    let Some(python) = packaging(TEST) else { return };
    if !workspace().join(".git").exists() {
        depthloom_test_needs::skipped(TEST, "there is no git repository: git lists the files of a source distribution");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let mut maturin = Command::new(&python);
    maturin.args(["-m", "maturin", "sdist", "--out"]).arg(folder.path()).current_dir(workspace());
    succeed(&mut maturin);
    let version = package()["version"].as_str().expect("text").to_owned();
    let archive = folder.path().join(format!("depthloom-{version}.tar.gz"));
    assert!(fs::metadata(&archive).expect("an archive").len() < 4_000_000, "{}", archive.display());
    succeed(Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(folder.path()));
    let unpacked = folder.path().join(format!("depthloom-{version}"));
    // The crates of other systems were perhaps never downloaded.
    let target = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    cargo_metadata(&unpacked, &["--locked", "--filter-platform", &target]);
    for absent in ["docs", "bench", "tests/end_to_end", "tests/fixtures", "nodes/tests", ".github"] {
        assert!(!unpacked.join(absent).exists(), "{absent}");
    }
    for present in ["experiments/street-network.onnx", "python/src/depthloom/py.typed", "LICENSE-MIT", "PKG-INFO"] {
        assert!(unpacked.join(present).is_file(), "{present}");
    }
}

/// The checks that others' tools offer: of workflows, the Dockerfile and the conda recipe.
#[test]
fn workflows_container_and_recipe_pass_their_linters() {
    let Some(python) = packaging("workflows_container_and_recipe_pass_their_linters") else { return };
    let programs = python.parent().expect("a folder");
    let mut workflows = Command::new(programs.join("check-jsonschema"));
    workflows.args(["--builtin-schema", "vendor.github-workflows"]).current_dir(workspace());
    succeed(workflows.args(["fast", "full", "release"].map(|name| format!(".github/workflows/{name}.yml"))));
    succeed(Command::new(programs.join("hadolint")).arg("packaging/Dockerfile").current_dir(workspace()));
    let render = "
from rattler_build import Stage0Recipe, VariantConfig
(rendered,) = Stage0Recipe.from_file('packaging/conda/recipe.yaml').render(VariantConfig())
print(rendered.recipe.to_dict()['package'])
";
    let rendered = succeed(Command::new(&python).args(["-c", render]).current_dir(workspace())).stdout;
    let version = package()["version"].as_str().expect("text").to_owned();
    let expected = format!("{{'name': 'depthloom', 'version': '{version}'}}\n");
    assert_eq!(String::from_utf8(rendered).expect("text"), expected);
}
