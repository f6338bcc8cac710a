//! The files of a bag: MCAP, or rosbag2's SQLite storage.

mod chunk_cache;
mod index;
pub mod mcap_file;
pub mod message;
mod scan;
pub mod sqlite_file;

pub use chunk_cache::ChunkCache;
