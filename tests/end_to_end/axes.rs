//! Many variants from few lines, and some of them: `--matrix`, `--variant`.

use depthloom_recording::Recording;

use crate::support::{depthloom, succeed, workspace};

#[test]
fn variants_made_on_the_command_line_are_recorded_with_their_factors_and_run_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    let axes = ["--matrix", "look.stereo.with.block=[3, 5]", "--matrix", "look.stereo.with.mode=[sgbm, hh]"];
    let mut run = depthloom();
    run.args(["run", "experiments/first-look.yaml", "--quiet"]).args(small).args(axes).arg("--out").arg(&first);
    run.args(["--set", "sources.street.with.frames=0..2", "--variant", "block=3+*", "--variant", "*+mode=hh"]);
    succeed(&mut run);
    let recorded = Recording::open(first.join("recording.mcap")).expect("a recording");
    let plan = recorded.plan();
    assert_eq!(plan.variants, ["block=3+mode=sgbm", "block=3+mode=hh", "block=5+mode=hh"]);
    let factors = |variant| plan.factors_of(variant).iter().map(|factor| (factor.axis.as_str(), factor.value.as_str()));
    assert_eq!(factors(2).collect::<Vec<_>>(), [("block", "5"), ("mode", "hh")]);
    let stereo = |block: u64| {
        let mut nodes = plan.runs[0].nodes.iter().filter(|node| node.name == "stereo");
        nodes.find(|node| node.params["block"] == block).expect("it ran").params.clone()
    };
    assert_eq!((&stereo(3)["p1"], &stereo(3)["p2"]), (&72.into(), &288.into()), "penalties follow the block");
    assert_eq!((&stereo(5)["p1"], &stereo(5)["p2"]), (&200.into(), &800.into()));
    // What is kept is the same experiment.
    succeed(
        depthloom().arg("run").arg(first.join("experiment.resolved.yaml")).arg("--quiet").arg("--out").arg(&second),
    );
    let again = Recording::open(second.join("recording.mcap")).expect("a recording");
    assert_eq!(again.plan(), plan);
}

#[test]
fn the_example_of_the_documentation_is_one() {
    let text = std::fs::read_to_string(workspace().join("docs/axes.md")).expect("the page");
    let blocks: Vec<&str> =
        text.split("```yaml\n").skip(1).map(|rest| rest.split("```").next().expect("a block ends")).collect();
    // Three by three without penalties and with two of them, three left out, one added; drawn; four and two.
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
    score: { truth: source/depth, estimates: { stereo: depth/depth } }
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
