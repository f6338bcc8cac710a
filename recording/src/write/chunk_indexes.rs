//! The chunk indexes of a recording that is being written, for its summary: the only data about every chunk that a
//! writer keeps in memory.

use std::borrow::Cow;
use std::io;

use depthloom_codecs::compression::{bound, compress, decompress};

/// Records are compressed once this many bytes are collected.
const BLOCK: usize = 1 << 16;

/// Records as they will be written. They are about 90 bytes per chunk, and a frame may have a hundred chunks:
/// compressed, they take a fifth of that.
#[derive(Default)]
pub(crate) struct ChunkIndexes {
    /// Compressed with zstd, each with its uncompressed length.
    packed: Vec<(usize, Box<[u8]>)>,
    open: Vec<u8>,
    /// The length of all records, bytes.
    length: u64,
}

impl ChunkIndexes {
    /// Appends the records that `put` appends.
    pub(crate) fn put(&mut self, put: impl FnOnce(&mut Vec<u8>)) {
        let before = self.open.len();
        put(&mut self.open);
        self.length += (self.open.len() - before) as u64;
        if self.open.len() >= BLOCK {
            // Without memory for compression, they stay uncompressed.
            let mut packed = Vec::with_capacity(bound(self.open.len()));
            if compress(&self.open, &mut packed).is_ok() {
                self.packed.push((self.open.len(), packed.into_boxed_slice()));
                self.open.clear();
            }
        }
    }

    /// The number of bytes of all records.
    pub(crate) const fn length(&self) -> u64 {
        self.length
    }

    /// All records in order, one block at a time.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = io::Result<Cow<'_, [u8]>>> {
        let packed = self.packed.iter().map(|(length, packed)| {
            let mut records = Vec::with_capacity(*length);
            decompress(packed, &mut records)?;
            Ok(records.into())
        });
        packed.chain(std::iter::once_with(|| Ok(self.open.as_slice().into())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_read_back_unchanged_and_take_less_memory() {
        let (mut indexes, mut all) = (ChunkIndexes::default(), Vec::new());
        for chunk in 0..50_000_u64 {
            let record = [chunk * 1000, chunk % 7, 512, chunk * 1000 + 90].map(u64::to_le_bytes).concat();
            all.extend_from_slice(&record);
            indexes.put(|out| out.extend_from_slice(&record));
        }
        let written = indexes.blocks().map(|block| block.unwrap().into_owned()).collect::<Vec<_>>().concat();
        assert!(written == all && indexes.length() == all.len() as u64);
        let compressed: usize = indexes.packed.iter().map(|(_, packed)| packed.len()).sum();
        assert!(compressed * 3 < all.len(), "{compressed} of {}", all.len());
    }
}
