//! One budget of threads for all who work at once, tiles spread over it, and panics that are caught on the way.
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//! use depthloom_threads::{Budget, Tiles};
//!
//! let budget = Budget::new(2);
//! let _own = budget.permit(); // of the thread that works here
//! let sum = AtomicUsize::new(0);
//! budget.run(100, &|tile| {
//!     sum.fetch_add(tile, Ordering::Relaxed);
//! });
//! assert_eq!(sum.into_inner(), 4950);
//! ```
#![forbid(unsafe_code)]

mod budget;
mod cores;
mod helpers;
mod locks;
mod panics;
mod room;
mod tiles;

pub use budget::{Budget, Permit};
pub use cores::{Cores, SLURM_VARIABLE, core_count, cores};
pub use locks::{into_unlocked, locked};
pub use panics::{Caught, caught, resume};
pub use room::look_for_room;
pub use tiles::{Serial, Tiles, in_order, rounds_in_one_run};
