//! Room for a thread, looked for before one is started.

use std::hint::black_box;
use std::io;

/// The stack that Rust gives a thread, and what the C library and Rust ask for beside it: bytes.
const NEEDED: usize = (2 << 20) + (256 << 10);

/// Looks whether there is memory for one more thread.
///
/// Where the system gives a stack and then nothing more, Rust's own start of the thread panics before any code of ours
/// runs there, and the process ends by SIGABRT: so the memory that it needs is allocated here, where a refusal is an
/// ordinary error, and freed.
///
/// # Errors
/// If the system refuses.
pub fn look_for_room() -> io::Result<()> {
    let mut room = Vec::<u8>::new();
    let refused = black_box(&mut room).try_reserve_exact(NEEDED);
    drop(black_box(room));
    refused.map_err(|_| io::ErrorKind::OutOfMemory.into())
}

#[cfg(test)]
mod tests {
    #[test]
    fn there_is_room() {
        super::look_for_room().expect("two megabytes");
    }
}
