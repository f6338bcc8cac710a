//! Changes the document: by `--set`, by `variants` and by `matrix`. Makes a document for every variant.

pub(crate) mod apply;
pub(crate) mod matrix;
pub(crate) mod outlasted;
pub(crate) mod overrides;
pub(crate) mod parameter;
pub(crate) mod path;
pub(crate) mod variant;
pub(crate) mod variants;
