//! Slurm, for tests of jobs on a cluster.

use std::path::PathBuf;

/// The programs of a cluster; the commands for its users (`sbatch`, `squeue`) are on the PATH.
pub struct Slurm {
    /// Authenticates messages.
    pub munged: PathBuf,
    /// Controls the cluster.
    pub slurmctld: PathBuf,
    /// Runs the jobs of a node.
    pub slurmd: PathBuf,
}

/// Slurm's programs, on the PATH or in `/usr/sbin`, which is not on every user's PATH. `None` without Slurm: the test
/// is then reported as skipped.
///
/// # Panics
/// Without Slurm, if `DEPTHLOOM_REQUIRE_SLURM` is set.
#[must_use]
pub fn slurm(test: &str) -> Option<Slurm> {
    if !crate::full(test) {
        return None;
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> =
        std::env::split_paths(&path).chain(["/usr/sbin".into(), "/usr/local/sbin".into()]).collect();
    let find = |name: &str| folders.iter().map(|folder| folder.join(name)).find(|program| program.is_file());
    let missing: Vec<&str> =
        ["munged", "slurmctld", "slurmd", "sbatch"].into_iter().filter(|name| find(name).is_none()).collect();
    let found = find("munged").zip(find("slurmctld")).zip(find("slurmd")).filter(|_| missing.is_empty());
    if found.is_none() {
        let why = format!("there is no {} (Debian's packages slurm-wlm and munge)", missing.join(", "));
        crate::miss("DEPTHLOOM_REQUIRE_SLURM", test, &why);
    }
    found.map(|((munged, slurmctld), slurmd)| Slurm { munged, slurmctld, slurmd })
}
