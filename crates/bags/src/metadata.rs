//! `metadata.yaml` of a bag's folder: which files it has. Topics and counts are read from the files themselves.

use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, regular_file};
use serde::Deserialize;

pub(crate) const NAME: &str = "metadata.yaml";

const MOST_BYTES: u64 = 16 << 20;

#[derive(Deserialize)]
struct File {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    #[serde(default)]
    relative_file_paths: Vec<String>,
}

/// The files that a folder's metadata names, in their order; `None` without metadata.
pub(crate) fn files(folder: &Path) -> Result<Option<Vec<PathBuf>>, Fault> {
    let path = folder.join(NAME);
    if !path.exists() {
        return Ok(None);
    }
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let bytes = regular_file::read(&path, MOST_BYTES).map_err(failed)?;
    let remedy = "name one of its files instead of the folder, or let `ros2 bag reindex` write it again";
    let read: File = serde_saphyr::from_slice(&bytes).map_err(|error| {
        Fault::new(format!("{} is not the metadata of a bag", path.display()))
            .because(first_line(&error.to_string()))
            .remedy(remedy)
    })?;
    let information = read.rosbag2_bagfile_information;
    if information.relative_file_paths.is_empty() {
        return Err(Fault::new(format!("{} names no file", path.display())).remedy(remedy));
    }
    let find = |name: &String| {
        // A completely compressed file that was unpacked later.
        let unpacked = name.strip_suffix(".zstd").map(|name| folder.join(name)).filter(|path| path.is_file());
        if let Some(unpacked) = unpacked {
            return Ok(unpacked);
        }
        let there = folder.join(name);
        // ROS 2 Foxy wrote the folder's name before the file's.
        let below = Path::new(name).file_name().map(|name| folder.join(name)).filter(|path| path.exists());
        match (there.exists(), below) {
            (true, _) => Ok(there),
            (false, Some(below)) => Ok(below),
            (false, None) => {
                let what = format!("{} names {name}, and it is not there", path.display());
                Err(Fault::new(what).remedy(
                    "copy the bag with all its files; or name one of those that are there instead of the folder",
                ))
            }
        }
    };
    let files: Vec<PathBuf> = information.relative_file_paths.iter().map(find).collect::<Result<_, _>>()?;
    if let Some(packed_file) = files.iter().find(|file| file.extension().is_some_and(|ending| ending == "zstd")) {
        return Err(packed(packed_file));
    }
    Ok(Some(files))
}

/// Without the picture of the place behind it.
fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
}

/// The whole file is compressed, so it cannot be read at random positions.
pub(crate) fn packed(path: &Path) -> Fault {
    let path = path.display();
    let remedy = format!(
        "`zstd -d {path}` unpacks it into the same folder. Bags that are compressed by chunk (MCAP) or by message need no unpacking"
    );
    Fault::new(format!("{path} is compressed as a whole")).remedy(remedy)
}
