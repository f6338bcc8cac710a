//! Linker arguments of the test programs.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|found| found == value);
    if is("CARGO_CFG_TARGET_OS", "linux") && is("CARGO_CFG_TARGET_ENV", "gnu") {
        // A program at a fixed address starts in a third of the time: nothing is relocated. `fuzz_reuse` starts itself
        // thousands of times.
        println!("cargo:rustc-link-arg-tests=-no-pie");
    }
}
