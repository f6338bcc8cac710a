//! depthloom with two kinds of one's own: a source `example/plane` and a node `example/nearer`.
//!
//! ```sh
//! cargo run --release -p own-node -- nodes example/nearer
//! cargo run --release -p own-node -- run examples/own-node/plane.yaml
//! ```

mod nearer;
mod plane;

use std::process::ExitCode;

fn main() -> ExitCode {
    let registry = depthloom::registry().source::<plane::Plane>().node::<nearer::Nearer>();
    depthloom::main(registry)
}
