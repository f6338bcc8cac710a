//! The files of a bag: MCAP, or rosbag2's SQLite storage.

mod chunk_cache;
mod index;
pub(crate) mod mcap_file;
pub(crate) mod message;
mod scan;
pub(crate) mod sqlite_file;

pub(crate) use chunk_cache::ChunkCache;
