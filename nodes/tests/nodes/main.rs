//! Tests of nodes and sources through the registry, as the runner calls them.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

mod call;
mod declarations;
mod digests;
mod disparity;
mod fixtures;
mod golden;
mod kitti;
mod kitti_family;
mod kitti_raw;
mod network;
mod onnx_file;
mod road;
mod score;
mod score_disparity;
mod steps;
