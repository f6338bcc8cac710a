//! Faults of numbers, tables and figures.
