//! Reads attachments, and checks them.

use depthloom_mcap::records::AttachmentHeader;
use depthloom_mcap::{FileError, PositionedFile, RECORD_HEADER, body_of, op, read};

/// An attachment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachmentEntry {
    /// Its name.
    pub name: String,
    /// Its content type.
    pub media_type: String,
    /// How many bytes it has.
    pub size: u64,
    pub(crate) offset: u64,
    pub(crate) length: u64,
}

impl AttachmentEntry {
    /// Reads the content and checks it.
    pub(crate) fn read(&self, file: &PositionedFile) -> Result<Vec<u8>, FileError> {
        let mut record = Vec::new();
        file.read_range(&mut record, self.offset, self.length)?;
        let damaged = |what: &str| file.damaged(self.offset, what);
        let body = body_of(op::ATTACHMENT, &record).ok_or_else(|| damaged("no attachment starts there"))?;
        let (head, content) = attachment_head(body).ok_or_else(|| damaged("the attachment there is cut"))?;
        if head.size.checked_add(4) != Some(content.len() as u64) {
            return Err(damaged("the sizes of an attachment contradict each other"));
        }
        let (crc, start) = (body.len() - 4, body.len() - content.len());
        if crc32fast::hash(&body[..crc]).to_le_bytes() != body[crc..] {
            return Err(damaged("an attachment's checksum differs"));
        }
        if (&head.name, &head.media_type, head.size) != (&self.name, &self.media_type, self.size) {
            return Err(damaged("an attachment differs from its entry in the summary"));
        }
        record.truncate(RECORD_HEADER as usize + crc);
        record.drain(..RECORD_HEADER as usize + start);
        Ok(record)
    }
}

pub(crate) struct AttachmentHead {
    pub(crate) name: String,
    pub(crate) media_type: String,
    /// The number of bytes of the content; a checksum of four bytes follows it.
    pub(crate) size: u64,
}

/// The head of an attachment, and the bytes after it.
pub(crate) fn attachment_head(body: &[u8]) -> Option<(AttachmentHead, &[u8])> {
    let (AttachmentHeader { name, media_type, .. }, rest) = read(body)?;
    let (size, rest) = rest.split_first_chunk()?;
    Some((AttachmentHead { name, media_type, size: u64::from_le_bytes(*size) }, rest))
}
