//! Reads parts of samples on all cores.

use std::sync::Mutex;

use depthloom_threads::{Budget, Tiles as _, into_unlocked, locked};

use crate::error::{AnalysisError, caught};

/// Calls `take` for each part on all cores, with a value that `make` created for the thread. Returns these values.
///
/// # Errors
/// The error of the first part that failed; [`AnalysisError::Stopped`] once `stop` returns true.
pub(crate) fn scan<T: Send>(
    parts: usize,
    stop: &(dyn Fn() -> bool + Sync),
    make: impl Fn() -> T + Sync,
    take: impl Fn(&mut T, usize) -> Result<(), AnalysisError> + Sync,
) -> Result<Vec<T>, AnalysisError> {
    let idle: Mutex<Vec<T>> = Mutex::new(Vec::new());
    let failed: Mutex<Option<(usize, AnalysisError)>> = Mutex::new(None);
    let is_first = |failed: &Option<(usize, _)>, part| failed.as_ref().is_none_or(|(at, _)| part < *at);
    let budget = Budget::new(threads());
    let _own = budget.permit();
    budget.run(parts, &|part| {
        if !is_first(&locked(&failed), part) {
            return;
        }
        let result = caught(|| {
            if stop() {
                return Err(AnalysisError::Stopped);
            }
            let own = locked(&idle).pop();
            let mut own = own.unwrap_or_else(&make);
            take(&mut own, part)?;
            locked(&idle).push(own);
            Ok(())
        });
        if let Err(error) = result {
            let mut failed = locked(&failed);
            if is_first(&failed, part) {
                *failed = Some((part, error));
            }
        }
    });
    match into_unlocked(failed) {
        Some((_, error)) => Err(error),
        None => Ok(into_unlocked(idle)),
    }
}

pub(crate) fn threads() -> usize {
    depthloom_threads::core_count()
}
