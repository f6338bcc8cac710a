//! Faults of recordings: checksums, cuts, damage.
