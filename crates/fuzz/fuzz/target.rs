// The body of every fuzz target: runs the reader of the same name.

use depthloom_fuzz::Reader;
use libfuzzer_sys::fuzz_target;

thread_local!(static READER: Reader = Reader::from_name(env!("CARGO_BIN_NAME")));

fuzz_target!(|bytes: &[u8]| READER.with(|reader| drop(reader.read(bytes))));
