//! Sources: where frames come from.

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Context, Fault, Frame, Outputs, Port};
use crate::Key;

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
    fn key(&self, position: usize) -> Result<Key, Fault>;

    /// Reads `frames()[position]`.
    ///
    /// # Errors
    /// The file at fault, the place and the remedy.
    fn read(&self, position: usize, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault>;
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
}
