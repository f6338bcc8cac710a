//! The drives of KITTI's raw data: folders of a date, and split files that name frames of drives.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, regular_file};

use crate::sources::dataset::folders::{existing_folder, folders, numbered};

pub(super) const IMAGES: [&str; 3] = ["png", "jpg", "jpeg"];

const SPLIT: &str = "a line is `2011_09_26/2011_09_26_drive_0002_sync 0000000069 l`, or `2011_09_26/2011_09_26_drive_0002_sync/image_02/data/0000000069.png`";

/// Bytes of a split file.
const MOST_BYTES: u64 = 16 << 20;

pub(super) struct Drive {
    pub name: String,
    /// The folder of its date, with the calibration.
    pub date: PathBuf,
    pub folder: PathBuf,
}

pub(super) fn is_drive(name: &str) -> bool {
    name.contains("_drive_") && name.ends_with("_sync")
}

pub(super) fn find(root: &Path, layout: &str) -> Result<BTreeMap<String, Drive>, Fault> {
    existing_folder(root, layout)?;
    let within = folders(root, layout)?;
    let is_date = root.join("calib_cam_to_cam.txt").is_file() || within.iter().any(|name| is_drive(name));
    let dates = match is_date {
        true => vec![root.to_owned()],
        false => within.into_iter().map(|date| root.join(date)).collect(),
    };
    let mut drives = BTreeMap::new();
    for date in dates {
        for name in folders(&date, layout)?.into_iter().filter(|name| is_drive(name)) {
            drives.insert(name.clone(), Drive { folder: date.join(&name), date: date.clone(), name });
        }
    }
    match drives.is_empty() {
        true => Err(Fault::new(format!("{} holds no drive", root.display())).remedy(layout)),
        false => Ok(drives),
    }
}

/// With or without `_sync`, or a path that ends in it.
pub(super) fn named<'a, T>(drives: &'a BTreeMap<String, T>, name: &str) -> Result<(&'a String, &'a T), Fault> {
    let name = name.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
    let full = if name.ends_with("_sync") { name.to_owned() } else { format!("{name}_sync") };
    drives.get_key_value(&full).ok_or_else(|| {
        let there = drives.keys().take(4).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = drives.len().saturating_sub(4);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Fault::new(format!("there is no drive {name}")).remedy(format!("there are {there}{more}"))
    })
}

/// Index and id of each frame, given as drive and stem: KITTI's own numbers within one drive, otherwise a count.
pub(super) fn ids<'a>(frames: impl Iterator<Item = (&'a str, &'a str)> + Clone, one_drive: bool) -> Vec<(u64, String)> {
    let numbers = if one_drive { numbered(frames.clone().map(|(_, stem)| stem)) } else { None };
    let number = |count: usize| numbers.as_ref().map_or(count as u64, |numbers| numbers[count]);
    frames.enumerate().map(|(count, (drive, stem))| (number(count), format!("{drive}_{stem}"))).collect()
}

/// A drive, and the stem of a frame in it.
pub(super) type DriveFrame<'a> = (&'a Drive, String);

/// Each pair once, in the file's order, and the number of lines that repeat one.
pub(super) fn frames_of_split<'a>(
    path: &Path,
    drives: &'a BTreeMap<String, Drive>,
) -> Result<(Vec<DriveFrame<'a>>, usize), Fault> {
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let bytes = regular_file::read(path, MOST_BYTES).map_err(failed)?;
    let (mut frames, mut seen, mut repeated) = (Vec::new(), HashSet::new(), 0);
    for (index, line) in String::from_utf8_lossy(&bytes).lines().enumerate() {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let place = format!("{}:{}", path.display(), index + 1);
        let mut words = line.split_whitespace();
        let first = words.next().unwrap_or_default();
        let named = first.split('/').find(|part| part.contains("_drive_"));
        let is_image = first.rsplit_once('.').is_some_and(|(_, ending)| IMAGES.contains(&ending));
        let number =
            if is_image { first.rsplit('/').next().and_then(|name| name.split('.').next()) } else { words.next() };
        let number = number.and_then(|number| number.parse::<u64>().ok());
        let (Some(named), Some(number)) = (named, number) else {
            return Err(Fault::new(format!("{place}: `{line}` names no frame")).remedy(SPLIT));
        };
        let (_, drive) =
            self::named(drives, named).map_err(|fault| fault.map_what(|what| format!("{place}: {what}")))?;
        if seen.insert((drive.name.as_str(), number)) {
            frames.push((drive, format!("{number:010}")));
        } else {
            repeated += 1;
        }
    }
    if frames.is_empty() {
        return Err(Fault::new(format!("{} names no frame", path.display())).remedy(SPLIT));
    }
    Ok((frames, repeated))
}
