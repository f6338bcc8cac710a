//! Whether this experiment may start programs: with `--allow-exec`, or because the user's configuration file lists it.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_graphs::language::Loaded;
use depthloom_graphs::regular_file;
use depthloom_nodes::process::permission;
use depthloom_terminal::{CliError, ExitCode};

use crate::args::ExecArgs;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    /// Experiment files that may start the programs that they name.
    #[serde(default)]
    allow_exec: Vec<PathBuf>,
}

/// Gives permission, if there is one: to whatever the command makes ready after this. A file that is listed gives it to
/// what it holds: `loaded` must be that.
///
/// # Errors
/// If the configuration cannot be read.
pub(crate) fn decide(args: ExecArgs, experiment: Option<(&Path, &Loaded)>) -> Result<(), CliError> {
    let is_listed = || match experiment {
        Some((path, loaded)) if path.exists() => is_listed(path, loaded),
        _ => Ok(false),
    };
    if args.allow_exec || is_listed()? {
        permission::allow();
    }
    Ok(())
}

/// Where the configuration is: `$XDG_CONFIG_HOME/depthloom/config.yaml`, or in `~/.config`.
fn file() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = named("XDG_CONFIG_HOME").or_else(|| Some(named("HOME")?.join(".config")))?;
    Some(folder.join("depthloom/config.yaml"))
}

fn is_listed(experiment: &Path, loaded: &Loaded) -> Result<bool, CliError> {
    let Some(file) = file() else { return Ok(false) };
    let text = match std::fs::read_to_string(&file) {
        Ok(text) => text,
        // Without a configuration file nothing is permitted, nor with one that cannot be read: the home folder may
        // belong to another user, such as that of a service.
        Err(error)
            if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::PermissionDenied) =>
        {
            return Ok(false);
        }
        Err(error) => {
            return Err(CliError::because(ExitCode::Usage, format_args!("failed to read {}", file.display()), &error));
        }
    };
    if text.trim().is_empty() {
        return Ok(false);
    }
    let config: Config = serde_saphyr::from_str(&text).map_err(|error| {
        let first = error.to_string();
        let first = first.lines().next().unwrap_or_default().to_owned();
        CliError::usage(
            format!("{} is not a valid configuration: {first}", file.display()),
            "expected `allow_exec: [FILE, ...]`, the experiments that may start programs",
        )
    })?;
    if let Some(relative) = config.allow_exec.iter().find(|listed| listed.is_relative()) {
        let what =
            format!("`allow_exec` of {} names `{}`, which is not an absolute path", file.display(), relative.display());
        return Err(CliError::usage(what, "write the absolute path, e.g. `/home/me/experiments/mine.yaml`"));
    }
    // Files are compared, not paths: links may lead to them.
    let Ok(real) = experiment.canonicalize() else { return Ok(false) };
    let is_listed = config.allow_exec.iter().any(|listed| listed.canonicalize().is_ok_and(|listed| listed == real));
    Ok(is_listed && holds(experiment, &real, loaded))
}

/// Whether the experiment that was loaded by one path is what the files hold that its real path leads to. When it was
/// loaded, the path may have led to another file.
fn holds(experiment: &Path, real: &Path, loaded: &Loaded) -> bool {
    let (folder, real_folder) = (experiment.parent().unwrap_or(Path::new("")), real.parent().unwrap_or(Path::new("/")));
    let mut files = loaded.read.iter().zip(&loaded.plan.written).enumerate();
    files.all(|(index, (path, (_, text)))| {
        let path = match path.strip_prefix(folder) {
            _ if index == 0 => real.to_owned(),
            Ok(below) => real_folder.join(below),
            Err(_) => path.clone(),
        };
        let now = regular_file::read(&path, text.len() as u64 + 3).unwrap_or_default();
        now.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&now) == text.as_bytes()
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use depthloom_graphs::language::{Loaded, Options, load};

    use super::holds;

    fn loaded(path: &Path) -> Loaded {
        load(path, &crate::registry(), &Options::default()).unwrap()
    }

    #[test]
    fn permission_is_of_what_was_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = |seed: u32| {
            let source = format!("{{ kind: synthetic/road, with: {{ seed: {seed} }} }}");
            format!(
                "sources: {{ street: {source} }}\nstages: {{ look: {{ source: street, nodes: {{ edges: {{ kind: confidence/edges, inputs: {{ image: source/left }} }} }} }} }}\n"
            )
        };
        let main = "experiment: look\nextends: base.yaml\n";
        for (folder, seed) in [("mine", 1), ("other", 2)] {
            std::fs::create_dir(at(folder)).unwrap();
            std::fs::write(at(folder).join("look.yaml"), main).unwrap();
            std::fs::write(at(folder).join("base.yaml"), text(seed)).unwrap();
        }
        let mine = at("mine/look.yaml");
        assert!(holds(&mine, &mine, &loaded(&mine)));
        // Loaded through a path that led elsewhere then: the same main file, another base.
        let other = at("other/look.yaml");
        assert!(!holds(&other, &mine, &loaded(&other)));
        let before = loaded(&mine);
        std::fs::write(at("mine/base.yaml"), text(3)).unwrap();
        assert!(!holds(&mine, &mine, &before));
    }
}
