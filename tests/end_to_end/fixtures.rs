//! A complete run on rendered frames, checked against metrics and percentiles from NumPy. The expected values are
//! committed (`tests/fixtures/make.py`), so this test also runs in a bare clone.

use crate::golden::{assert_percentiles_agree, assert_scores_agree};
use crate::support::{depthloom, succeed, workspace};

#[test]
fn metrics_and_percentiles_of_rendered_frames_match_numpy() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, fixtures) = (folder.path().join("run"), workspace().join("tests/fixtures"));
    let mut run = depthloom();
    run.args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--quiet", "--out"]).arg(&out);
    run.args(["--set", "sources.test.with.frames=0..2"]);
    succeed(run.env("KITTI_STEREO_2015", fixtures.join("road")));
    assert_scores_agree(&out.join("scores.csv"), &fixtures.join("golden/scores.csv"), 1e-6);
    // Depths are 32-bit floats: the last bit is 6e-8 of the distance.
    let tolerance = |error_m: f64, distance_m: f64| 1e-6 * error_m.max(distance_m);
    assert_percentiles_agree(&out.join("error_vs_distance.csv"), &fixtures.join("golden/percentiles.csv"), tolerance);
}
