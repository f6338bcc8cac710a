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
    println!("{}", loaded.warnings);
    println!("{:#?}", loaded.plan);
    let kitti = self::loaded("table1-kitti.yaml", &[("sources.test.with.frames", "[3, 7]")]);
    println!("{}", kitti.plan.resolved);
    println!("{:?}", kitti.plan.runs[1].source);
}
