//! Kernels' tiles on the runner's workers.

use depthloom_graphs::Host;
use depthloom_kernels::tiles::{Tiles, rounds_in_one_run};

pub(crate) struct HostTiles<'a>(pub &'a dyn Host);

impl Tiles for HostTiles<'_> {
    fn run(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        self.0.tiles(n, f);
    }

    fn rounds(&self, counts: &[usize], f: &(dyn Fn(usize, usize) + Sync)) {
        rounds_in_one_run(self, counts, f);
    }

    fn width(&self) -> usize {
        self.0.width()
    }
}
