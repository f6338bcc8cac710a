//! Sources of frames.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use super::{Context, Fault, Frame, Outputs, Port, StreamingSource};
use crate::Key;
use crate::ids::FrameIndex;

/// A frame's values and their key.
#[derive(Clone, Debug)]
pub struct SourceOutputs {
    /// The values by output port; optional ones may be absent.
    pub outputs: Outputs,
    /// The hash of the files read for this frame (calibration included), or of the parameters and the index of a
    /// synthetic one; never of the root folder, the range or the window. If it differs from [`Source::key`], the files
    /// have changed.
    pub key: Key,
}

/// A pure, seekable source: a data set, a recording, a renderer.
pub trait Source: Send + Sync {
    /// The frames selected, in the order they are to be read.
    fn frames(&self) -> &[Frame];

    /// Warnings about the data, found when it was opened, as lower-case fragments; e.g. files that match no frame.
    fn warnings(&self) -> &[String] {
        &[]
    }

    /// The key of `frames()[position]`, equal to that of [`Source::read`], without decoding anything.
    ///
    /// # Errors
    /// The file at fault, the place and the remedy.
    fn key(&self, position: FrameIndex) -> Result<Key, Fault>;

    /// Reads `frames()[position]`.
    ///
    /// # Errors
    /// The file at fault, the place and the remedy.
    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault>;

    /// The files of `frames()[position]`, each with its role (`left`, `truth`).
    fn files(&self, _position: FrameIndex) -> Vec<(&'static str, PathBuf)> {
        Vec::new()
    }

    /// As [`Source::read`], but reports everything that is wrong with the frame's files.
    ///
    /// # Errors
    /// At least one fault.
    fn examine(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Vec<Fault>> {
        self.read(position, ctx).map_err(|fault| vec![fault])
    }
}

/// What was found of a source's data, whether or not it can be opened.
pub struct Survey {
    /// The source with the frames that have all their files; `None` if they cannot be listed.
    pub source: Option<Box<dyn Source>>,
    /// Everything that is wrong.
    pub faults: Vec<Fault>,
    /// Facts to show, one per line.
    pub facts: Vec<Fact>,
}

impl Survey {
    /// Data that cannot be opened.
    pub fn failed(fault: Fault) -> Self {
        Self { source: None, faults: vec![fault], facts: Vec::new() }
    }
}

/// A neutral fact about data: a topic of a bag, with its rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    /// Its topic, one word: `topic`.
    pub label: &'static str,
    /// A lower-case fragment.
    pub text: String,
}

/// A folder or file that a source kind recognised as its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognised {
    /// What it is, in a few words: `KITTI stereo 2015, training`.
    pub what: String,
    /// The parameters that make it a source.
    pub params: Json,
    /// Optional lines of YAML among the parameters, each with its purpose after a `#`; shown as comments.
    pub alternatives: Vec<String>,
}

impl Recognised {
    /// What was recognised, and the parameters that make it a source.
    pub fn new(what: impl Into<String>, params: Json) -> Self {
        Self { what: what.into(), params, alternatives: Vec::new() }
    }
}

/// A declared output that has no value on any frame, because of the source's parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SwitchedOff {
    /// The name of the output.
    pub output: &'static str,
    /// The parameter at fault and its value: "`ground_truth` is `none`".
    pub why: String,
    /// How to switch it on: "set `ground_truth: noc`".
    pub remedy: String,
}

impl SwitchedOff {
    /// Outputs that one parameter switches off: it has the value `now`, and `then` switches them on.
    pub fn by(parameter: &str, now: &str, then: &str, outputs: &[&'static str]) -> Vec<Self> {
        let one = |output: &&'static str| Self {
            output,
            why: format!("`{parameter}` is `{now}`"),
            remedy: format!("set `{parameter}: {then}`"),
        };
        outputs.iter().map(one).collect()
    }
}

/// The declaration of a source kind.
#[derive(Clone, Debug)]
pub struct SourceDeclaration {
    /// The kind's name in YAML, `family/name`.
    pub kind: &'static str,
    /// Raised whenever equal files or parameters give different values.
    pub version: u32,
    /// One sentence.
    pub summary: &'static str,
    /// Markdown: layout, shapes, units, source.
    pub doc: &'static str,
    /// Output ports, all per frame; empty if they follow from the parameters ([`SourceKind::outputs`]).
    pub outputs: Vec<Port>,
}

/// A source kind: everything about it declared in one place.
pub trait SourceKind: 'static {
    /// Its parameters.
    type Params: Serialize + DeserializeOwned + JsonSchema;

    /// Its name, version and ports.
    fn declaration() -> SourceDeclaration;

    /// Checks what no schema can express; see [`Node::check`](super::Node::check).
    ///
    /// # Errors
    /// The parameter's name, and why.
    fn check(_params: &Self::Params) -> Result<(), (&'static str, String)> {
        Ok(())
    }

    /// The output ports of a source with these parameters, known without reading a frame. By default those of the
    /// declaration.
    ///
    /// # Errors
    /// What is missing, with its remedy.
    fn outputs(_params: &Self::Params) -> Result<Vec<Port>, Fault> {
        Ok(Self::declaration().outputs)
    }

    /// The outputs of a source with these parameters that have no value on any frame. Outputs that are missing for
    /// another reason, for example because a file does not exist, are not listed.
    fn switched_off(_params: &Self::Params) -> Vec<SwitchedOff> {
        Vec::new()
    }

    /// Opens the source and lists its frames.
    ///
    /// # Errors
    /// What is missing, with its remedy; found before any frame is admitted.
    fn open(params: Self::Params) -> Result<Box<dyn Source>, Fault>;

    /// The stream of a source whose frames arrive by themselves; `None` for a kind whose frames can be listed, which
    /// `live` reads at a rate. A kind that only streams refuses in [`SourceKind::open`].
    ///
    /// # Errors
    /// As [`SourceKind::open`].
    fn stream(_params: Self::Params) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
        Ok(None)
    }

    /// As [`SourceKind::open`], but reports everything that is wrong with the data. Nothing is decoded.
    fn survey(params: Self::Params) -> Survey {
        match Self::open(params) {
            Ok(source) => Survey { source: Some(source), faults: Vec::new(), facts: Vec::new() },
            Err(fault) => Survey::failed(fault),
        }
    }

    /// The data of this kind, damaged or not, that a folder or file holds, by its layout. Several entries for halves
    /// or sequences.
    fn recognise(_root: &Path) -> Vec<Recognised> {
        Vec::new()
    }
}
