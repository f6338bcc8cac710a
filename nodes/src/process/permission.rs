//! Whether an experiment may start programs. Only the user can allow this, so that YAML files from others start
//! nothing.

use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_graphs::Fault;

static ALLOWED: AtomicBool = AtomicBool::new(false);

/// Allows experiments in this process to start the programs that they name. Call it only if the user has allowed
/// this.
pub fn allow() {
    ALLOWED.store(true, Ordering::Relaxed);
}

/// Whether the user has allowed this.
pub fn is_allowed() -> bool {
    ALLOWED.load(Ordering::Relaxed)
}

/// Called before every start, and as soon as a start is certain.
pub(crate) fn check(command: &str) -> Result<(), Fault> {
    if is_allowed() {
        return Ok(());
    }
    let what = format!("it would start `{command}`, and an experiment starts no program unless you allow it");
    Err(Fault::new(what).remedy(
        "read what it starts; then run it with --allow-exec, or list the experiment's file under `allow_exec` in your \
         configuration, ~/.config/depthloom/config.yaml",
    ))
}
