//! The program `depthloom`: the library's kinds, and no others.

fn main() -> std::process::ExitCode {
    depthloom::main(depthloom::registry())
}
