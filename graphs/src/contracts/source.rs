//! Sources: where frames come from.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use super::{Context, Fault, Frame, Outputs, Port};
use crate::Key;
use crate::ids::FrameIndex;

/// A frame's values, and the key of what they were made from.
#[derive(Clone, Debug)]
pub struct SourceOutputs {
    /// The values by output port; optional ones may be absent.
    pub outputs: Outputs,
    /// The content hash of the files read for this frame (calibration included), or of the recipe and index of a made one:
    /// never of the root folder, the range or the window. Of what was read: if [`Source::key`] named another, the files changed meanwhile.
    pub key: Key,
}

/// A pure, seekable source: a data set, a recording, a renderer.
pub trait Source: Send + Sync {
    /// The frames selected, in the order they are to be read.
    fn frames(&self) -> &[Frame];

    /// What there is to say of the data as they were found at opening that is no failure, as lower-case fragments: files that belong to
    /// no frame, say.
    fn warnings(&self) -> &[String] {
        &[]
    }

    /// The key of `frames()[position]`: what [`Source::read`] gives with the values, come by without decoding anything, so that
    /// what was made from a frame can be looked up before the frame is read.
    ///
    /// # Errors
    /// The file at fault, the place and the remedy. What is no image may still have a key.
    fn key(&self, position: FrameIndex) -> Result<Key, Fault>;

    /// Reads `frames()[position]`.
    ///
    /// # Errors
    /// The file at fault, the place and the remedy.
    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault>;

    /// The files that `frames()[position]` is made of, each with the part it plays (`left`, `truth`); none where it is made of no file of its own.
    fn files(&self, _position: FrameIndex) -> Vec<(&'static str, PathBuf)> {
        Vec::new()
    }

    /// As [`Source::read`], for whoever wants to know all that is wrong with the frame's files, and not the first of it.
    ///
    /// # Errors
    /// At least one fault.
    fn examine(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Vec<Fault>> {
        self.read(position, ctx).map_err(|fault| vec![fault])
    }
}

/// What was found of a source's data, whether or not it can be opened.
pub struct Survey {
    /// The source over the frames that have all their files; `None` if not even that can be listed.
    pub source: Option<Box<dyn Source>>,
    /// Everything that is wrong.
    pub faults: Vec<Fault>,
    /// What there is to show of the data beside their frames, a line each.
    pub facts: Vec<Fact>,
}

impl Survey {
    /// That the data cannot be opened.
    #[must_use]
    pub fn failed(fault: Fault) -> Self {
        Self { source: None, faults: vec![fault], facts: Vec::new() }
    }
}

/// Something to show of data that is neither right nor wrong: a topic of a bag, with its rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    /// What it is about, a word: `topic`.
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
    /// Lines of YAML that a person may want among the parameters, each with what it is for behind a `#`: they are shown as comments.
    pub alternatives: Vec<String>,
}

impl Recognised {
    /// What was recognised, and the parameters that make it a source.
    #[must_use]
    pub fn new(what: impl Into<String>, params: Json) -> Self {
        Self { what: what.into(), params, alternatives: Vec::new() }
    }
}

/// What a source kind says of itself.
#[derive(Clone, Debug)]
pub struct SourceDeclaration {
    /// The kind's name in YAML, `family/name`.
    pub kind: &'static str,
    /// Raised whenever the same files or parameters give other values than before.
    pub version: u32,
    /// One sentence.
    pub summary: &'static str,
    /// Markdown: layout, shapes, units, source.
    pub doc: &'static str,
    /// Output ports, all per frame; none if they follow from the parameters alone ([`SourceKind::outputs`]).
    pub outputs: Vec<Port>,
}

/// A source kind: everything about it declared in one place.
pub trait SourceKind: 'static {
    /// Its parameters.
    type Params: Serialize + DeserializeOwned + JsonSchema;

    /// Its name, version and ports.
    fn declaration() -> SourceDeclaration;

    /// What no schema can say; see [`Node::check`](super::Node::check).
    ///
    /// # Errors
    /// The parameter at fault, and why.
    fn check(_params: &Self::Params) -> Result<(), (&'static str, String)> {
        Ok(())
    }

    /// The output ports that a source with these parameters has, where a file declares them; asked for when an experiment is checked, so that
    /// no frame is read for it. By default those of the declaration.
    ///
    /// # Errors
    /// What is missing, with its remedy.
    fn outputs(_params: &Self::Params) -> Result<Vec<Port>, Fault> {
        Ok(Self::declaration().outputs)
    }

    /// Opens the source and lists its frames.
    ///
    /// # Errors
    /// What is missing, with its remedy; found before any frame is admitted.
    fn open(params: Self::Params) -> Result<Box<dyn Source>, Fault>;

    /// As [`SourceKind::open`], for whoever wants to know everything that is wrong with the data in one pass; nothing is decoded.
    fn survey(params: Self::Params) -> Survey {
        match Self::open(params) {
            Ok(source) => Survey { source: Some(source), faults: Vec::new(), facts: Vec::new() },
            Err(fault) => Survey::failed(fault),
        }
    }

    /// What of this kind a folder (or a file) holds, by its layout: nothing is decoded. Several where there are halves or sequences. A damaged file of
    /// this kind is recognised too: [`SourceKind::survey`] reports the damage.
    fn recognise(_root: &Path) -> Vec<Recognised> {
        Vec::new()
    }
}
