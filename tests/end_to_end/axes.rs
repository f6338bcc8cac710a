//! Matrices of variants, and the selection of variants: `--matrix`, `--variant`.

use depthloom_graphs::plan::VariantId;
use depthloom_recording::Recording;

use crate::support::{Row, depthloom, number, read_csv, succeed, workspace};

#[test]
fn variants_from_the_command_line_are_recorded_and_reproducible() {
    let folder = tempfile::tempdir().expect("a folder");
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    let axes = ["--matrix", "look.stereo.with.block=[3, 5]", "--matrix", "look.stereo.with.mode=[sgbm, hh]"];
    let mut run = depthloom();
    run.args(["run", "--no-page", "experiments/first-look.yaml", "--quiet"])
        .args(small)
        .args(axes)
        .arg("--out")
        .arg(&first);
    run.args(["--set", "sources.street.with.frames=0..2", "--variant", "block=3+*", "--variant", "*+mode=hh"]);
    succeed(&mut run);
    let recorded = Recording::open(first.join("recording.mcap")).expect("a recording");
    let plan = recorded.plan();
    assert_eq!(plan.variants, ["block=3+mode=sgbm", "block=3+mode=hh", "block=5+mode=hh"]);
    let factors = |variant| plan.factors_of(variant).iter().map(|factor| (factor.axis.as_str(), factor.value.as_str()));
    assert_eq!(factors(VariantId(2)).collect::<Vec<_>>(), [("block", "5"), ("mode", "hh")]);
    let stereo = |block: u64| {
        let mut nodes = plan.runs[0].nodes.iter().filter(|node| node.name == "stereo");
        nodes.find(|node| node.params["block"] == block).expect("it ran").params.clone()
    };
    assert_eq!((&stereo(3)["p1"], &stereo(3)["p2"]), (&72.into(), &288.into()), "penalties follow the block");
    assert_eq!((&stereo(5)["p1"], &stereo(5)["p2"]), (&200.into(), &800.into()));
    // The resolved experiment in the run folder describes the same variants.
    succeed(
        depthloom()
            .args(["run", "--no-page"])
            .arg(first.join("experiment.resolved.yaml"))
            .arg("--quiet")
            .arg("--out")
            .arg(&second),
    );
    let again = Recording::open(second.join("recording.mcap")).expect("a recording");
    assert_eq!(again.plan(), plan);
}

#[test]
fn the_examples_in_axes_md_yield_the_stated_variants() {
    let text = std::fs::read_to_string(workspace().join("docs/axes.md")).expect("the page");
    let blocks: Vec<&str> =
        text.split("```yaml\n").skip(1).map(|rest| rest.split("```").next().expect("a block ends")).collect();
    // 3 x 3 without and 3 x 3 x 2 with penalties, minus 3 excluded, plus 1 included; 40 sampled; 4 and 2.
    let counts = [9 + 18 - 3 + 1, 40, 6];
    assert_eq!(blocks.len(), counts.len());
    let base = "experiment: axes
sources: { street: { kind: synthetic/road, with: { frames: 0..2 } } }
stages:
  compare:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      mirrored: { kind: stereo/sgbm, inputs: { left: source/right, right: source/left } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration }, with: { cap: 80 } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
";
    let folder = tempfile::tempdir().expect("a folder");
    for (block, count) in blocks.iter().zip(counts) {
        let path = folder.path().join("axes.yaml");
        std::fs::write(&path, format!("{base}{block}")).expect("written");
        let checked = succeed(depthloom().args(["check", "--json"]).arg(&path));
        let found: serde_json::Value = serde_json::from_slice(&checked.stdout).expect("JSON");
        assert_eq!(found["variants"], count, "{block}\n{found:#}");
    }
}

#[test]
fn effects_and_figures_adjust_means_where_combinations_are_left_out() {
    let experiment = "experiment: unbalanced
sources: { street: { kind: synthetic/road, with: { frames: 0..2, seed: 3, width: 160, height: 64 } } }
stages:
  compare:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 32 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }
matrix:
  compare.stereo.with.block: [3, 5, 7]
  compare.stereo.with.mode: [sgbm, hh]
  compare.stereo.with.uniqueness: [0, 15]
  penalty:
    values: { weak: { compare.stereo.with.p2: 800 }, strong: { compare.stereo.with.p2: 3000 } }
    when: { compare.stereo.with.mode: hh }
  exclude:
    - { compare.stereo.with.block: 3, compare.stereo.with.mode: hh }
    - { compare.stereo.with.block: 7, compare.stereo.with.uniqueness: 15 }
";
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    std::fs::write(folder.join("unbalanced.yaml"), experiment).expect("written");
    succeed(depthloom().current_dir(folder).args(["run", "--no-page", "unbalanced.yaml", "--quiet", "--out", "run"]));
    let table = |arguments: &[&str]| {
        let more = ["--format", "csv", "--out", "table.csv"];
        succeed(depthloom().current_dir(folder).args(["table", "run"]).args(arguments).args(more));
        read_csv(&folder.join("table.csv"))
    };
    let rows = table(&["--columns", "abs_rel"]);
    let effects = table(&["--effects", "abs_rel"]);
    let adjusted = |level: &str| {
        let row = effects.iter().find(|row| row["axis"] == "block" && row["level"] == level).expect("a level");
        number(row, "abs_rel")
    };
    // Plain means rank 7 first, because it never ran with the uniqueness check, which makes all others worse.
    let plain = |level: &str| {
        let own: Vec<f64> = rows.iter().filter(|row| row["block"] == level).map(|row| number(row, "abs_rel")).collect();
        own.iter().sum::<f64>() / own.len() as f64
    };
    assert!(plain("7") < plain("5") && plain("5") < plain("3"));
    assert!(adjusted("5") < adjusted("3") && adjusted("3") < adjusted("7"), "{effects:?}");
    let figure = |axis: &str| {
        let files = ["--out", "figure.svg", "--csv", "figure.csv", "--axes", axis];
        succeed(depthloom().current_dir(folder).args(["figure", "run", "parameter"]).args(files));
        read_csv(&folder.join("figure.csv"))
    };
    for row in figure("block") {
        assert!((number(&row, "abs_rel") - adjusted(&row["block"])).abs() < 1e-12, "{row:?}");
    }
    // Variants without the axis share one row, their mean.
    let with_penalty = figure("penalty");
    let without: Vec<&Row> = with_penalty.iter().filter(|row| row["penalty"].is_empty()).collect();
    assert_eq!((with_penalty.len(), without.len(), without[0]["rows"].as_str()), (3, 1, "5"));
}
