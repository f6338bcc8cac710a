//! Encoded samples in the making: in memory up to a bound, beyond it in a temporary file.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

/// Bytes appended one after the other and taken out once, as one.
pub(super) struct Spool {
    bound: usize,
    written: usize,
    file: Option<File>,
    memory: Vec<u8>,
}

impl Spool {
    /// Nothing so far; more than `bound` bytes are moved into a file without a name, which ends with the process.
    pub(super) const fn new(bound: usize) -> Self {
        Self { bound, written: 0, file: None, memory: Vec::new() }
    }

    pub(super) fn append(&mut self, append: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        append(&mut self.memory);
        if self.memory.len() > self.bound {
            let file = match &mut self.file {
                Some(file) => file,
                None => self.file.insert(tempfile::tempfile()?),
            };
            file.write_all(&self.memory)?;
            self.written += self.memory.len();
            self.memory.clear();
        }
        Ok(())
    }

    pub(super) fn bytes(&mut self, head: &[u8]) -> io::Result<Arc<[u8]>> {
        // Allocated once at its size: the bytes of a large set would not fit into memory twice.
        let length = head.len() + self.written + self.memory.len();
        let mut all: Arc<[u8]> = std::iter::repeat_n(0, length).collect();
        let bytes = Arc::get_mut(&mut all).expect("it is not shared yet");
        let (start, rest) = bytes.split_at_mut(head.len());
        let (of_file, of_memory) = rest.split_at_mut(self.written);
        start.copy_from_slice(head);
        of_memory.copy_from_slice(&self.memory);
        if let Some(file) = &mut self.file {
            file.seek(SeekFrom::Start(0))?;
            file.read_exact(of_file)?;
            file.seek(SeekFrom::End(0))?;
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::Spool;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn appended_bytes_read_back_with_any_bound(
            pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..40), 0..12),
            bound in 0usize..120,
        ) {
            let mut spool = Spool::new(bound);
            let mut all = b"head".to_vec();
            for piece in &pieces {
                spool.append(|out| out.extend_from_slice(piece)).unwrap();
                all.extend_from_slice(piece);
                prop_assert!(spool.memory.len() <= bound);
                // Looking in between changes nothing.
                prop_assert_eq!(&*spool.bytes(b"head").unwrap(), &all[..]);
            }
        }
    }
}
