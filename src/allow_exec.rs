//! Whether this experiment may start programs: because the person says so now, or said so of this file in a configuration of their own.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_nodes::process::permission;

use crate::args::ExecArgs;
use crate::exit::{Exit, Stop};

/// A person's own configuration.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    /// Experiment files that may start the programs that they name.
    #[serde(default)]
    allow_exec: Vec<PathBuf>,
}

/// Gives permission, if there is one: to whatever the command makes ready after this.
///
/// # Errors
/// If the configuration cannot be read.
pub fn decide(args: ExecArgs, experiment: Option<&Path>) -> Result<(), Stop> {
    if args.allow_exec || experiment.is_some_and(Path::exists) && is_listed(experiment)? {
        permission::give();
    }
    Ok(())
}

/// Where the configuration is: `$XDG_CONFIG_HOME/depthloom/config.yaml`, or in `~/.config`.
fn file() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = named("XDG_CONFIG_HOME").or_else(|| Some(named("HOME")?.join(".config")))?;
    Some(folder.join("depthloom/config.yaml"))
}

fn is_listed(experiment: Option<&Path>) -> Result<bool, Stop> {
    let (Some(experiment), Some(file)) = (experiment, file()) else { return Ok(false) };
    let text = match std::fs::read_to_string(&file) {
        Ok(text) => text,
        // Without one nothing is permitted. Nor with one that is not for us: the home folder of whoever started this, as of a service's user.
        Err(error)
            if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::PermissionDenied) =>
        {
            return Ok(false);
        }
        Err(error) => {
            return Err(Stop::because(Exit::Before, format_args!("failed to read {}", file.display()), &error));
        }
    };
    if text.trim().is_empty() {
        return Ok(false);
    }
    let config: Config = serde_saphyr::from_str(&text).map_err(|error| {
        let first = error.to_string();
        let first = first.lines().next().unwrap_or_default().to_owned();
        Stop::new(Exit::Before, format!("{} is no configuration: {first}", file.display()))
            .remedy("it holds `allow_exec: [FILE, ...]`: the experiments that may start programs")
    })?;
    if let Some(relative) = config.allow_exec.iter().find(|listed| listed.is_relative()) {
        let what = format!("`allow_exec` of {} names `{}`, which is no whole path", file.display(), relative.display());
        return Err(Stop::new(Exit::Before, what).remedy("write it from the root, `/home/me/experiments/mine.yaml`"));
    }
    // Files, whatever leads to them; one that is not there is nobody's.
    let Ok(experiment) = experiment.canonicalize() else { return Ok(false) };
    Ok(config.allow_exec.iter().any(|listed| listed.canonicalize().is_ok_and(|listed| listed == experiment)))
}
