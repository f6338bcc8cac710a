//! An experiment starts no program without permission.

use std::path::Path;
use std::process::{Command, Stdio};

use super::{Peer, output_of, run};
use crate::support::{depthloom, skipped, system_python};

/// An experiment whose node creates a marker file if it is started.
fn hostile(peer: &Peer) -> (std::path::PathBuf, std::path::PathBuf) {
    let marker = peer.path("started");
    let command = format!("[/bin/sh, -c, {:?}]", format!("touch {}", marker.display()));
    (peer.experiment("hostile", "0..1", &command, "version: 1"), marker)
}

/// Commands that inspect or run an experiment, without permission to start programs.
fn commands<'a>(experiment: &'a str, out: &'a str) -> Vec<Vec<&'a str>> {
    vec![
        vec!["check", experiment],
        vec!["check", experiment, "--data"],
        vec!["plan", experiment],
        vec!["plan", experiment, "--reuse"],
        vec!["graph", experiment],
        vec!["run", "--no-page", experiment, "--out", out],
    ]
}

#[test]
fn without_permission_no_program_is_started_and_the_error_names_it() {
    let peer = Peer::new();
    let (experiment, marker) = hostile(&peer);
    let out = peer.path("out");
    for arguments in commands(&experiment.to_string_lossy(), &out.to_string_lossy()) {
        let output =
            depthloom().args(&arguments).env("HOME", peer.folder.path()).env_remove("XDG_CONFIG_HOME").output();
        let output = output.expect("started");
        let refuses = arguments[0] == "run" || arguments.contains(&"--reuse");
        assert_eq!(output.status.code(), Some(if refuses { 2 } else { 0 }), "{arguments:?}: {}", output_of(&output));
        if refuses {
            let printed = output_of(&output);
            for part in
                ["node `look.own` (process)", "it would start `/bin/sh -c \"touch ", "--allow-exec", "allow_exec"]
            {
                assert!(printed.contains(part), "{part:?} is missing: {printed}");
            }
        }
        assert!(!marker.exists(), "{arguments:?} started the program");
    }
    assert!(!out.exists());
    // With permission, the program is started.
    let _ = run(&experiment, &out, "hostile").output().expect("started");
    assert!(marker.exists());
}

#[test]
fn a_source_needs_permission_as_well() {
    let peer = Peer::new();
    let marker = peer.path("started");
    let command = format!("[/bin/sh, -c, {:?}]", format!("touch {}", marker.display()));
    let text = format!(
        "experiment: hostile-source\nsources: {{ own: {{ kind: process/source, with: {{ command: {command}, outputs: {{ left: image }} }} }} }}\n\
         stages: {{ look: {{ source: own, nodes: {{ edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }} }} }} }}\n"
    );
    let experiment = peer.path("hostile-source.yaml");
    std::fs::write(&experiment, text).expect("written");
    for (arguments, code) in [(&["check"][..], 0), (&["plan"], 0), (&["run"], 2), (&["check", "--data"], 2)] {
        let mut command = depthloom();
        command.arg(arguments[0]).arg(&experiment).args(&arguments[1..]).env("HOME", peer.folder.path());
        let output = command.env_remove("XDG_CONFIG_HOME").current_dir(peer.folder.path()).output().expect("started");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", output_of(&output));
        assert!(!marker.exists(), "{arguments:?} started the program");
    }
}

/// Observes every started program with `strace`.
#[test]
fn strace_sees_no_other_program_without_permission() {
    const TEST: &str = "strace_sees_no_other_program_without_permission";
    let peer = Peer::new();
    let traces =
        |command: &mut Command| command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|s| s.success());
    if !traces(Command::new("strace").args(["-f", "-e", "trace=execve", "true"])) {
        skipped(TEST, "strace is missing, or not permitted to trace");
        return;
    }
    let (experiment, _) = hostile(&peer);
    let out = peer.path("out");
    let (experiment, out) = (experiment.to_string_lossy(), out.to_string_lossy());
    let programs = |arguments: &[&str], trace: &Path| {
        let _ = std::fs::remove_file(trace);
        let mut command = Command::new("strace");
        command.args(["-f", "-e", "trace=execve,execveat", "-o"]).arg(trace).arg(depthloom().get_program());
        command.args(arguments).env("HOME", peer.folder.path()).env_remove("XDG_CONFIG_HOME");
        let _ = command.current_dir(peer.folder.path()).output().expect("strace starts");
        let text = std::fs::read_to_string(trace).expect("a trace");
        text.lines()
            .filter(|line| line.contains("execve(") || line.contains("execveat("))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let trace = peer.path("trace");
    for arguments in commands(&experiment, &out) {
        let started = programs(&arguments, &trace);
        assert_eq!(started.len(), 1, "{arguments:?} started {started:?}");
    }
    // With permission, the trace contains the program.
    assert!(programs(&["run", &experiment, "--out", &out, "--allow-exec"], &trace).len() > 1);
}

#[test]
fn the_users_configuration_permits_the_listed_files() {
    if !system_python("the_users_configuration_permits_the_listed_files") {
        return;
    }
    let peer = Peer::new();
    let experiment = peer.experiment_in_mode("works", "0..1", "version: 1");
    let config = peer.path("config/depthloom/config.yaml");
    std::fs::create_dir_all(config.parent().expect("a folder")).expect("made");
    let runs = |name: &str| {
        let mut command = depthloom();
        command.args(["run", "--no-page"]).arg(&experiment).arg("--out").arg(peer.path(name));
        command.env("XDG_CONFIG_HOME", peer.path("config")).output().expect("started")
    };
    let list = |text: &str| std::fs::write(&config, text).expect("written");
    list("allow_exec: [/elsewhere/works.yaml]\n");
    assert_eq!(runs("other").status.code(), Some(2));
    list(&format!("allow_exec: [{:?}]\n", experiment.to_string_lossy()));
    let listed = runs("listed");
    assert_eq!(listed.status.code(), Some(0), "{}", output_of(&listed));
    for (wrong, message) in
        [("allow_exec: [works.yaml]\n", "is not an absolute path"), ("allow_exe: []\n", "is not a valid configuration")]
    {
        list(wrong);
        let output = runs("wrong");
        assert_eq!(output.status.code(), Some(2));
        assert!(output_of(&output).contains(message), "{}", output_of(&output));
    }
}
