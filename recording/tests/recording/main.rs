//! Recordings as others see them: read back, read by other readers, cut off, made twice.

mod copies;
mod digest;
mod faults;
mod finer_values;
mod fixture;
mod live;
mod looking;
mod many_recordings;
mod other_readers;
mod python;
mod ring;
mod round_trip;
mod true_disparity;
