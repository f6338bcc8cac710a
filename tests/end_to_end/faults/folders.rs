//! Faults of a run's folder, signals, streams and what the system refuses.
