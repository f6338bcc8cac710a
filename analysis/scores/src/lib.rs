//! The formulas of depth scores: slices in, a row out; no polars, no I/O.
