//! The `depthloom` command.
fn main() {}
