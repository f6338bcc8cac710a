//! Writes the seeds of all targets where cargo-fuzz looks for them: `cargo run --release -p depthloom-fuzz --example
//! seeds -- crates/fuzz/fuzz/corpus`.

use std::path::Path;

fn main() -> std::io::Result<()> {
    let corpus = std::env::args().nth(1).unwrap_or_else(|| "crates/fuzz/fuzz/corpus".to_owned());
    for target in depthloom_fuzz::targets() {
        let folder = Path::new(&corpus).join(target.name);
        std::fs::create_dir_all(&folder)?;
        for (number, seed) in target.seeds.iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{number}")), seed)?;
        }
    }
    Ok(())
}
