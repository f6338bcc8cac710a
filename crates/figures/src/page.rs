//! `report.html`: a run on one page, in one file, for a browser without a network.
//!
//! The page is what [`page.html`](page/page.html) says, with its style and scripts in it, a JSON object of all numbers,
//! the [plan](plan_drawing) as a picture, and behind these the [pictures](Pictures) of frames, each in an element of
//! its own that is decoded when it is looked at. Whatever comes from an experiment is text to the page, never markup:
//! JSON contains no `<`, and text in markup is escaped.

mod colour_range;
mod frame_pictures;
mod maps;
mod pictures;
mod plan;
mod series;
mod sizes;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use depthloom_recording::RecordingError;
use depthloom_threads::Caught;
use serde_json::Value as Json;

pub use self::colour_range::ColourRange;
pub use self::maps::{Scale, Steps};
pub use self::pictures::Pictures;
pub use self::plan::plan_drawing;
pub use self::series::{Layer, Role, Series, evenly};
use crate::xml::escaped;

/// The beginning of a page, by which commands recognise a file that they may replace.
pub const PAGE_MARK: &str = "<!doctype html>\n<!-- a report of depthloom -->";

const HTML: &str = include_str!("page/page.html");
const STYLE: [&str; 2] = [include_str!("page/uPlot.min.css"), include_str!("page/page.css")];
/// uPlot (MIT, © Leon Sorokin, github.com/leeoniya/uPlot, from the npm package `uplot` 1.6.32), then ours; its licence
/// goes with it.
const PLOTS: &str = include_str!("page/uPlot.iife.min.js");
const PLOTS_LICENCE: &str = include_str!("page/uPlot.LICENSE");
const SCRIPTS: [&str; 5] = [
    include_str!("page/common.js"),
    include_str!("page/table.js"),
    include_str!("page/figures.js"),
    include_str!("page/frames.js"),
    include_str!("page/page.js"),
];

/// Why a page could not be written.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// `stop` returned true.
    #[error("stopped before it was finished")]
    Stopped,
    /// The recording cannot be read.
    #[error("failed to read the recording")]
    Recording(#[from] RecordingError),
    /// A value cannot be shown.
    #[error("{0}")]
    Content(String),
    /// A temporary file cannot be written.
    #[error("failed to write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        #[source]
        source: io::Error,
    },
    /// An error in the program.
    #[error("{0}")]
    Panicked(String),
}

impl PageError {
    fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source }
    }
}

impl From<Caught> for PageError {
    fn from(Caught(what): Caught) -> Self {
        Self::Panicked(what)
    }
}

/// Writes a page: its title, the SVG of its [plan](plan_drawing), what its scripts read, and its pictures. Returns how
/// many bytes it has.
///
/// # Errors
/// If it cannot be written.
pub fn write_page(
    out: &mut impl Write,
    title: &str,
    plan: &str,
    data: &Json,
    pictures: &mut Pictures,
) -> io::Result<u64> {
    let mut out = Counted { out, bytes: 0 };
    let mut rest = HTML;
    while let Some((before, behind)) = rest.split_once("{{") {
        let (what, behind) = behind.split_once("}}").unwrap_or((behind, ""));
        out.write_all(before.as_bytes())?;
        match what {
            "title" => out.write_all(escaped(title).as_bytes())?,
            "style" => STYLE.iter().try_for_each(|style| out.write_all(style.as_bytes()))?,
            "plan" => out.write_all(plan.as_bytes())?,
            "data" => out.write_all(as_element(data).as_bytes())?,
            "licence" => out.write_all(PLOTS_LICENCE.as_bytes())?,
            "plots" => out.write_all(PLOTS.as_bytes())?,
            "scripts" => SCRIPTS.iter().try_for_each(|script| out.write_all(script.as_bytes()))?,
            "pictures" => pictures.write(&mut out)?,
            _ => {}
        }
        rest = behind;
    }
    out.write_all(rest.as_bytes())?;
    out.flush()?;
    Ok(out.bytes)
}

/// Writes, and counts the bytes.
struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// JSON that is safe in an element: neither the element's end nor a comment can begin in it.
fn as_element(data: &Json) -> String {
    data.to_string().replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn no_text_ends_the_element_that_it_stands_in() {
        let hostile = "</script><!--<script>alert(1)</script>";
        let json = as_element(&json!({ "name": hostile }));
        assert!(!json.contains('<'));
        assert_eq!(serde_json::from_str::<Json>(&json).unwrap()["name"], hostile);
    }

    #[test]
    fn the_page_has_a_place_for_everything_and_asks_for_nothing() {
        for what in ["title", "style", "plan", "data", "plots", "scripts", "pictures", "licence"] {
            assert_eq!(HTML.matches(&format!("{{{{{what}}}}}")).count(), 1, "{what}");
        }
        assert!(HTML.starts_with(PAGE_MARK));
        assert!(HTML.contains("default-src 'none'"));
        for own in SCRIPTS.iter().chain(&STYLE).chain(&[HTML]) {
            assert!(!own.contains("http://") && !own.contains("https://"), "the page contains an address");
        }
        assert!(SCRIPTS.iter().all(|script| !script.contains("</script") && !script.contains("innerHTML")));
    }
}
