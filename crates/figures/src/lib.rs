//! Plots as SVG, PNG and PDF, and the page of a run, from plain series, values and a recording's frames.
//!
//! A figure is a [`Sheet`] of [`Panel`]s, whose [`Item`]s are in the units of their axes. It becomes a [`Drawing`] on a
//! page of a stated size, which is written as SVG, PNG or PDF. The [`page`] is one HTML file. The crate `analysis`
//! decides what is drawn.

mod colours;
mod comparison;
mod curves;
mod drawing;
pub mod page;
mod picture;
mod plot;
mod scored_map;
mod spread;
mod xml;

pub use colours::{BLUE, EstimateKey, Look, OTHERS, RED, colour, looks, tint};
pub use comparison::{LINE_PT, Layout, Place, compared_curves, distinct};
pub use curves::learning_curves;
pub use drawing::{Anchor, BLACK, Colour, Drawing, Fill, Picture, Stroke};
pub use picture::{coloured, reduced};
pub use plot::{Axis, Bar, DIVERGING, Entry, Item, Panel, SEQUENTIAL, Scale, Sheet, Size, Swatch, readable_on};
pub use scored_map::as_scored;
pub use spread::{Bin, Spread, SpreadFigure, Step, bands, lines, thin_entry};
pub use xml::escaped;
