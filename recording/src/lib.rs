//! Values to MCAP messages and back: writing and reading recordings.
