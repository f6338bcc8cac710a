//! Tests of nodes and sources through the registry, as the runner calls them.
#![expect(clippy::unwrap_used, reason = "a test that cannot continue panics")]

mod alignment;
mod bag_writer;
mod call;
mod declarations;
mod digests;
mod disparity;
mod fixtures;
mod folder;
mod fusion;
mod golden;
mod images;
mod kitti;
mod kitti_family;
mod kitti_raw;
mod learned_fusion;
mod mixture;
mod network;
mod predictions;
mod process_stream;
mod recognise;
mod road;
mod ros2_bag;
mod ros2_bag_broken;
mod ros2_bag_rosbags;
mod ros2_bag_survey;
mod score;
mod score_disparity;
mod steps;
mod stereo_network;
mod stereo_sets;
mod stereo_sets_broken;
