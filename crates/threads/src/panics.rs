//! Panics that are caught where they do not end the work: returned as a message, not printed.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static WATCHED: Cell<bool> = const { Cell::new(false) };
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// A panic that has been caught: its message, place included.
#[derive(Debug)]
pub struct Caught(pub String);

/// Runs `f`; a panic in it is caught and returned as a message, not printed.
///
/// # Errors
/// The panic, if there was one.
///
/// The message would otherwise go to the standard error of a program that may be drawing progress bars there, and once
/// more in the error. So the first call wraps the process's panic hook: panics inside `caught` are kept, all others go
/// the old way.
pub fn caught<R>(f: impl FnOnce() -> R) -> Result<R, Caught> {
    static WRAPPED: Once = Once::new();
    WRAPPED.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |info| {
            if WATCHED.with(Cell::get) {
                PLACE.set(info.location().map(ToString::to_string));
            } else {
                before(info);
            }
        }));
    });
    let outer = WATCHED.replace(true);
    // State that a panic may leave incomplete is dropped: scratch buffers taken are lost, and an ordered node is not
    // called again.
    let result = catch_unwind(AssertUnwindSafe(f));
    WATCHED.set(outer);
    result.map_err(|payload| Caught(message(payload.as_ref(), PLACE.take())))
}

/// Goes on panicking with a panic that was caught, here or on another thread.
pub fn resume(panic: Caught) -> ! {
    resume_unwind(Box::new(panic))
}

fn message(payload: &(dyn Any + Send), place: Option<String>) -> String {
    if let Some(Caught(text)) = payload.downcast_ref() {
        return text.clone();
    }
    let text = payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    let place = place.unwrap_or_else(|| "an unknown place".to_owned());
    format!("at {place}: {}", text.unwrap_or("no message"))
}

#[cfg(test)]
mod tests {
    use super::{Caught, caught, resume};
    #[test]
    fn a_panic_is_reported_with_its_place() {
        let Caught(text) = caught(|| panic!("{} is not {}", 2, 3)).expect_err("it panics");
        assert!(text.starts_with("at ") && text.contains("panics.rs:") && text.ends_with(": 2 is not 3"), "{text}");
    }

    #[test]
    fn a_panic_carried_over_from_another_thread_keeps_its_place() {
        let there = std::thread::spawn(|| caught(|| panic!("there")).err()).join().expect("it is caught");
        let text = there.as_ref().map(|c| c.0.clone()).expect("it panics");
        let here = caught(|| resume(there.expect("it panics"))).expect_err("it goes on");
        assert_eq!(here.0, text);
    }
}
