//! What a command prints, and how it ends.
#![forbid(unsafe_code)]

mod columns;
mod error;
mod sizes;
mod streams;

pub use columns::aligned;
pub use error::{CliError, ExitCode, Problem, help_of, is_refused};
pub use sizes::{parse_age, parse_duration, parse_size, size};
pub use streams::{
    on_one_line, print, print_bytes, print_json, print_path, print_quoted, same_length, say, tell, tell_styled, visible,
};
