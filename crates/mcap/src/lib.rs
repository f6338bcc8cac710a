//! MCAP as a container: files read by position, records, chunks and summaries. <https://mcap.dev/spec>
//!
//! The crate `mcap` has the types of records, and how each is read and written. This one reads them from files that may
//! be damaged, unfinished or hostile: every length is compared with the bytes that are there before anything is
//! allocated, and every error names the file and the byte.
#![forbid(unsafe_code)]
#![expect(clippy::missing_errors_doc, reason = "`FileError` lists what can go wrong")]

mod chunk;
mod error;
mod file;
mod open_files;
mod record;
mod summary;
mod window;

pub use chunk::{Chunk, chunk_index, no_message};
pub use error::{COPY_AGAIN, FileError};
pub use file::{PositionedFile, name_of};
pub use mcap::MAGIC;
pub use mcap::records::{self, op};
pub use open_files::OpenFiles;
pub use record::{
    MESSAGE_HEADER, Message, RECORD_HEADER, RecordLayout, Records, body_of, counted, message, put, put_fields,
    put_record, read, read_all, record_header,
};
pub use summary::{FOOTER, FileEnd, begins_as_mcap, each_summary_record, file_end};
pub use window::{RecordPlace, Window};

/// How many bytes [`MAGIC`] has: where the first record starts.
pub const MAGIC_LENGTH: u64 = MAGIC.len() as u64;
