//! NumPy's NPZ: a ZIP archive of NPY files.

use std::io::{Cursor, Read as _};
use std::path::Path;

use depthloom_graphs::Fault;
use zip::ZipArchive;

/// Bytes of an array, decompressed.
const MOST_BYTES: u64 = 4 << 30;

pub(crate) fn is_archive(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

/// The NPY file of the array `name`, or of the only one.
pub(crate) fn member(path: &Path, bytes: &[u8], name: Option<&str>) -> Result<Vec<u8>, Fault> {
    let damaged = |error: &dyn std::fmt::Display| {
        Fault::new(format!("failed to read {} as an NPZ file", path.display()))
            .because(error.to_string())
            .remedy("the file is incomplete or damaged: copy or download it again")
    };
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
    let names: Result<Vec<_>, _> = archive.file_names().map(|name| name.map(std::borrow::Cow::into_owned)).collect();
    let names = names.map_err(|error| damaged(&error))?;
    let arrays: Vec<&str> = names.iter().map(|name| name.strip_suffix(".npy").unwrap_or(name)).collect();
    let wrong = |what: String, remedy: &str| Fault::new(format!("{} {what}", path.display())).remedy(remedy);
    let at = match (name, &arrays[..]) {
        (None, [_]) => 0,
        (None, []) => return Err(wrong("has no arrays".to_owned(), "write it with np.savez(path, depth)")),
        (None, several) => {
            let what = format!("has several arrays: {}", several.join(", "));
            return Err(wrong(what, "name one of them by `array`"));
        }
        (Some(name), _) => arrays
            .iter()
            .position(|array| *array == name)
            .ok_or_else(|| wrong(format!("has no array `{name}`; it has {}", arrays.join(", ")), "correct `array`"))?,
    };
    let file = archive.by_index(at).map_err(|error| damaged(&error))?;
    let mut array = Vec::new();
    // A damaged archive may state any size: memory grows with what is there.
    let read = file.take(MOST_BYTES + 1).read_to_end(&mut array).map_err(|error| damaged(&error))?;
    if read as u64 > MOST_BYTES {
        return Err(wrong(
            format!("has an array of more than {} GiB", MOST_BYTES >> 30),
            "write one file per frame, or an NPY file, of which only one map at a time is read",
        ));
    }
    Ok(array)
}
