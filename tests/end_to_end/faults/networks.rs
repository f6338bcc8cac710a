//! Faults of networks, engines and values that are no numbers.
