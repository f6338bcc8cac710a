//! Recordings as others see them: read back, read by other readers, cut off, made twice.

mod fixture;
mod round_trip;
