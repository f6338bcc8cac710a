//! Checksums over what MCAP itself leaves unchecked.
//!
//! Every metadata record contains a checksum of itself. Metadata and commit records also contain the CRC-32 of all
//! bytes before them: an unfinished file can be checked, byte for byte, up to the last such record.

use std::collections::BTreeMap;
use std::ops::Range;

use crc32fast::Hasher;
use depthloom_graphs::Key;

use depthloom_mcap::{FileError, PositionedFile};

/// The entry of a metadata record with the checksum over its name and its other entries.
const CHECKSUM: &str = "checksum";
/// The entry of a metadata record with the CRC-32 of all bytes before it.
const CRC32_BEFORE: &str = "crc32_before";

/// Adds the checksums to the entries of a metadata record; `crc_before` is the CRC-32 of all bytes before the record.
pub(crate) fn seal(name: &str, mut values: BTreeMap<String, String>, crc_before: u32) -> BTreeMap<String, String> {
    values.insert(CRC32_BEFORE.to_owned(), crc_before.to_string());
    let sum = sum(name, &values);
    values.insert(CHECKSUM.to_owned(), sum.to_string());
    values
}

/// The CRC-32 of all bytes before a metadata record; `None` if the record was changed after it was written.
pub(crate) fn unseal(name: &str, values: &BTreeMap<String, String>) -> Option<u32> {
    let whole = *values.get(CHECKSUM)? == sum(name, values).to_string();
    whole.then(|| values.get(CRC32_BEFORE)?.parse().ok()).flatten()
}

fn sum(name: &str, values: &BTreeMap<String, String>) -> Key {
    let entries = values.iter().filter(|(key, _)| *key != CHECKSUM);
    let builder = Key::digest("depthloom metadata").text(name);
    entries.fold(builder, |builder, (key, value)| builder.text(key).text(value)).finish()
}

/// The CRC-32 of a range of a file, to be combined with that of the bytes before it.
pub(crate) fn crc_of(file: &PositionedFile, range: Range<u64>) -> Result<Hasher, FileError> {
    let mut section = CrcBefore::starting_at(file, range.start);
    section.up_to(range.end)?;
    Ok(section.crc)
}

/// The CRC-32 of a file's bytes before an offset; offsets only increase.
pub(crate) struct CrcBefore<'a> {
    file: &'a PositionedFile,
    crc: Hasher,
    at: u64,
    block: Vec<u8>,
}

impl<'a> CrcBefore<'a> {
    pub(crate) fn new(file: &'a PositionedFile) -> Self {
        Self::starting_at(file, 0)
    }

    fn starting_at(file: &'a PositionedFile, at: u64) -> Self {
        Self { file, crc: Hasher::new(), at, block: Vec::new() }
    }

    /// Sets the CRC-32 of all bytes before an offset, where it is known.
    pub(crate) fn set_known(&mut self, offset: u64, crc: u32) {
        (self.at, self.crc) = (offset, Hasher::new_with_initial(crc));
    }

    /// The CRC-32 of all bytes before an offset, which must not be less than that of the previous call.
    pub(crate) fn up_to(&mut self, offset: u64) -> Result<u32, FileError> {
        const BLOCK: u64 = 1 << 18;
        while self.at < offset {
            let length = BLOCK.min(offset - self.at);
            self.file.read_range(&mut self.block, self.at, length)?;
            self.crc.update(&self.block);
            self.at += length;
        }
        Ok(self.crc.clone().finalize())
    }

    /// The CRC-32 of the bytes from the previous offset to `end`.
    pub(crate) fn section(&mut self, end: u64) -> Result<u32, FileError> {
        let before = std::mem::replace(&mut self.crc, Hasher::new());
        let crc = self.up_to(end);
        let section = std::mem::replace(&mut self.crc, before);
        self.crc.combine(&section);
        crc
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{seal, unseal};

    #[test]
    fn every_change_of_a_sealed_record_is_detected() {
        let values = BTreeMap::from([("plan".to_owned(), "{}".to_owned()), ("format".to_owned(), "2".to_owned())]);
        let sealed = seal("depthloom", values, 77);
        assert_eq!(unseal("depthloom", &sealed), Some(77));
        assert_eq!(unseal("depthloom.once", &sealed), None);
        for key in sealed.keys() {
            let mut changed = sealed.clone();
            changed.get_mut(key).unwrap().push('1');
            assert_eq!(unseal("depthloom", &changed), None, "{key}");
            changed.remove(key);
            assert_eq!(unseal("depthloom", &changed), None, "{key}");
        }
    }
}
