//! Recordings to percentiles, tables and plots, with polars.
