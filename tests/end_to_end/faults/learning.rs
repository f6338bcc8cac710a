//! Faults of learning and keys.
