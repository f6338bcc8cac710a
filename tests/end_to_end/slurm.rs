//! The cluster of the tests: arrays, dependencies, requeued jobs and limits of time, as jobs of depthloom use them.

use std::fs;
use std::process::Command;

use crate::support::slurm::{CPUS, Cluster, Job};

fn job(state: &str, reason: &str) -> Job {
    Job { state: state.to_owned(), reason: reason.to_owned() }
}

/// The processes with a text in their command line or environment.
fn processes_with(text: &str) -> usize {
    let contains = |bytes: &[u8]| bytes.windows(text.len()).any(|window| window == text.as_bytes());
    let all = fs::read_dir("/proc").expect("a Linux").flatten();
    all.filter(|process| {
        ["cmdline", "environ"]
            .iter()
            .any(|file| fs::read(process.path().join(file)).is_ok_and(|bytes| contains(&bytes)))
    })
    .count()
}

#[test]
fn tasks_of_an_array_run_at_once_and_a_dependent_job_runs_after_them() {
    const TEST: &str = "tasks_of_an_array_run_at_once_and_a_dependent_job_runs_after_them";
    let Some(cluster) = Cluster::start(TEST) else { return };
    // Each task waits for the files of all four.
    let script = "touch begun-$SLURM_ARRAY_TASK_ID; until [ $(ls begun-* | wc -l) = 4 ]; do sleep 0.1; done; \
                  echo $SLURM_ARRAY_TASK_ID $SLURM_CPUS_PER_TASK $(nproc) > task-$SLURM_ARRAY_TASK_ID";
    let array = cluster.submit(&["--array=0-3", "--cpus-per-task=2", "--mem=1G", "--output=%A_%a.log"], script);
    let after = format!("--dependency=afterok:{array}");
    let dependent =
        cluster.submit(&[&after, "--kill-on-invalid-dep=yes", "--output=dependent.log"], "cat task-* > all");
    cluster.wait_for(&dependent, "COMPLETED");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let expected: String = (0..4).map(|task| format!("{task} 2 {cores}\n")).collect();
    assert_eq!(fs::read_to_string(cluster.path("all")).expect("written"), expected);
    let tasks = cluster.jobs(&[&array]);
    assert_eq!(tasks.len(), 4);
    for task in 0..4 {
        assert_eq!(tasks[&format!("{array}_{task}")], job("COMPLETED", "None"));
    }
}

#[test]
fn jobs_that_fail_wait_or_are_cancelled_have_the_states_of_slurm() {
    const TEST: &str = "jobs_that_fail_wait_or_are_cancelled_have_the_states_of_slurm";
    let Some(cluster) = Cluster::start(TEST) else { return };
    let long = cluster.submit(&["--output=/dev/null", "--exclusive"], "sleep 600");
    cluster.wait_for(&long, "RUNNING");
    let failing = cluster.submit(&["--array=0-2%1", "--output=/dev/null"], "exit $((3 * SLURM_ARRAY_TASK_ID))");
    let after = format!("--dependency=afterok:{failing}");
    let dependent = cluster.submit(&[&after, "--kill-on-invalid-dep=yes", "--output=/dev/null"], "true");
    let waiting = cluster.submit(&[&after, "--output=/dev/null"], "true");
    let current = |number: &str| cluster.jobs(&[number]).remove(number).expect("a job");
    assert_eq!(cluster.jobs(&[&failing]).len(), 3);
    // The reason is `Dependency`, or `Resources` while the node is busy.
    assert_eq!(current(&dependent).state, "PENDING");
    succeed_scancel(&cluster, &long);
    cluster.wait_for(&long, "CANCELLED");
    cluster.wait_for(&format!("{failing}_2"), "FAILED");
    assert_eq!(current(&format!("{failing}_0")), job("COMPLETED", "None"));
    assert_eq!(current(&format!("{failing}_2")), job("FAILED", "NonZeroExitCode"));
    assert!(cluster.scontrol(&["show", "job", &format!("{failing}_2")]).contains(" ExitCode=6:0"));
    cluster.wait_for(&dependent, "CANCELLED");
    assert_eq!(current(&dependent), job("CANCELLED", "DependencyNeverSatisfied"));
    assert_eq!(current(&waiting), job("PENDING", "DependencyNeverSatisfied"));
}

