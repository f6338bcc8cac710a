//! The program `depthloom`: the library's kinds, and no others.

/// Without it Rust aborts where the system refuses memory.
#[global_allocator]
static ALLOCATOR: depthloom::ExitIfRefused = depthloom::ExitIfRefused;

fn main() -> std::process::ExitCode {
    depthloom::main(depthloom::registry())
}
