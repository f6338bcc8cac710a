//! `report.html`: a run on one page, in one file, for a browser without a network.
//!
//! The page is what [`page.html`](page/page.html) says, with its style and scripts in it, a JSON object of all [numbers](data), the [plan](drawing)
//! as a picture, and behind these the [pictures] of frames, each in an element of its own that is taken apart when it is looked at. Whatever
//! comes from an experiment is text to the page, never markup: in JSON no `<` stands, and what stands in markup is escaped.

mod choice;
mod data;
mod drawing;
mod pictures;
mod planes;

use std::io::{BufWriter, Write};
use std::path::Path;

use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use self::pictures::{Pictures, steps_json};
use crate::ablation::{Ablation, source_of};
use crate::error::{AnalysisError, caught};
use crate::estimators::estimators;
use crate::files::Output;
use crate::reading;
use crate::report::Summary;
use crate::timings::Timing;
use crate::told::warnings;
use crate::xml::escaped;

/// Its name in the folder of a report.
pub const PAGE: &str = "report.html";

/// How a page of ours begins, for who must not replace another.
pub const PAGE_MARK: &str = "<!doctype html>\n<!-- a report of depthloom -->";

const HTML: &str = include_str!("page/page.html");
const STYLE: [&str; 2] = [include_str!("page/uPlot.min.css"), include_str!("page/page.css")];
/// uPlot (MIT, © Leon Sorokin, github.com/leeoniya/uPlot, from the npm package `uplot` 1.6.32), then ours; its licence goes with it.
const PLOTS: &str = include_str!("page/uPlot.iife.min.js");
const PLOTS_LICENCE: &str = include_str!("page/uPlot.LICENSE");
const SCRIPTS: [&str; 5] = [
    include_str!("page/common.js"),
    include_str!("page/table.js"),
    include_str!("page/figures.js"),
    include_str!("page/frames.js"),
    include_str!("page/page.js"),
];

/// What a page says besides what its recording holds: where the run was made, and where its time went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// What `environment.json` says; null where there is none.
    pub environment: Json,
    /// What `timings.parquet` says.
    pub timings: Vec<Timing>,
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageWritten {
    /// Frames with pictures.
    pub frames: usize,
    /// Bytes.
    pub bytes: u64,
}

/// Writes [`PAGE`] into `folder`, of a recording whose [report](crate::report()) said `summary`. Equal recordings and surroundings give equal
/// bytes; memory depends on neither the number of frames nor on that of maps.
///
/// # Errors
/// If the recording cannot be read or the page not be written; [`AnalysisError::Stopped`] once `stop` says so. Maps whose bytes are damaged are left out.
pub fn write_page(
    recording: &Recording,
    folder: &Path,
    summary: &Summary,
    surroundings: &Surroundings,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<PageWritten, AnalysisError> {
    caught(|| written(recording, summary, surroundings, Output { folder, stop }))
}

fn written(
    recording: &Recording,
    summary: &Summary,
    surroundings: &Surroundings,
    output: Output<'_>,
) -> Result<PageWritten, AnalysisError> {
    let (plan, found) = (recording.plan(), &summary.found);
    let estimators = estimators(plan)?;
    let scores = reading::scores(recording, &estimators, output.stop)?;
    let table = found.table.as_ref();
    let shown = choice::estimators_shown(&estimators, table);
    let mut series = choice::series(recording, &estimators, &shown, table, &scores);
    let mut notes = warnings(recording, None);
    notes.extend(summary.notes.iter().cloned());
    let mut data = json!({
        "experiment": plan.experiment,
        "about": plan.about,
        "depthloom": env!("CARGO_PKG_VERSION"),
        "variants": plan.variants.len(),
        "condition": summary.recording,
        "notes": notes,
        "table": table.map(|table| data::table(table, &estimators)),
        "answers": table.map_or(Ok(Vec::new()), |table| {
            let source = source_of(recording);
            data::answers(&Ablation::new(plan, &estimators, &scores, &source, None), table)
        })?,
        "estimators": data::estimators(&estimators, &shown),
        "estimators_in_all": estimators.len(),
        "distances": data::distances(found, &shown),
        "scores": data::scores(recording, &estimators, &shown, &series, &scores),
        "curves": data::curves(found),
        "every": plan.every,
        "failures": data::failures(recording),
        "timings": data::timings(&surroundings.timings),
        "environment": surroundings.environment,
        "keys": data::keys(plan),
    });
    // Pictures take the memory that these did.
    drop(scores);
    let drawing = drawing::drawing(plan);
    let numbers = (data.to_string().len() + drawing.len()) as u64;
    let mut pictures = Pictures::new(recording, &mut series, numbers, output)?;
    let frames = series.iter().map(|series| series.positions.len()).sum();
    data["pictures"] = data::pictures(recording, &estimators, &shown, &series, &pictures);
    data["steps"] = steps_json(pictures.size);
    data["damaged"] = pictures.damaged.into();
    let path = output.folder.join(PAGE);
    let mut write = |file: &mut std::fs::File| -> std::io::Result<u64> {
        let mut out = Counted { out: BufWriter::with_capacity(1 << 16, file), bytes: 0 };
        let mut rest = HTML;
        while let Some((before, behind)) = rest.split_once("{{") {
            let (what, behind) = behind.split_once("}}").unwrap_or((behind, ""));
            out.write_all(before.as_bytes())?;
            match what {
                "title" => out.write_all(escaped(&plan.experiment).as_bytes())?,
                "style" => STYLE.iter().try_for_each(|style| out.write_all(style.as_bytes()))?,
                "plan" => out.write_all(drawing.as_bytes())?,
                "data" => out.write_all(as_element(&data).as_bytes())?,
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
    };
    let mut bytes = 0;
    output.go_on()?;
    let result = depthloom_durable::write_with(&path, |file| -> std::io::Result<()> {
        bytes = write(file)?;
        Ok(())
    });
    result.map_err(AnalysisError::write(&path))?;
    Ok(PageWritten { frames, bytes })
}

/// Writes, and counts the bytes.
struct Counted<W> {
    out: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

/// JSON that may stand in an element: neither its end nor a comment can begin in it.
fn as_element(data: &Json) -> String {
    data.to_string().replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
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
            assert!(!own.contains("http://") && !own.contains("https://"), "an address stands in the page");
        }
        assert!(SCRIPTS.iter().all(|script| !script.contains("</script") && !script.contains("innerHTML")));
    }
}
