//! Executes a plan: admission, workers, tap.
