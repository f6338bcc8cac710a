//! Attachments read back, checked.

use mcap::records::op;

use crate::error::RecordingError;
use crate::file::PositionedFile;
use crate::parse::{RECORD_HEADER, Records, attachment_head};

/// An attachment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachmentEntry {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub media_type: String,
    /// How many bytes it has.
    pub size: u64,
    pub(crate) offset: u64,
    pub(crate) length: u64,
}

impl AttachmentEntry {
    /// Reads the content, checked.
    pub(crate) fn read(&self, file: &PositionedFile) -> Result<Vec<u8>, RecordingError> {
        let mut record = Vec::new();
        file.read_range(&mut record, self.offset, self.length)?;
        let damaged = |what: &str| file.damaged(self.offset, what);
        let Some(Ok((_, op::ATTACHMENT, body))) = Records::new(&record).next() else {
            return Err(damaged("no attachment is there"));
        };
        let head = attachment_head(body).filter(|head| head.body_length == Some(body.len() as u64));
        let head = head.ok_or_else(|| damaged("the sizes of an attachment contradict each other"))?;
        let crc = body.len() - 4;
        if crc32fast::hash(&body[..crc]).to_le_bytes() != body[crc..] {
            return Err(damaged("an attachment's checksum differs"));
        }
        if (&head.name, &head.media_type, head.size) != (&self.name, &self.media_type, self.size) {
            return Err(damaged("an attachment is another than the summary says"));
        }
        let content = RECORD_HEADER as usize + head.length;
        record.truncate(RECORD_HEADER as usize + crc);
        record.drain(..content);
        Ok(record)
    }
}
