//! Whole experiments to plans.

mod toys;

use std::path::Path;

use depthloom_graphs::language::{Loaded, Options, load};

fn file(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/experiments").join(name)
}

fn loaded(name: &str, set: &[(&str, &str)]) -> Loaded {
    let set = set.iter().map(|(path, value)| ((*path).to_owned(), (*value).to_owned())).collect();
    let options = Options { set, env: Box::new(|name| (name == "KITTI").then(|| "/data/kitti".to_owned())) };
    match load(&file(name), &toys::registry(), &options) {
        Ok(loaded) => loaded,
        Err(diagnostics) => panic!("{diagnostics}"),
    }
}

#[test]
fn table1_loads() {
    let loaded = loaded("table1.yaml", &[]);
    println!("{}\n{}\n{}", loaded.plan.summary(), loaded.plan.mermaid(), loaded.plan.dot());
    println!("{}", depthloom_graphs::render::kinds_index(&toys::registry()));
    for kind in ["stereo/sgbm", "filter/median", "kitti/stereo2015", "fusion/scale", "learn/ssl"] {
        println!("{}", depthloom_graphs::render::kind_reference(&toys::registry(), kind).unwrap());
    }
    std::fs::write("/tmp/schema.json", depthloom_graphs::language::schema(&toys::registry()).to_string()).unwrap();
}
