//! Checks a library before the crate `ort` loads it: `ort` loads one library per process, and calls unwritten memory
//! after
//! it has refused one.
#![expect(
    unsafe_code,
    reason = "a library's functions can only be called on its word that they are what their names say"
)]

use std::error::Error as _;
use std::ffi::CStr;
use std::mem::ManuallyDrop;
use std::path::Path;

use libloading::Library;
use ort::MINOR_VERSION;
use ort::sys::OrtApiBase;

type GetApiBase = unsafe extern "C" fn() -> *const OrtApiBase;

/// Loads a library and checks that its version has the interface that this program needs. The error starts with the
/// path.
pub(crate) fn check(path: &Path) -> Result<(), String> {
    let refused = |why: String| format!("{} {why}", path.display());
    // SAFETY: loading runs a library's own start-up code. Only files named as ONNX Runtime's are opened, from where the
    // person
    // said, the system's folders or the environment the person activated: code of theirs.
    let library = unsafe { Library::new(path) }.map_err(|error| {
        // The source has the loader's message.
        let why = error.source().map_or_else(|| error.to_string(), ToString::to_string);
        refused(format!("does not load ({why})"))
    })?;
    // Never unloaded: a library may have registered code that runs at the end of the process.
    let library = ManuallyDrop::new(library);
    // SAFETY: ONNX Runtime's header declares this function with this type, and no other library has one of its name.
    let entry = unsafe { library.get::<GetApiBase>(b"OrtGetApiBase\0") };
    let entry = entry.map_err(|_| refused("exports no OrtGetApiBase: it is not an ONNX Runtime".to_owned()))?;
    // SAFETY: as its header says, the function takes no arguments and returns null or a table with static lifetime.
    let base = unsafe { entry().as_ref() };
    let base = base.ok_or_else(|| refused("returns no table of interfaces".to_owned()))?;
    // SAFETY: as its header says, the table's functions may be called at any time; the text has static lifetime.
    let version = unsafe { (base.GetVersionString)() };
    if version.is_null() {
        return Err(refused("does not report its version".to_owned()));
    }
    // SAFETY: it is not null, and its header promises a text that ends with a zero.
    let version = unsafe { CStr::from_ptr(version) }.to_string_lossy();
    let minor = version.split('.').nth(1).and_then(|minor| minor.parse::<u32>().ok()).unwrap_or(0);
    let needed = format!("1.{MINOR_VERSION} or newer is needed");
    if minor < MINOR_VERSION {
        return Err(refused(format!("is ONNX Runtime {version}; {needed}")));
    }
    // SAFETY: as for the version; an interface that it has not is null.
    let api = unsafe { (base.GetApi)(ort::sys::ORT_API_VERSION) };
    if api.is_null() {
        return Err(refused(format!(
            "reports to be ONNX Runtime {version}, without the interface of 1.{MINOR_VERSION}"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn a_file_that_is_not_a_library_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("libonnxruntime.so");
        std::fs::write(&path, "<html>404</html>".repeat(100)).unwrap();
        let error = check(&path).unwrap_err();
        assert!(error.contains("libonnxruntime.so does not load"), "{error}");
        assert!(!cfg!(target_os = "linux") || error.contains("invalid ELF header"), "{error}");
    }
}
