//! `synthetic/road`.

use depthloom_graphs::plan::FrameIndex;
use serde_json::{Value as Json, json};

use crate::call::open;

#[test]
fn a_frame_depends_on_seed_size_and_index_and_on_nothing_else() {
    let key = |params: Json, position| open("synthetic/road", &params).unwrap().read(position).unwrap().1;
    let small = |frames: Json, seed: u64| json!({ "frames": frames, "seed": seed, "width": 64, "height": 32 });
    assert_eq!(key(small(json!("0..4"), 1), FrameIndex(3)), key(small(json!([3]), 1), FrameIndex(0)));
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(small(json!([3]), 2), FrameIndex(0)));
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(small(json!([2]), 1), FrameIndex(0)));
    let occ = json!({ "frames": [3], "width": 64, "height": 32, "ground_truth": "occ" });
    assert_ne!(key(small(json!([3]), 1), FrameIndex(0)), key(occ, FrameIndex(0)));
}

#[test]
fn a_street_without_end_wants_to_know_which_frames() {
    for frames in [json!(null), json!("ids.txt"), json!("0..2000000"), json!([1_000_000])] {
        let fault = open("synthetic/road", &json!({ "frames": frames })).err().unwrap().to_string();
        let of_a_street = ["frames: a synthetic street has", "frames: the frames of a synthetic street have numbers"];
        assert!(of_a_street.iter().any(|start| fault.starts_with(start)), "{fault}");
    }
}
