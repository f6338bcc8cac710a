//! An engine that runs networks: ONNX Runtime or tract.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Mutex;

use depthloom_graphs::{Fault, Key};
use depthloom_kernels::simd::Level;
use depthloom_threads::locked;
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};

use super::provider::Provider;
use super::session::EngineSession;

/// An engine, ready for sessions.
#[derive(Debug)]
pub struct Engine {
    /// `onnxruntime` or `tract`.
    pub name: &'static str,
    /// Its version, as far as its build tells: `1.31.1`.
    pub version: String,
    /// Its build information: branch, commit, compiler flags.
    pub build: &'static str,
    /// The library it was loaded from; tract is part of the program.
    pub library: Option<PathBuf>,
    /// What led to it: `ORT_DYLIB_PATH`, `LD_LIBRARY_PATH`, `system`, `VIRTUAL_ENV`, ...; `fallback` where there was no
    /// other.
    pub found_by: &'static str,
    /// Of a fallback: why there is no ONNX Runtime.
    pub instead_of: Option<String>,
    /// Libraries that bear ONNX Runtime's name where it was looked for, and why each cannot be used.
    pub refused: Vec<String>,
    /// `None` for tract.
    environment: Option<Environment>,
    used: Mutex<BTreeSet<Provider>>,
}

impl Engine {
    fn new(
        name: &'static str,
        version: String,
        build: &'static str,
        found_by: &'static str,
        refused: Vec<String>,
    ) -> Self {
        let (library, instead_of, environment, used) = (None, None, None, Mutex::default());
        Self { name, version, build, library, found_by, instead_of, refused, environment, used }
    }

    pub(crate) fn of_library(
        path: PathBuf,
        found_by: &'static str,
        version: String,
        environment: Environment,
        refused: Vec<String>,
    ) -> Self {
        let engine = Self::new("onnxruntime", version, ort::info(), found_by, refused);
        Self { library: Some(path), environment: Some(environment), ..engine }
    }

    #[cfg(feature = "tract")]
    pub(crate) fn of_tract(found_by: &'static str, instead_of: Option<String>, refused: Vec<String>) -> Self {
        let version = super::tract::VERSION.to_owned();
        Self { instead_of, ..Self::new("tract", version, "pure Rust", found_by, refused) }
    }

    /// Its name and version for people: `ONNX Runtime 1.31.1`.
    #[must_use]
    pub fn title(&self) -> String {
        let name = if self.is_tract() { "tract" } else { "ONNX Runtime" };
        format!("{name} {}", self.version)
    }

    /// Names engine, build, provider and the processor's instruction sets, by which engines choose how they compute:
    /// what besides model and image decides a network's output.
    #[must_use]
    pub fn fingerprint(&self, provider: Provider) -> Key {
        let levels = Level::available();
        let key = Key::build("engine").text(self.name).text(&self.version).text(self.build).text(provider.name());
        levels.iter().fold(key.number(levels.len() as u64), |key, level| key.text(level.name())).finish()
    }

    /// The providers it offers, by name.
    #[must_use]
    pub fn providers(&self) -> Vec<Provider> {
        let offered = |provider: &Provider| match provider {
            Provider::Cpu => true,
            // Only ONNX Runtime was requested.
            other => !self.is_tract() && other.is_in_library().unwrap_or(false),
        };
        Provider::ALL.into_iter().filter(offered).collect()
    }

    /// The providers that sessions of this process were made on.
    #[must_use]
    pub fn used(&self) -> Vec<Provider> {
        locked(&self.used).iter().copied().collect()
    }

    /// Whether it offers a provider.
    ///
    /// # Errors
    /// If it does not: its providers, and how to install others.
    pub fn offers(&self, provider: Provider) -> Result<(), Fault> {
        let offered = self.providers();
        if offered.contains(&provider) {
            return Ok(());
        }
        let names: Vec<&str> = offered.iter().map(|provider| provider.name()).collect();
        let at = self.library.as_ref().map(|path| format!(" at {}", path.display())).unwrap_or_default();
        let (title, requested) = (self.title(), provider.name());
        let remedy = if self.is_tract() { "only ONNX Runtime has it: use `provider: cpu`, or " } else { "" };
        Err(Fault::new(format!("{title}{at} has no provider `{requested}`; it has {}", names.join(", ")))
            .remedy(format!("{remedy}{}", provider.remedy())))
    }

    /// Loads the libraries that a provider needs, so that missing ones are reported before any frame.
    ///
    /// # Errors
    /// If the engine lacks this provider, or the machine lacks its libraries.
    pub fn prepare(&self, provider: Provider) -> Result<(), Fault> {
        self.offers(provider)?;
        self.environment.as_ref().map_or(Ok(()), |environment| self.builder(environment, provider, 1).map(|_| ()))
    }

    pub(crate) fn session(&self, model: &[u8], provider: Provider, threads: usize) -> Result<EngineSession, Fault> {
        let session = match &self.environment {
            Some(environment) => {
                let mut builder = self.builder(environment, provider, threads)?;
                builder
                    .commit_from_memory(model)
                    .map(|session| EngineSession::OnnxRuntime(Box::new(session)))
                    .map_err(|error| self.cannot_load(model, error))?
            }
            None => self.tract_session(model)?,
        };
        locked(&self.used).insert(provider);
        Ok(session)
    }

    #[cfg(feature = "tract")]
    fn tract_session(&self, model: &[u8]) -> Result<EngineSession, Fault> {
        let session = super::tract::TractSession::read(model);
        session.map(EngineSession::Tract).map_err(|what| self.cannot_load(model, what))
    }

    #[cfg(not(feature = "tract"))]
    fn tract_session(&self, model: &[u8]) -> Result<EngineSession, Fault> {
        Err(self.cannot_load(model, "this program was built without tract"))
    }

    pub(crate) fn cannot_load(
        &self,
        model: &[u8],
        error: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Fault {
        let remedy = "`model` expects an ONNX file, or the output of a learning stage";
        let of_tract = "; tract lacks some operators that ONNX Runtime has (`pip install onnxruntime`)";
        Fault::new(format!("the {} bytes of the model cannot be loaded by {}", model.len(), self.title()))
            .because(error)
            .remedy(format!("{remedy}{}", if self.is_tract() { of_tract } else { "" }))
    }

    fn builder(&self, environment: &Environment, provider: Provider, threads: usize) -> Result<SessionBuilder, Fault> {
        let options = || -> ort::Result<SessionBuilder> {
            // Threads of a session wait for work by spinning, which is worth it within a run; between runs the cores
            // are the runner's workers'.
            Ok(Session::builder(environment)?
                .with_optimization_level(GraphOptimizationLevel::All)?
                .with_intra_threads(threads)?
                .with_inter_threads(1)?
                .with_intra_op_spinning(threads > 1)?
                .with_config_entry("session.force_spinning_stop", "1")?
                .with_deterministic_compute(true)?)
        };
        let builder =
            options().map_err(|error| Fault::new(format!("{} refused a session", self.title())).because(error))?;
        provider.register(builder, environment, threads).map_err(|error| {
            let (title, requested) = (self.title(), provider.name());
            Fault::new(format!("{title} could not start its provider `{requested}`")).because(error).remedy(
                "check that its driver and libraries are installed and found by the loader, or use `provider: cpu`",
            )
        })
    }

    fn is_tract(&self) -> bool {
        self.environment.is_none()
    }
}
