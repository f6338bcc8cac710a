//! Whether an experiment may start programs. It may not, unless the person who runs it says so: a stranger's YAML runs
//! nothing.

use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_graphs::Fault;

static GIVEN: AtomicBool = AtomicBool::new(false);

/// Lets experiments start the programs that they name, from now on, in this process. For whoever knows that the person
/// said so.
pub fn give() {
    GIVEN.store(true, Ordering::Relaxed);
}

/// Called before every start, and where it is known that one will follow.
pub(crate) fn check(command: &str) -> Result<(), Fault> {
    if GIVEN.load(Ordering::Relaxed) {
        return Ok(());
    }
    let what = format!("it would start `{command}`, and an experiment starts no program unless you allow it");
    Err(Fault::new(what).remedy(
        "read what it starts; then run it with --allow-exec, or list the experiment's file under `allow_exec` in your \
         configuration, ~/.config/depthloom/config.yaml",
    ))
}
