//! Faults of the experiment language and what sources read.
