//! Typed ports.

use std::collections::BTreeSet;
use std::sync::Mutex;

use depthloom_threads::locked;
use serde::{Deserialize, Serialize};

use crate::ValueType;

/// How often a port carries a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rate {
    /// A value for every frame.
    #[default]
    Frame,
    /// One value for a whole stage.
    Once,
}

impl Rate {
    /// The name used in plans and in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Once => "once",
        }
    }
}

/// How a node is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Contract {
    /// Frame by frame, several at once, no memory between frames.
    Pure,
    /// Frame by frame in order, then finished once.
    Ordered,
    /// Once, when its once-inputs are there.
    Once,
}

impl Contract {
    /// The name used in documentation and plans.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pure => "pure",
            Self::Ordered => "ordered",
            Self::Once => "once",
        }
    }
}

/// A named, typed input or output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// The name used in YAML.
    pub name: &'static str,
    /// What it carries.
    pub value_type: ValueType,
    /// How often.
    pub rate: Rate,
    /// An input that may stay unwired, or an output that may be absent on a frame.
    ///
    /// A node whose required input is absent on a frame does not run on it; that is not a failure.
    pub optional: bool,
    /// Of an input, the output of the same node whose recorded values it takes where the node is recomputed from a
    /// recording: what the timing of a live run decided is then repeated.
    pub repeats: Option<&'static str>,
    /// One sentence: shape, unit, meaning.
    pub doc: &'static str,
}

impl Port {
    /// A required port that carries a value for every frame.
    pub const fn frame(name: &'static str, value_type: ValueType, doc: &'static str) -> Self {
        Self { name, value_type, rate: Rate::Frame, optional: false, repeats: None, doc }
    }

    /// A required port that carries one value for the stage.
    pub const fn once(name: &'static str, value_type: ValueType, doc: &'static str) -> Self {
        Self { name, value_type, rate: Rate::Once, optional: false, repeats: None, doc }
    }

    /// The text with the lifetime of the program, for ports that a file declares. Equal texts are stored once.
    pub fn intern(text: &str) -> &'static str {
        static INTERNED: Mutex<BTreeSet<&str>> = Mutex::new(BTreeSet::new());
        let mut interned = locked(&INTERNED);
        if let Some(known) = interned.get(text) {
            return known;
        }
        let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
        interned.insert(text);
        text
    }

    /// Whether a file can be the value of this input.
    pub fn takes_file(&self) -> bool {
        self.rate == Rate::Once && self.value_type.is_artifact()
    }

    /// The same port, which repeats recorded values of this output; see [`Port::repeats`](field@Port::repeats).
    #[must_use]
    pub const fn repeats(self, output: &'static str) -> Self {
        Self { repeats: Some(output), ..self }
    }

    /// The same port, optional.
    #[must_use]
    pub const fn optional(self) -> Self {
        Self { optional: true, ..self }
    }
}
