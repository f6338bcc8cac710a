//! ROS 2 bags and other people's MCAP files, read by `ros2/bag`.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};

use crate::Target;
use crate::sources::read_all;

/// A bag of one file or a folder, one file of which is the stranger's.
fn bag(name: &'static str, file: &'static str, with: fn() -> Json, seeds: Vec<Vec<u8>>) -> Target {
    Target::new(name, seeds, move |bytes, folder: &Path| {
        let path = folder.join(file);
        fs::write(&path, bytes).expect("the folder takes a file");
        let mut params = with();
        params["path"] = json!(path);
        read_all(&depthloom_nodes::registry(), "ros2/bag", &params)
    })
}

/// Containers, indexes and messages, with points and with depths as ground truth, and the other files of a bag.
pub(crate) fn targets() -> [Target; 4] {
    let points = || json!({ "points": "/points" });
    let depth = || json!({ "depth": "/depth" });
    let with_points = [
        &include_bytes!("../seeds/points.mcap")[..],
        include_bytes!("../seeds/unchunked.mcap"),
        include_bytes!("../seeds/lz4.mcap"),
    ];
    let database = include_bytes!("../seeds/bag.db3");
    [
        bag("bag_mcap", "bag.mcap", points, with_points.map(<[u8]>::to_vec).into()),
        bag("bag_depth", "bag.mcap", depth, vec![include_bytes!("../seeds/depth.mcap").to_vec()]),
        bag("bag_sqlite", "bag.db3", points, vec![database.to_vec()]),
        Target::new("bag_metadata", vec![include_bytes!("../seeds/metadata.yaml").to_vec()], move |bytes, folder| {
            fs::write(folder.join("metadata.yaml"), bytes).expect("the folder takes a file");
            fs::write(folder.join("bag.db3"), database).expect("the folder takes a file");
            read_all(&depthloom_nodes::registry(), "ros2/bag", &json!({ "path": folder }))
        }),
    ]
}
