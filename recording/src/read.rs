//! Reads a recording: the places of its records, its committed frames, its damage.

pub(crate) mod attachment;
pub(crate) mod chunk_messages;
pub(crate) mod curve;
pub(crate) mod damage;
pub(crate) mod damaged_content;
pub(crate) mod frame_reader;
pub(crate) mod index;
pub(crate) mod recording;
pub(crate) mod recovery_scan;
pub(crate) mod topic_sizes;
pub(crate) mod value_digests;
