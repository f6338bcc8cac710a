//! Buffers of one frame, written at several places at once.

use std::marker::PhantomData;
use std::ops::Range;

use crate::memory::{self, TooMuch};

/// A cache line; keeps vectors of costs from straddling two.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Line([i16; 32]);

/// Growing memory for costs, aligned to cache lines.
#[derive(Debug, Default)]
pub(super) struct Costs(Vec<Line>);

impl Costs {
    /// Makes room for `len` values where that may be refused.
    ///
    /// # Errors
    /// If it is too much for one call, or for the machine.
    pub(super) fn make_room(&mut self, len: usize) -> Result<(), TooMuch> {
        let lines = len.div_ceil(32);
        if self.0.len() < lines {
            self.0 = Vec::new();
            memory::reserve(&mut self.0, lines)?;
            self.0.resize(lines, Line([0; 32]));
        }
        Ok(())
    }

    /// At least `len` values, of whatever content.
    pub(super) fn at_least(&mut self, len: usize) -> Shared<'_, i16> {
        let lines = len.div_ceil(32);
        if self.0.len() < lines {
            // What is there need not be kept: no copy to the new place.
            self.0 = Vec::new();
            self.0.resize(lines, Line([0; 32]));
        }
        Shared { start: self.0.as_mut_ptr().cast(), len: self.0.len() * 32, lent: PhantomData }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Shared<'a, T> {
    start: *mut T,
    len: usize,
    lent: PhantomData<&'a mut [T]>,
}

// SAFETY: only `unsafe` functions reach the content, and their callers vouch for disjointness.
unsafe impl<T: Send> Send for Shared<'_, T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Shared<'_, T> {}

impl<'a, T> From<&'a mut [T]> for Shared<'a, T> {
    fn from(slice: &'a mut [T]) -> Self {
        Self { start: slice.as_mut_ptr(), len: slice.len(), lent: PhantomData }
    }
}

impl<'a, T> Shared<'a, T> {
    /// Where element `index` lies; `index` may be the length.
    pub(super) fn at(&self, index: usize) -> *mut T {
        assert!(index <= self.len, "index {index} in a buffer of {}", self.len);
        // SAFETY: within the allocation, or one past its end.
        unsafe { self.start.add(index) }
    }

    /// A part, to write.
    ///
    /// # Safety
    /// While it lives, no other code may read or write any of it.
    pub(super) unsafe fn write(&self, range: Range<usize>) -> &'a mut [T] {
        assert!(range.start <= range.end && range.end <= self.len, "{range:?} of a buffer of {}", self.len);
        // SAFETY: in bounds; the caller guarantees exclusive use.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(range.start), range.len()) }
    }

    /// A part, to read.
    ///
    /// # Safety
    /// While it lives, no code may write any of it.
    pub(super) unsafe fn read(&self, range: Range<usize>) -> &'a [T] {
        assert!(range.start <= range.end && range.end <= self.len, "{range:?} of a buffer of {}", self.len);
        // SAFETY: in bounds; the caller guarantees that it is not written.
        unsafe { std::slice::from_raw_parts(self.start.add(range.start), range.len()) }
    }
}
