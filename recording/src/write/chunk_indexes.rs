//! The chunk indexes of a recording that is being written, which its summary will hold: the one thing that a writer has
//! to remember of every chunk.

use std::borrow::Cow;
use std::io;

use depthloom_codecs::compression::{bound, compress, decompress};

/// Records are packed when there are so many bytes of them.
const BLOCK: usize = 1 << 16;

/// Records, in the bytes in which they will be written. They are some 90 bytes a chunk, and a frame may have a hundred
/// chunks: packed, they are a fifth of that.
#[derive(Default)]
pub(crate) struct ChunkIndexes {
    /// Packed with zstd, each with its length before.
    packed: Vec<(usize, Box<[u8]>)>,
    open: Vec<u8>,
    /// All records' length, bytes.
    length: u64,
}

impl ChunkIndexes {
    /// Appends the records that `put` appends.
    pub(crate) fn put(&mut self, put: impl FnOnce(&mut Vec<u8>)) {
        let before = self.open.len();
        put(&mut self.open);
        self.length += (self.open.len() - before) as u64;
        if self.open.len() >= BLOCK {
            // Where there is no memory to pack them in, they stay as they are.
            let mut packed = Vec::with_capacity(bound(self.open.len()));
            if compress(&self.open, &mut packed).is_ok() {
                self.packed.push((self.open.len(), packed.into_boxed_slice()));
                self.open.clear();
            }
        }
    }

    /// How many bytes all records have.
    pub(crate) const fn length(&self) -> u64 {
        self.length
    }

    /// All records in their order, a block at a time.
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
    fn records_come_out_as_they_went_in_and_take_less_room() {
        let (mut indexes, mut all) = (ChunkIndexes::default(), Vec::new());
        for chunk in 0..50_000_u64 {
            let record = [chunk * 1000, chunk % 7, 512, chunk * 1000 + 90].map(u64::to_le_bytes).concat();
            all.extend_from_slice(&record);
            indexes.put(|out| out.extend_from_slice(&record));
        }
        let written = indexes.blocks().map(|block| block.unwrap().into_owned()).collect::<Vec<_>>().concat();
        assert!(written == all && indexes.length() == all.len() as u64);
        let held: usize = indexes.packed.iter().map(|(_, packed)| packed.len()).sum();
        assert!(held * 3 < all.len(), "{held} of {}", all.len());
    }
}
