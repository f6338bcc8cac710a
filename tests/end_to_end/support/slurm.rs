//! A Slurm cluster of one node on this machine, for one test: without systemd, accounting and root.
//!
//! Clusters do not disturb each other: each has its own folder, ports, key and daemons.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use depthloom_test_needs::Slurm;

use super::succeed;

/// The CPUs of the node, on every machine: eight tasks of one CPU run at once, also on two cores.
pub(crate) const CPUS: usize = 8;

/// Longest wait, on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// The states of jobs that have ended.
const FINAL: [&str; 7] = ["COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "DEADLINE"];

/// Ends all processes of the cluster when its standard input is closed: by `Drop`, or by the end of the test program,
/// also by SIGKILL. The folder of the cluster is `$0`.
///
/// Daemons and jobs have `SLURM_CONF` in their environment. A `slurmstepd` replaces its environment by its title, and
/// is found by its open log file.
const GUARD: &str = r#"
trap '' INT TERM HUP
cat >/dev/null
pass=0
while [ $pass -lt 50 ]; do
  found=
  for process in /proc/[0-9]*; do
    number=${process#/proc/}
    [ "$number" = $$ ] || [ "$number" = $PPID ] && continue
    if grep -qsazxF "SLURM_CONF=$0/slurm.conf" "$process/environ" ||
      ls -l "$process/fd" 2>/dev/null | grep -qF "$0/slurmd.log"; then
      kill -9 "$number" 2>/dev/null && found=1
    fi
  done
  [ -z "$found" ] && break
  pass=$((pass + 1))
done
rm -rf "$0"
"#;

/// A cluster with one node, `localhost`, and one partition, `debug`. Its daemons and jobs end when it is dropped.
///
/// A requeued job starts after eleven seconds. A job that has ended is visible for five minutes, because there is no
/// accounting.
pub(crate) struct Cluster {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
    guard: Option<(Child, ChildStdin)>,
}

/// A job or a task of an array, as `squeue` shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Job {
    /// `RUNNING`, `COMPLETED`, ...
    pub(crate) state: String,
    /// `None`, `Dependency`, `NonZeroExitCode`, ...
    pub(crate) reason: String,
}

impl Cluster {
    /// Starts a cluster. `None` without Slurm: the test is then reported as skipped.
    pub(crate) fn start(test: &str) -> Option<Self> {
        Self::start_with(test, "")
    }

    /// Starts a cluster with more lines in its `slurm.conf`; of two lines for one parameter, Slurm uses the last.
    pub(crate) fn start_with(test: &str, configuration: &str) -> Option<Self> {
        let slurm = depthloom_test_needs::slurm(test)?;
        let mut failures = String::new();
        // Another program may take a port between its choice and its use.
        for _ in 0..3 {
            match Self::try_start(&slurm, configuration) {
                Ok(cluster) => return Some(cluster),
                Err(failure) => failures += &failure,
            }
        }
        panic!("no cluster of Slurm starts:\n{failures}");
    }

    fn try_start(slurm: &Slurm, configuration: &str) -> Result<Self, String> {
        let folder = tempfile::Builder::new().prefix("depthloom-slurm-").tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        // All users of the machine must reach munge's socket, and only its owner may read the key.
        for (name, mode) in [("munge", 0o711), ("state", 0o700), ("spool", 0o755)] {
            make_folder(&at(name), mode);
        }
        set_mode(folder.path(), 0o755);
        fs::write(at("munge.key"), random_bytes()).expect("a key");
        set_mode(&at("munge.key"), 0o600);
        fs::write(at("slurm.conf"), configuration_of(folder.path()) + configuration).expect("a configuration");

        let mut guard = Command::new("sh");
        guard.args(["-c", GUARD]).arg(folder.path()).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut guard = guard.spawn().expect("sh starts");
        let stdin = guard.stdin.take().expect("piped");
        let mut cluster = Self { folder, daemons: Vec::new(), guard: Some((guard, stdin)) };
        let at = |name: &str| cluster.folder.path().join(name);

        let option = |name: &str, file: &str| format!("--{name}={}", at(file).display());
        let mut munged = cluster.command(&slurm.munged);
        munged.args(["--foreground", "--force", "--num-threads=2"]);
        munged.args([option("key-file", "munge.key"), option("socket", "munge/socket")]);
        munged.args([option("pid-file", "munged.pid"), option("log-file", "munged.log")]);
        munged.arg(option("seed-file", "munged.seed"));
        let mut controller = cluster.command(&slurm.slurmctld);
        controller.arg("-D");
        let mut node = cluster.command(&slurm.slurmd);
        node.args(["-D", "-N", "localhost"]);

        cluster.spawn(munged, "munged.out");
        cluster.wait_until(|cluster| cluster.path("munge/socket").exists())?;
        cluster.spawn(controller, "slurmctld.out");
        cluster.spawn(node, "slurmd.out");
        cluster.wait_until(|cluster| {
            let output = cluster.command("sinfo").args(["-h", "-o", "%T"]).output().expect("sinfo starts");
            output.stdout.trim_ascii() == b"idle"
        })?;
        Ok(cluster)
    }

    fn spawn(&mut self, mut daemon: Command, log: &str) {
        let output = File::create(self.path(log)).expect("a log");
        let errors = output.try_clone().expect("a log");
        daemon.stdin(Stdio::null()).stdout(output).stderr(errors);
        self.daemons.push(daemon.spawn().expect("a daemon of Slurm starts"));
    }

    /// Waits while all daemons run.
    fn wait_until(&mut self, holds: impl Fn(&Self) -> bool) -> Result<(), String> {
        let start = Instant::now();
        while !holds(self) {
            let is_ended = |daemon: &mut Child| daemon.try_wait().is_ok_and(|status| status.is_some());
            if self.daemons.iter_mut().any(is_ended) || start.elapsed() > PATIENCE / 3 {
                return Err(self.logs());
            }
            sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// A path in the cluster's folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Lets a command use the cluster: `sbatch`, `squeue`, or `depthloom submit`.
    pub(crate) fn set_environment(&self, command: &mut Command) {
        // The tests may themselves run in a job.
        for (name, _) in std::env::vars_os() {
            if ["SLURM_", "SBATCH_", "SQUEUE_", "SCANCEL_"].iter().any(|of| name.to_string_lossy().starts_with(of)) {
                command.env_remove(name);
            }
        }
        command.env("SLURM_CONF", self.path("slurm.conf"));
    }

    /// A command that uses the cluster.
    pub(crate) fn command(&self, program: impl AsRef<Path>) -> Command {
        let mut command = Command::new(program.as_ref());
        self.set_environment(&mut command);
        command
    }

    /// Submits a shell script as a job; returns its number.
    pub(crate) fn submit(&self, options: &[&str], script: &str) -> String {
        let mut sbatch = self.command("sbatch");
        sbatch.current_dir(self.folder.path()).arg("--parsable").args(options).arg(format!("--wrap={script}"));
        String::from_utf8(succeed(&mut sbatch).stdout).expect("text").trim().to_owned()
    }

    /// Runs `scontrol`, which must succeed.
    pub(crate) fn scontrol(&self, arguments: &[&str]) -> String {
        String::from_utf8(succeed(self.command("scontrol").args(arguments)).stdout).expect("text")
    }

    /// Ends a running job as if its time were over: within 30 seconds, the period in which Slurm checks times. The
    /// shortest value of `--time` is one minute.
    pub(crate) fn end_time(&self, job: &str) {
        self.scontrol(&["update", &format!("JobId={job}"), "EndTime=now+1seconds"]);
    }

    /// Jobs and tasks by their numbers (`7`, or `7_0` of an array); numbers that Slurm does not know are missing.
    pub(crate) fn jobs(&self, numbers: &[&str]) -> BTreeMap<String, Job> {
        let mut squeue = self.command("squeue");
        squeue.args(["-h", "-r", "-t", "all", "-o", "%i|%T|%r", "-j", &numbers.join(",")]);
        let output = squeue.output().expect("squeue starts");
        let text = String::from_utf8(output.stdout).expect("text");
        let job = |line: &str| {
            let [number, state, reason] = line.split('|').collect::<Vec<_>>().try_into().ok()?;
            Some((number.to_owned(), Job { state: state.to_owned(), reason: reason.to_owned() }))
        };
        text.lines().map(|line| job(line).unwrap_or_else(|| panic!("`{line}` of squeue"))).collect()
    }

    /// Waits until a job, or every task of an array, is in this state.
    pub(crate) fn wait_for(&self, number: &str, state: &str) {
        let start = Instant::now();
        loop {
            let jobs = self.jobs(&[number]);
            if !jobs.is_empty() && jobs.values().all(|job| job.state == state) {
                return;
            }
            let are_final = !jobs.is_empty() && jobs.values().all(|job| FINAL.contains(&job.state.as_str()));
            if are_final || start.elapsed() > PATIENCE {
                panic!("job {number} is not {state} after {:?}: {jobs:?}\n{}", start.elapsed(), self.logs());
            }
            sleep(Duration::from_millis(100));
        }
    }

    /// The ends of all logs.
    pub(crate) fn logs(&self) -> String {
        let names = ["munged.out", "munged.log", "slurmctld.out", "slurmctld.log", "slurmd.out", "slurmd.log"];
        let end = |name: &&str| {
            let text = fs::read(self.path(name)).unwrap_or_default();
            let text = String::from_utf8_lossy(&text).into_owned();
            let lines: Vec<&str> = text.lines().collect();
            format!("--- {name}\n{}\n", lines[lines.len().saturating_sub(20)..].join("\n"))
        };
        names.iter().map(end).collect()
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        if let Some((mut guard, stdin)) = self.guard.take() {
            drop(stdin);
            _ = guard.wait();
        }
        for daemon in &mut self.daemons {
            _ = daemon.kill();
            _ = daemon.wait();
        }
    }
}

/// The configuration of a cluster in a folder, with free ports.
fn configuration_of(folder: &Path) -> String {
    let listeners = [0, 1].map(|_| TcpListener::bind(("127.0.0.1", 0)).expect("a free port"));
    let [controller, node] = listeners.each_ref().map(|listener| listener.local_addr().expect("a port").port());
    let user = rustix::process::geteuid().as_raw();
    let folder = folder.display();
    // `cred_expire`: a requeued job starts only after its old credential has expired, 120 s by default. If an update of
    // its `StartTime` starts it before, the node refuses the credential and the job fails.
    // `KillWait`: the time from SIGTERM to SIGKILL, enough on a busy machine.
    // `config_overrides`: the node has these CPUs and this memory although the machine may have less.
    // `RealMemory`: without it, Slurm refuses every job with `--mem`.
    format!(
        "ClusterName=tests
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket,cred_expire=10
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
JobRequeue=1
KillWait=10
MinJobAge=300
SchedulerParameters=sched_interval=1,sched_min_interval=0,batch_sched_delay=0,bf_interval=1
NodeName=localhost NodeAddr=127.0.0.1 CPUs={CPUS} RealMemory=65536
PartitionName=debug Nodes=ALL Default=YES MaxTime=INFINITE
"
    )
}

/// A key of munge has at least 32 bytes.
fn random_bytes() -> [u8; 128] {
    let mut bytes = [0; 128];
    let mut random = File::open("/dev/urandom").expect("a Linux");
    std::io::Read::read_exact(&mut random, &mut bytes).expect("it has no end");
    bytes
}

fn make_folder(path: &Path, mode: u32) {
    fs::create_dir(path).expect("a folder");
    set_mode(path, mode);
}

fn set_mode(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).expect("an owner may do that");
}
