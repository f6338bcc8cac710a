//! Mutexes that are usable after a panic.
//!
//! A panic of a thread is caught and reported where its work is waited for. What it left behind a lock is used as it
//! is: waiters that panic, too, would only hide the first panic.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex, also after a thread panicked while it held the lock.
pub fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The value of a mutex, also after a thread panicked while it held the lock.
pub fn into_unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_within_a_lock_leaves_it_usable() {
        let mutex = Mutex::new(1);
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let mut value = locked(&mutex);
            *value = 2;
            panic!("within");
        }));
        assert!(panicked.is_err() && mutex.is_poisoned());
        assert_eq!(*locked(&mutex), 2);
        assert_eq!(into_unlocked(mutex), 2);
    }
}
