//! What there is to say of a bag beside its frames: its topics and their rates, what it lost, what it is recognised as.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::Path;

use mcap::WriteOptions;
use serde_json::{Value as Json, json};

use crate::bag_writer::{
    LEFT, LEFT_INFO, MS, RIGHT, RIGHT_INFO, Raw, SIZE, T0, Written, frame, frames, image, mcap, raw_image,
};
use crate::call::open;
use crate::ros2_bag::{Bench, opened, params, with_points};

/// What there is of a bag: what is wrong, then what is shown.
fn surveyed(path: &Path, more: &Json) -> (Vec<String>, Vec<String>) {
    let registry = depthloom_nodes::registry();
    let entry = registry.source_kind("ros2/bag").unwrap();
    let survey = entry.survey(&entry.resolve(&params(path, more)).unwrap());
    let facts = survey.facts.iter().map(|fact| format!("{} {}", fact.label, fact.text)).collect();
    (survey.faults.iter().map(depthloom_graphs::Fault::chain).collect(), facts)
}

#[test]
fn a_bag_shows_its_topics_and_how_evenly_they_come() {
    let bench = Bench::new();
    let mut messages: Vec<Written> = (0..8).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    // The right camera dropped two images.
    let is_dropped = |of: &Written| of.topic == RIGHT && [T0 + 300 * MS, T0 + 400 * MS].contains(&of.log_ns);
    messages.retain(|message| !is_dropped(message));
    let path = bench.mcap(&messages);
    let (faults, facts) = surveyed(&path, &json!({}));
    assert!(faults.is_empty(), "{faults:?}");
    insta::with_settings!({ omit_expression => true }, { insta::assert_snapshot!("facts_of_a_bag", facts.join("\n")); });
    // Topics are also shown for a bag that cannot be a source.
    messages.retain(|message| message.topic != RIGHT);
    let (faults, facts) = surveyed(&bench.mcap(&messages), &json!({}));
    assert_eq!((faults.len(), facts.len()), (1, 3));
}

#[test]
fn a_truncated_bag_is_reported_and_the_rest_is_read() {
    let bench = Bench::new();
    let messages: Vec<Written> = (0..20).flat_map(|number| frame(T0 + number * 100 * MS, number)).collect();
    let path = bench.path("bag.mcap");
    mcap(&path, &messages, WriteOptions::new().chunk_size(Some(6000)));
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert!(opened(&path, &json!({})).source.warnings()[0].contains("was cut off"));
    let (faults, _) = surveyed(&path, &json!({}));
    assert!(faults[0].contains("bag.mcap was cut off: its last whole record ends at byte"), "{faults:?}");
    assert!(surveyed(&path, &json!({ "frames": [0, 1] })).0.is_empty());
    // Nothing is lost where something was appended.
    fs::write(&path, [&whole[..], b"appended"].concat()).unwrap();
    assert!(surveyed(&path, &json!({})).0.is_empty());
    let end = whole.len();
    let warning = format!(
        "bag.mcap: its index cannot be read (its last 8 bytes, from byte {end}, are not the mark that every MCAP file ends with), so every record was \
         read; `mcap recover` repairs the file"
    );
    assert_eq!(opened(&path, &json!({})).source.warnings(), [warning]);
}

#[test]
fn a_bag_is_recognised_with_its_topics_and_the_ground_truth_of_its_left_image() {
    let bench = Bench::new();
    let recognised = |messages: &[Written]| {
        let path = bench.mcap(messages);
        let registry = depthloom_nodes::registry();
        let found = registry.source_kind("ros2/bag").unwrap().recognise(&path).remove(0);
        let source = open("ros2/bag", &found.params).map_err(|fault| fault.chain()).unwrap();
        source.read(FrameIndex(0)).map_err(|fault| fault.chain()).unwrap();
        (found.params, found.alternatives)
    };
    let depth = |topic: &str, size: (u32, u32), frame: &str| {
        let data = vec![1; (2 * size.0 * size.1) as usize];
        let raw = Raw { size, encoding: "16UC1", step: 2 * size.0, data: &data };
        Written::new(topic, "sensor_msgs/msg/Image", T0, raw_image(false, T0, frame, &raw))
    };
    let mut messages = with_points();
    messages.push(depth("/color/depth", SIZE, "camera_color"));
    messages.push(depth("/small/depth", (20, 15), "camera_left"));
    messages.push(image("/mono/image_raw", "camera_left", T0, 3));
    let (params, alternatives) = recognised(&messages);
    let named = ["left", "right", "left_info", "right_info", "points"].map(|name| params[name].as_str());
    assert_eq!(named, [LEFT, RIGHT, LEFT_INFO, RIGHT_INFO, "/lidar/points"].map(Some));
    let expected = [
        "depth: \"/color/depth\"   # in the frame `camera_color`, and the left image is in `camera_left`: is it registered to it?",
        "depth: \"/small/depth\"   # of 20x15, and the left image is 40x30: record the registered topic",
    ];
    assert_eq!(alternatives, expected);
    messages.push(depth("/stereo/depth", SIZE, "camera_left"));
    let (params, alternatives) = recognised(&messages);
    assert_eq!((params["depth"].as_str(), params.get("points")), (Some("/stereo/depth"), None));
    assert!(
        alternatives.contains(&"points: \"/lidar/points\"   # other ground truth, instead of the above".to_owned())
    );
}

#[test]
fn damaged_bags_are_recognised_and_own_recordings_are_not_bags() {
    let bench = Bench::new();
    let registry = depthloom_nodes::registry();
    let entry = registry.source_kind("ros2/bag").unwrap();
    let path = bench.mcap(&frames());
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..60]).unwrap();
    assert_eq!(entry.recognise(&path)[0].what, "bag.mcap, a bag that cannot be opened");
    let lost = bench.path("lost");
    fs::create_dir(&lost).unwrap();
    fs::write(lost.join("metadata.yaml"), "rosbag2_bagfile_information:\n  relative_file_paths: [lost_0.db3]\n")
        .unwrap();
    assert_eq!(entry.recognise(&lost).len(), 1);
    assert!(entry.recognise(bench.path("nowhere").as_path()).is_empty());
    // The header alone is left of what we wrote.
    let ours = bench.path("ours.mcap");
    mcap(&ours, &frames(), WriteOptions::new().library("depthloom"));
    assert!(entry.recognise(&ours).is_empty());
    assert!(surveyed(&ours, &json!({})).0[0].ends_with("is a recording of depthloom"));
}
