//! Ways of a matcher to the same bits.

use super::Level;

/// An implementation of a matcher. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// The plain scalar twin, on one thread.
    Plain,
    /// The fast implementation, compiled for a level.
    Fast(Level),
}

impl Path {
    /// The implementations this machine can run, fastest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let levels = Level::available().into_iter().rev();
        levels.map(Self::Fast).chain([Self::Plain]).collect()
    }

    /// The fastest that `DEPTHLOOM_SIMD` allows ([`Level::best`]).
    #[must_use]
    pub fn best() -> Self {
        Self::Fast(Level::best())
    }

    /// `plain`, or its level's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Fast(level) => level.name(),
        }
    }

    /// The implementation of a name, if this machine has it; `best` is [`Path::best`].
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        if name == "plain" { Some(Self::Plain) } else { Level::named(name).map(Self::Fast) }
    }
}
