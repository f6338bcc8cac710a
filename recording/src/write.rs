//! Writes a recording: the parts of frames, the file, its end, and the continuation of an interrupted recording.

pub(crate) mod attachments;
pub(crate) mod background_sync;
pub(crate) mod buffer_pool;
pub(crate) mod chunk_indexes;
pub(crate) mod compression;
pub(crate) mod disk;
pub(crate) mod file_writer;
pub(crate) mod layout;
pub(crate) mod messages;
pub(crate) mod part;
pub(crate) mod part_encoder;
pub(crate) mod recorder;
pub(crate) mod resume;
pub(crate) mod ring;
pub(crate) mod viewer;
