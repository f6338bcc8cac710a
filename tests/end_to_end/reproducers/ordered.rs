//! Ordered nodes get id, index and time of their frames, so the keys of their values contain these as well.

use super::Case;

/// A node that writes the seconds since the previous frame to every pixel, as a temporal filter might use them.
const CLOCK: &str = r#"
import numpy as np, depthloom
@depthloom.node(inputs={"image": "image"}, outputs={"depth": "depth"})
class Clock:
    def __init__(self):
        self.before = None
    def process(self, image, frame):
        elapsed = 1.0 if self.before is None else (frame.time_ns - self.before) / 1e9
        self.before = frame.time_ns
        return np.full(image.shape[:2], elapsed, np.float32)
depthloom.serve(Clock)
"#;

/// An experiment with the clock node, followed by a filter.
fn clock(source: &str) -> String {
    format!(
        "experiment: clock
sources: {{ s: {source} }}
stages:
  look:
    source: s
    nodes:
      clock:
        kind: process
        inputs: {{ image: source/left }}
        with:
          command: [python3, clock.py]
          ports: {{ inputs: {{ image: image }}, outputs: {{ depth: depth }} }}
          contract: ordered
          code: [clock.py]
      after: {{ kind: filter/median, inputs: {{ depth: clock/depth }} }}
"
    )
}

#[test]
fn changed_frame_times_recompute_ordered_nodes_and_their_consumers() {
    let Some(case) = Case::with_python("changed_frame_times_recompute_ordered_nodes_and_their_consumers") else {
        return;
    };
    let date = "raw/2011_09_26";
    let drive = format!("{date}/2011_09_26_drive_0001_sync");
    for frame in 0..3 {
        for (camera, shift) in [("image_02", 0), ("image_03", 4)] {
            case.write_image(&format!("{drive}/{camera}/data/{frame:010}.png"), frame, shift);
        }
    }
    let camera = "S_rect_02: 6.4e+01 3.2e+01\nR_rect_00: 1 0 0 0 1 0 0 0 1\n\
                  P_rect_02: 20 0 32 0 0 20 16 0 0 0 1 0\nP_rect_03: 20 0 32 -10 0 20 16 0 0 0 1 0\n";
    case.write(&format!("{date}/calib_cam_to_cam.txt"), camera);
    let times = |seconds: [&str; 3]| seconds.map(|second| format!("2011-09-26 13:02:{second}\n")).concat();
    let file = format!("{drive}/image_02/timestamps.txt");
    case.write("clock.py", CLOCK);
    case.write("clock.yaml", clock("{ kind: kitti/raw, with: { root: raw, ground_truth: none } }"));
    case.write(&file, times(["44.0", "44.1", "44.2"]));
    case.run("clock.yaml", "runs/one", &[]);
    case.write(&file, times(["44.0", "44.3", "45.7"]));
    case.run_as_fresh("clock.yaml", "runs/two", &[]);
}

#[test]
fn a_recording_of_other_frames_as_a_source_has_its_own_times() {
    let Some(case) = Case::with_python("a_recording_of_other_frames_as_a_source_has_its_own_times") else { return };
    case.write("clock.py", CLOCK);
    let road = |frames: &str| {
        clock(&format!("{{ kind: synthetic/road, with: {{ frames: {frames}, width: 64, height: 32 }} }}"))
    };
    case.write("first.yaml", road("[3, 7, 8]"));
    case.write("second.yaml", clock("{ kind: mcap, with: { path: runs/first/recording.mcap } }"));
    case.write("third.yaml", clock("{ kind: mcap, with: { path: runs/first/recording.mcap, frames: [3, 8] } }"));
    case.run("first.yaml", "runs/first", &[]);
    case.run_as_fresh("second.yaml", "runs/second", &[]);
    case.run_as_fresh("third.yaml", "runs/third", &[]);
}

#[test]
fn samples_name_the_frames_of_their_own_run() {
    let case = Case::new();
    case.write(
        "samples.yaml",
        "experiment: samples
sources: { own: { kind: images, with: { root: data, left: left/*.png, right: right/*.png } } }
stages:
  learn:
    source: own
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 16 } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask }, with: { size: [32, 32] } }
",
    );
    let file = |side: &str, name: &str| format!("data/{side}/{name}.png");
    for (side, shift) in [("left", 0), ("right", 4)] {
        case.write_image(&file(side, "a"), 1, shift);
        case.write_image(&file(side, "b"), 2, shift);
    }
    case.run("samples.yaml", "runs/one", &[]);
    for side in ["left", "right"] {
        std::fs::rename(case.path(&file(side, "a")), case.path(&file(side, "aa"))).expect("renamed");
    }
    case.run_as_fresh("samples.yaml", "runs/two", &[]);
}

/// A network contains the cache key of its training; a network recomputed by the audit must contain it as well.
#[test]
fn a_trained_network_that_is_reused_passes_the_audit_of_all_values() {
    let case = Case::new();
    let learning = "experiment: learning
sources: { street: { kind: synthetic/road, with: { frames: 0..2, width: 64, height: 32 } } }
stages:
  learn:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 16 } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask }, with: { size: [64, 32] } }
      train: { kind: learn/ssl, inputs: { samples: samples/samples }, with: { steps: 2, batch: 2 } }
";
    case.write("learning.yaml", learning);
    case.run("learning.yaml", "runs/one", &[]);
    case.run("learning.yaml", "runs/two", &["--audit", "all"]);
    case.assert_as_fresh("learning.yaml", "runs/two", &[]);
}
