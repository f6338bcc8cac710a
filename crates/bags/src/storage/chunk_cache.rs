//! Decompressed chunks, kept while there is room: the images of a frame lie close together, and several workers read at
//! once.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use depthloom_threads::locked;

/// The most bytes that are kept of a bag, however many files it has; a chunk that is larger is kept alone.
const MOST_BYTES: u64 = 256 << 20;

/// A chunk, once one thread has decompressed it. Other threads that need it wait.
type Slot = Arc<Mutex<Option<Arc<Vec<u8>>>>>;

/// A chunk of a bag: its file, and its place there.
pub(super) type ChunkId = (usize, usize);

/// The chunks used last, each with its size.
#[derive(Default)]
pub(crate) struct ChunkCache(Mutex<VecDeque<(ChunkId, u64, Slot)>>);

impl ChunkCache {
    /// The records of a chunk of that size, by `read` where they are not kept.
    pub(crate) fn get<E>(
        &self,
        chunk: ChunkId,
        size: u64,
        read: impl FnOnce() -> Result<Vec<u8>, E>,
    ) -> Result<Arc<Vec<u8>>, E> {
        let slot = self.slot(chunk, size);
        let mut cache = locked(&slot);
        if let Some(records) = &*cache {
            return Ok(Arc::clone(records));
        }
        let records = Arc::new(read()?);
        *cache = Some(Arc::clone(&records));
        Ok(records)
    }

    fn slot(&self, chunk: ChunkId, size: u64) -> Slot {
        let mut cache = locked(&self.0);
        let known = cache.iter().position(|(other, _, _)| *other == chunk).and_then(|at| cache.remove(at));
        let (_, _, slot) = known.unwrap_or_default();
        let mut bytes: u64 = size + cache.iter().map(|(_, size, _)| size).sum::<u64>();
        while bytes > MOST_BYTES {
            let Some((_, size, _)) = cache.pop_front() else { break };
            bytes -= size;
        }
        cache.push_back((chunk, size, Arc::clone(&slot)));
        slot
    }
}

#[cfg(test)]
mod tests {
    use super::{ChunkCache, MOST_BYTES};

    #[test]
    fn the_latest_chunks_are_cached_within_the_limit_and_failures_are_not() {
        let cache = ChunkCache::default();
        let mut reads = Vec::new();
        let third = MOST_BYTES / 3;
        for chunk in [0, 1, 0, 2, 3, 0, 1] {
            let read = || {
                reads.push(chunk);
                Ok::<_, ()>(vec![chunk as u8])
            };
            cache.get((0, chunk), third, read).unwrap();
        }
        // 1 was used longest ago when 3 came.
        assert_eq!(reads, [0, 1, 2, 3, 1]);
        assert!(cache.get((0, 9), 1, || Err(())).is_err());
        assert_eq!(*cache.get((0, 9), 1, || Ok::<_, ()>(vec![7])).unwrap(), [7]);
        assert_eq!(*cache.get((0, 10), 2 * MOST_BYTES, || Ok::<_, ()>(vec![8])).unwrap(), [8]);
    }
}
