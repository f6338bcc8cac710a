//! How many cores this process may use.

use std::num::NonZeroUsize;
use std::thread::available_parallelism;

/// Cores of a task of Slurm. Slurm sets it only if the job was submitted with `--cpus-per-task`.
pub const SLURM_VARIABLE: &str = "SLURM_CPUS_PER_TASK";

/// How many cores this process may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cores {
    /// The number of cores, at least 1.
    pub number: usize,
    /// The number without [`SLURM_VARIABLE`]: `number`, or more.
    pub system: usize,
}

/// The cores that this process may use: the default for every number of threads.
///
/// These are the cores of the machine, less if the affinity of the process, a quota of its control group or
/// `SLURM_CPUS_PER_TASK` allow less. Clusters without control groups state the cores of a task in that variable only. A
/// value that is not a positive integer is ignored.
#[must_use]
pub fn cores() -> Cores {
    let system = available_parallelism().map_or(1, NonZeroUsize::get);
    limited(system, std::env::var(SLURM_VARIABLE).ok().as_deref())
}

/// [`Cores::number`] of [`cores`].
#[must_use]
pub fn core_count() -> usize {
    cores().number
}

fn limited(system: usize, slurm: Option<&str>) -> Cores {
    let slurm = slurm.and_then(|text| text.trim().parse::<NonZeroUsize>().ok());
    Cores { number: slurm.map_or(system, |number| number.get().min(system)), system }
}

#[cfg(test)]
mod tests {
    use super::{Cores, core_count, limited};

    #[test]
    fn slurm_lowers_the_number_of_cores_and_never_raises_it() {
        for ignored in [None, Some(""), Some("0"), Some("-1"), Some("four"), Some("2.5"), Some("8"), Some("64")] {
            assert_eq!(limited(8, ignored), Cores { number: 8, system: 8 }, "{ignored:?}");
        }
        assert_eq!(limited(8, Some("3")), Cores { number: 3, system: 8 });
        assert_eq!(limited(8, Some(" 1\n")), Cores { number: 1, system: 8 });
        assert!(core_count() >= 1);
    }
}
