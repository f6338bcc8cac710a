//! `DEPTHLOOM_SIMD` governs every kernel: what a program finds in its environment as it begins is what it takes.

use depthloom_kernels::simd::{Level, Path};

/// Run by the test below in a process of its own.
#[test]
fn what_is_best_here() {
    println!("best is {} and {}", Level::best().name(), Path::best().name());
}

#[test]
fn the_variable_holds_levels_and_paths_down() {
    let program = std::env::current_exe().expect("this test is a program");
    let names: Vec<_> = Level::available().into_iter().map(Level::name).collect();
    for wanted in names.iter().copied().chain(["nonsense"]) {
        let run = std::process::Command::new(&program)
            .args(["--exact", "what_is_best_here", "--nocapture"])
            .env("DEPTHLOOM_SIMD", wanted)
            .output()
            .expect("this test runs once more");
        let stdout = String::from_utf8_lossy(&run.stdout).into_owned();
        let best = if wanted == "nonsense" { names[names.len() - 1] } else { wanted };
        assert!(stdout.contains(&format!("best is {best} and {best}")), "{wanted}: {stdout}");
    }
}