fn succeed_scancel(cluster: &Cluster, number: &str) {
    crate::support::succeed(cluster.command("scancel").arg(number));
}

#[test]
fn a_requeued_job_gets_sigterm_and_starts_again_under_its_number() {
    const TEST: &str = "a_requeued_job_gets_sigterm_and_starts_again_under_its_number";
    let Some(cluster) = Cluster::start(TEST) else { return };
    // Slurm sends SIGTERM to `sleep`, too, and maybe first.
    let script = "trap 'echo ended by SIGTERM >> log; exit 1' TERM; echo restarts ${SLURM_RESTART_COUNT:-0} >> log; \
                  while [ -z \"$SLURM_RESTART_COUNT\" ]; do sleep 0.1; done";
    let number = cluster.submit(&["--requeue", "--output=/dev/null"], script);
    let log = || fs::read_to_string(cluster.path("log")).unwrap_or_default();
    while log() != "restarts 0\n" {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    cluster.scontrol(&["requeue", &number]);
    cluster.wait_for(&number, "PENDING");
    assert_eq!(cluster.jobs(&[&number])[&number], job("PENDING", "BeginTime"));
    cluster.wait_for(&number, "COMPLETED");
    assert_eq!(log(), "restarts 0\nended by SIGTERM\nrestarts 1\n");
}

#[test]
fn a_job_that_exceeds_its_time_gets_sigterm_and_is_in_state_timeout() {
    const TEST: &str = "a_job_that_exceeds_its_time_gets_sigterm_and_is_in_state_timeout";
    let Some(cluster) = Cluster::start(TEST) else { return };
    let script = "trap 'echo ended by SIGTERM > log; exit 1' TERM; touch begun; while true; do sleep 0.1; done";
    let number = cluster.submit(&["--time=1", "--output=/dev/null"], script);
    while !cluster.path("begun").exists() {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    cluster.end_time(&number);
    cluster.wait_for(&number, "TIMEOUT");
    assert_eq!(cluster.jobs(&[&number])[&number], job("TIMEOUT", "TimeLimit"));
    assert_eq!(fs::read_to_string(cluster.path("log")).expect("written"), "ended by SIGTERM\n");
}

#[test]
fn clusters_are_independent_and_leave_no_process_even_after_a_panic() {
    const TEST: &str = "clusters_are_independent_and_leave_no_process_even_after_a_panic";
    let Some(first) = Cluster::start(TEST) else { return };
    let options = ["--output=/dev/null", "--requeue"];
    let number = first.submit(&options, "sleep 600");
    first.wait_for(&number, "RUNNING");
    let (folder, guard) = std::thread::spawn(|| {
        let other = Cluster::start(TEST).expect("Slurm was found");
        for _ in 0..CPUS {
            other.submit(&["--output=/dev/null"], "trap '' TERM; setsid sleep 600 & sleep 600");
        }
        let numbers: Vec<String> = (1..=CPUS).map(|number| number.to_string()).collect();
        numbers.iter().for_each(|number| other.wait_for(number, "RUNNING"));
        let folder = other.path("");
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
            let _other = other;
            std::panic::resume_unwind(Box::new("a test that fails"));
        }));
        (folder, result.is_err())
    })
    .join()
    .expect("a cluster");
    assert!(guard);
    let mark = folder.to_str().expect("text").trim_end_matches('/');
    assert_eq!(processes_with(mark), 0);
    assert!(!folder.exists());
    assert_eq!(first.jobs(&[&number])[&number].state, "RUNNING");
    // Its daemons work.
    let next = first.submit(&options, "true");
    first.wait_for(&next, "COMPLETED");
    // No command outside of a cluster reaches one.
    assert!(!Command::new("sinfo").env_remove("SLURM_CONF").output().is_ok_and(|output| output.status.success()));
}
