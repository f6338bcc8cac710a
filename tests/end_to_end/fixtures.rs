//! A whole run on rendered frames, against NumPy's scores and percentiles: what a bare clone holds us against
//! (`tests/fixtures/make.py`).

use crate::golden::{assert_percentiles_agree, assert_scores_agree};
use crate::support::{depthloom, succeed, workspace};

#[test]
fn scores_and_percentiles_of_rendered_frames_are_numpys() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, fixtures) = (folder.path().join("run"), workspace().join("tests/fixtures"));
    let mut run = depthloom();
    run.args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--quiet", "--out"]).arg(&out);
    run.args(["--set", "sources.test.with.frames=0..2"]);
    succeed(run.env("KITTI_STEREO_2015", fixtures.join("road")));
    assert_scores_agree(&out.join("scores.csv"), &fixtures.join("golden/scores.csv"), 1e-6);
    // A depth is a float: its own last bit is 6e-8 of the distance.
    let tolerance = |error_m: f64, distance_m: f64| 1e-6 * error_m.max(distance_m);
    assert_percentiles_agree(&out.join("error_vs_distance.csv"), &fixtures.join("golden/percentiles.csv"), tolerance);
}
