//! The last test program of `cargo test --workspace`: lists the tests that the others skipped, and writes the list to
//! `target/skipped.txt`.

use std::fmt::Write;

use depthloom_test_needs::skips::Records;
use depthloom_test_needs::target;

fn main() -> std::io::Result<()> {
    // With `--list`, runners expect names of tests. This program has no named tests.
    if std::env::args().any(|argument| argument == "--list") {
        return Ok(());
    }
    let skipped = Records::of_this_run().take()?;
    let mut text = match skipped.len() {
        0 => "no test was skipped\n".to_owned(),
        1 => "1 TEST WAS SKIPPED\n".to_owned(),
        n => format!("{n} TESTS WERE SKIPPED\n"),
    };
    skipped.iter().for_each(|test| writeln!(text, "    {test}").expect("a String takes what is written"));
    println!("\n{text}");
    std::fs::write(target().join("skipped.txt"), text)
}
