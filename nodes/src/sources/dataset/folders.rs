//! Files and folders of data sets, with faults for those that are missing.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_graphs::Fault;

pub(crate) fn missing_folder(folder: &Path, remedy: &str) -> Fault {
    Fault::new(format!("there is no folder {}", folder.display())).remedy(remedy)
}

pub(crate) fn missing_file(path: &Path, remedy: &str) -> Fault {
    Fault::new(format!("there is no file {}", path.display())).remedy(remedy)
}

pub(crate) fn existing_folder(folder: &Path, remedy: &str) -> Result<(), Fault> {
    if folder.is_dir() { Ok(()) } else { Err(missing_folder(folder, remedy)) }
}

pub(crate) fn existing_file(path: PathBuf, remedy: &str) -> Result<PathBuf, Fault> {
    if path.is_file() { Ok(path) } else { Err(missing_file(&path, remedy)) }
}

/// The file of that stem with the first of the endings that exists.
pub(crate) fn with_ending(folder: &Path, stem: &str, endings: &[&str]) -> Option<PathBuf> {
    endings.iter().map(|ending| folder.join(format!("{stem}.{ending}"))).find(|path| path.is_file())
}

pub(crate) fn existing_with_ending(
    folder: &Path,
    stem: &str,
    endings: &[&str],
    remedy: &str,
) -> Result<PathBuf, Fault> {
    with_ending(folder, stem, endings)
        .ok_or_else(|| missing_file(&folder.join(format!("{stem}.{}", endings[0])), remedy))
}

/// The fault with the file or folder that it is in.
pub(crate) fn at_file(path: &Path, fault: Fault) -> Fault {
    fault.map_what(|what| format!("{}: {what}", path.display()))
}

/// Paths in a folder. `layout` is the remedy if it is missing.
pub(crate) fn entries(folder: &Path, layout: &str) -> Result<Vec<PathBuf>, Fault> {
    let failed = |error| Fault::new(format!("failed to list {}", folder.display())).because(error);
    let listing = std::fs::read_dir(folder).map_err(|error| match error.kind() {
        ErrorKind::NotFound => missing_folder(folder, layout),
        _ => failed(error),
    })?;
    listing.map(|entry| Ok(entry.map_err(failed)?.path())).collect()
}

/// Files by stem, sorted. Of two files with one stem the earlier ending wins. Hidden files are left out.
pub(crate) fn stems(folder: &Path, endings: &[&str], layout: &str) -> Result<BTreeMap<String, PathBuf>, Fault> {
    let mut found: BTreeMap<String, (usize, PathBuf)> = BTreeMap::new();
    for path in entries(folder, layout)? {
        let name = path.file_name().and_then(|name| name.to_str()).filter(|name| !name.starts_with('.'));
        let Some((stem, ending)) = name.and_then(|name| name.rsplit_once('.')) else { continue };
        let Some(rank) = endings.iter().position(|known| ending.eq_ignore_ascii_case(known)) else { continue };
        if found.get(stem).is_none_or(|(other, _)| rank < *other) {
            found.insert(stem.to_owned(), (rank, path.clone()));
        }
    }
    Ok(found.into_iter().map(|(stem, (_, path))| (stem, path)).collect())
}

/// `None` unless all names are rising numbers of at most 32 bits; time stamps have more.
pub(crate) fn numbered<'a>(stems: impl Iterator<Item = &'a str>) -> Option<Vec<u64>> {
    let numbers: Vec<u64> = stems.map(|stem| stem.parse::<u32>().ok().map(u64::from)).collect::<Option<_>>()?;
    numbers.is_sorted_by(|a, b| a < b).then_some(numbers)
}

/// Names of the folders in a folder, sorted.
pub(crate) fn folders(folder: &Path, layout: &str) -> Result<Vec<String>, Fault> {
    let paths = entries(folder, layout)?.into_iter().filter(|path| path.is_dir());
    let mut names: Vec<String> =
        paths.filter_map(|path| path.file_name().and_then(|name| name.to_str()).map(str::to_owned)).collect();
    names.sort_unstable();
    Ok(names)
}
