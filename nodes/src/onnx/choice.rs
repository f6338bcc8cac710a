//! Which engine runs networks in this process: ONNX Runtime if the machine has it, otherwise tract (pure Rust).
//!
//! The first network chooses it for the whole process, unless [`VARIABLE`] names one.

use std::path::PathBuf;
use std::sync::OnceLock;

use depthloom_graphs::Fault;

use super::engine::Engine;
use super::runtime::{self, Missing};

/// The environment variable that names the engine: `onnxruntime` or `tract`; unset or empty, the first of them that is
/// there.
pub const VARIABLE: &str = "DEPTHLOOM_ONNX_ENGINE";

static FOUND: OnceLock<Result<Engine, NoEngine>> = OnceLock::new();

struct NoEngine {
    what: String,
    remedy: &'static str,
}

impl From<Missing> for NoEngine {
    fn from(missing: Missing) -> Self {
        match missing {
            Missing::Named(what) => Self { what, remedy: runtime::REMEDY_IF_NAMED },
            Missing::NoneFound(what, _) => Self { what, remedy: runtime::REMEDY },
        }
    }
}

/// The engine of this process; found once, the outcome kept.
///
/// # Errors
/// Without an engine, or without the requested one: the places searched, and how to install one.
pub fn find() -> Result<&'static Engine, Fault> {
    FOUND.get_or_init(choose).as_ref().map_err(|none| Fault::new(none.what.clone()).remedy(none.remedy))
}

/// The folders in which ONNX Runtime is looked for when `ORT_DYLIB_PATH` names none, in order; each with what led to
/// it.
#[must_use]
pub fn search_path() -> Vec<(&'static str, PathBuf)> {
    runtime::places()
}

/// The engine, once a network needed it.
#[must_use]
pub fn in_use() -> Option<&'static Engine> {
    FOUND.get().and_then(|found| found.as_ref().ok())
}

fn choose() -> Result<Engine, NoEngine> {
    let named = std::env::var_os(VARIABLE).unwrap_or_default();
    match named.to_str() {
        Some("") => runtime::load().or_else(|missing| match missing {
            // A library was named explicitly: another engine would surprise.
            named @ Missing::Named(_) => Err(named.into()),
            Missing::NoneFound(what, refused) => fallback(what, refused),
        }),
        Some("onnxruntime") => runtime::load().map_err(NoEngine::from),
        Some("tract") => tract(VARIABLE, None, Vec::new()),
        _ => Err(NoEngine {
            what: format!("{VARIABLE} is `{}`, which is not an engine", named.display()),
            remedy: "set it to onnxruntime or tract, or to nothing for the first of them that is there",
        }),
    }
}

#[cfg(feature = "tract")]
fn fallback(why: String, refused: Vec<String>) -> Result<Engine, NoEngine> {
    tract("fallback", Some(why), refused)
}

#[cfg(not(feature = "tract"))]
fn fallback(why: String, _refused: Vec<String>) -> Result<Engine, NoEngine> {
    Err(Missing::NoneFound(why, Vec::new()).into())
}

#[cfg(feature = "tract")]
fn tract(found_by: &'static str, instead_of: Option<String>, refused: Vec<String>) -> Result<Engine, NoEngine> {
    Ok(Engine::of_tract(found_by, instead_of, refused))
}

#[cfg(not(feature = "tract"))]
fn tract(_: &'static str, _: Option<String>, _: Vec<String>) -> Result<Engine, NoEngine> {
    let what = format!("{VARIABLE} selects tract, but this program was built without it");
    Err(NoEngine { what, remedy: "build it with the cargo feature `tract`, which is on by default" })
}
