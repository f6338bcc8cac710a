//! Plots as SVG, PNG and PDF, and the page of a run, from plain series, values and a recording's frames.
//!
//! A figure is a [`Sheet`] of [`Panel`]s, whose [`Item`]s are in the units of their axes. It becomes a [`Drawing`] on a page of a stated size, which
//! is written as SVG, PNG or PDF. The [`page`] is one HTML file. What is drawn is decided by the crate `analysis`.

#![expect(missing_docs, reason = "the interface becomes smaller before it is described")]

mod colours;
mod curves;
mod drawing;
pub mod page;
mod picture;
mod places;
mod plot;
mod scored_map;
mod spread;
mod xml;

pub use colours::{BLUE, OTHERS, RED, colour as colour_of};
pub use curves::learning_curves;
pub use drawing::{
    Anchor, BLACK, Colour, Drawing, Fill, Mark, POINTS_PER_INCH, Picture, Stroke, Text, ascent, colour, width,
};
pub use picture::{coloured, reduced};
pub use places::{Layout, Place, dashes, panels, shade};
pub use plot::{
    Axis, Bar, DIVERGING, Entry, HEADING_PT, Item, LABEL_PT, Panel, SEQUENTIAL, Scale, Sheet, Size, Swatch, TICK_PT,
    bars_room, draw_bars, fitting, readable_on, ticks_at,
};
pub use scored_map::as_scored;
pub use spread::{Bin, Spread, SpreadFigure, added};
pub use xml::escaped;
