//! A run's folder: written as `<out>.partial`, renamed when whole.

use std::fs;
use std::path::{Path, PathBuf};

use crate::exit::{Exit, Stop};

/// The folder a run writes to, not yet under its final name.
pub struct RunFolder {
    /// Where files are written: `<out>.partial`.
    pub partial: PathBuf,
    /// The final name.
    pub out: PathBuf,
}

impl RunFolder {
    /// Creates `<out>.partial`.
    ///
    /// A folder that exists under either name is somebody's results: it is only replaced when asked for.
    pub fn create(out: &Path, overwrite: bool) -> Result<Self, Stop> {
        let name = out
            .file_name()
            .ok_or_else(|| Stop::new(Exit::Before, format!("the output folder `{}` has no name", out.display())))?;
        let mut partial_name = name.to_owned();
        partial_name.push(".partial");
        let folder = Self { partial: out.with_file_name(partial_name), out: out.to_owned() };
        for path in [&folder.out, &folder.partial] {
            if !path.exists() {
                continue;
            }
            if !overwrite {
                return Err(Stop::new(Exit::Before, format!("{} exists already", path.display()))
                    .remedy("choose another --out, or replace it with --overwrite"));
            }
            if path == &folder.partial {
                remove(path)?;
            }
        }
        fs::create_dir_all(&folder.partial).map_err(|error| {
            Stop::because(Exit::Before, format_args!("failed to create {}", folder.partial.display()), &error)
        })?;
        Ok(folder)
    }

    /// A file in the folder, as long as it is partial.
    pub fn file(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Writes a small file.
    pub fn write(&self, name: &str, content: &str) -> Result<(), Stop> {
        let path = self.file(name);
        fs::write(&path, content)
            .map_err(|error| Stop::because(Exit::Engine, format_args!("failed to write {}", path.display()), &error))
    }

    /// Gives the folder its final name.
    pub fn finish(self) -> Result<PathBuf, Stop> {
        if self.out.exists() {
            remove(&self.out)?;
        }
        fs::rename(&self.partial, &self.out).map_err(|error| {
            let intent = format!("failed to rename {} to {}", self.partial.display(), self.out.display());
            Stop::because(Exit::Engine, intent, &error)
        })?;
        Ok(self.out)
    }
}

fn remove(path: &Path) -> Result<(), Stop> {
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    removed.map_err(|error| Stop::because(Exit::Engine, format_args!("failed to remove {}", path.display()), &error))
}
