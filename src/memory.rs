//! Memory that the system refuses ends the program with an error, not with an abort.
//!
//! Where a file or a parameter decides the size of an allocation, the caller handles a refusal. Everywhere else Rust's
//! collections cannot report a refusal: the standard library would abort. This allocator prints the size and exits with
//! the engine's exit code instead; frames that were written are readable, as after a kill.
//!
//! Maps of a frame are as large as those of the frame before: freed memory is kept for them.
#![expect(unsafe_code, reason = "the interface of allocators is unsafe; every call is forwarded to the system's")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::{self, Write as _};

use depthloom_terminal::ExitCode;

use crate::signals;

/// From this size on, bytes, the caller handles a refusal.
const CALLER_HANDLES: usize = 64 << 20;

/// The system's allocator. If the system refuses an allocation below 64 MiB, the program prints an error and exits with
/// the code 1.
///
/// A program sets it with `#[global_allocator]`; this library does not.
#[derive(Debug)]
pub struct ExitIfRefused;

// SAFETY: each call is forwarded to the system's allocator with the same arguments, and its result is returned.
unsafe impl GlobalAlloc for ExitIfRefused {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the same promises.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        checked(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Lets glibc keep freed memory instead of returning it to the system, which would have to clear its pages again: a
/// quarter of the CPU time of `report`. Other allocators decide for themselves.
pub(crate) fn keep_freed() {
    #[cfg(target_env = "gnu")]
    {
        use std::ffi::c_int;

        /// Free memory at the end of a heap above which it is returned.
        const TRIM_THRESHOLD: c_int = -1;
        /// The size from which an allocation has pages of its own, which are returned with it; at most 32 MiB.
        const MMAP_THRESHOLD: c_int = -3;
        unsafe extern "C" {
            fn mallopt(parameter: c_int, value: c_int) -> c_int;
        }
        // SAFETY: the parameters and values are those of the manual. What glibc refuses, it ignores.
        unsafe {
            mallopt(MMAP_THRESHOLD, 32 << 20);
            mallopt(TRIM_THRESHOLD, 128 << 20);
        }
    }
}

fn checked(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() && bytes < CALLER_HANDLES {
        refused(bytes);
    }
    memory
}

/// Says it without asking for memory, and leaves without giving any back: both could fail again.
#[cold]
fn refused(bytes: usize) -> ! {
    let mut line = [0; 200];
    let mut rest = &mut line[..];
    // A line that did not fit would be cut.
    let _ = writeln!(
        rest,
        "error: the system refuses {bytes} more bytes of memory\n  help: take fewer --workers, a smaller --window, or raise the limit (`ulimit -v`)"
    );
    let free = rest.len();
    let _ = io::stderr().lock().write_all(&line[..line.len() - free]);
    signals::leave(ExitCode::Engine)
}
