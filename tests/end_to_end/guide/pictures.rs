//! The pictures of the guide: figures that `depthloom figure` draws, and sections of a run's `report.html`.

use std::fs;
use std::path::Path;

use base64::Engine as _;
use depthloom_test_needs::chromium;
use serde_json::{Value as Json, json};

use super::page::Screenshot;
use super::{book, writes};
use crate::browser::Browser;
use crate::support::{depthloom, succeed, workspace};

/// Where a figure is drawn, in the folder in which the page is run.
const DRAWN: &str = "figure-of-the-guide.svg";
/// The width of the browser's window, px.
const WIDTH_PX: u32 = 1200;
const STALE: &str = "stale: DEPTHLOOM_WRITE_GUIDE=1 DEPTHLOOM_FULL_TESTS=1 cargo test --release -p depthloom --test end_to_end -- guide::";

/// The command that draws a figure.
pub(super) fn command(arguments: &str) -> String {
    format!("depthloom figure {arguments} --out {DRAWN}")
}

/// Compares the figure that was drawn with the file in the book, or writes it.
///
/// # Errors
/// If the file is stale.
pub(super) fn check_figure(file: &str, tolerance: f64, here: &Path) -> Result<(), String> {
    let drawn = fs::read_to_string(here.join(DRAWN)).expect("a figure");
    let path = book().join(file);
    let stored = fs::read_to_string(&path).unwrap_or_default();
    if is_close(&drawn, &stored, tolerance) {
        return Ok(());
    }
    if !writes() {
        return Err(format!("docs/{file} is {STALE}"));
    }
    fs::write(path, drawn).map_err(|error| format!("docs/{file}: {error}"))
}

/// Whether two texts are equal, except for numbers that differ by `tolerance` or less.
fn is_close(a: &str, b: &str, tolerance: f64) -> bool {
    fn parts(text: &str) -> impl Iterator<Item = &str> {
        let is_digit = |letter: char| letter.is_ascii_digit() || letter == '.';
        let mut rest = text;
        std::iter::from_fn(move || {
            let is_number = rest.chars().next().map(is_digit)?;
            let end = rest.find(|letter| is_digit(letter) != is_number).unwrap_or(rest.len());
            let (part, behind) = rest.split_at(end);
            rest = behind;
            Some(part)
        })
    }
    let equal = |(a, b): (&str, &str)| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= tolerance,
        _ => a == b,
    };
    a == b || (parts(a).count() == parts(b).count() && parts(a).zip(parts(b)).all(equal))
}

/// Checks the inputs of a picture, and redraws it if they changed and pictures are to be written. Returns the checksum
/// of the inputs.
///
/// Pixels are not compared, because they differ between browsers.
///
/// # Errors
/// If the picture is stale.
pub(super) fn check_screenshot(picture: &Screenshot, here: &Path, test: &str) -> Result<String, String> {
    let inputs = checksum(picture, here);
    let path = book().join(&picture.file);
    let is_stale = inputs != picture.inputs || !path.is_file();
    if is_stale && !writes() {
        return Err(format!("docs/{} is {STALE}", picture.file));
    }
    // Skipped by name without a browser.
    let Some(program) = chromium(test) else {
        return if is_stale { Err("pictures are made with Chromium".to_owned()) } else { Ok(inputs) };
    };
    let bytes = screenshot(&program, &here.join(&picture.run).join("report.html"), &picture.section);
    let taken = image::load_from_memory(&bytes).map_err(|error| error.to_string())?;
    if is_stale {
        fs::write(&path, &bytes).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    let stored = image::open(&path).map_err(|error| error.to_string())?;
    // Fonts differ between machines, and with them the height of a line.
    let is_alike = taken.width() == stored.width() && taken.height().abs_diff(stored.height()) <= stored.height() / 4;
    is_alike
        .then_some(inputs)
        .ok_or_else(|| format!("docs/{} shows something else than the page now does", picture.file))
}

/// The checksum of what a report shows: page, experiment, networks and the versions of kinds.
fn checksum(picture: &Screenshot, here: &Path) -> String {
    let mut sum = crc32fast::Hasher::new();
    let mut add = |folder: &Path, endings: &[&str]| {
        let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
        let is_wanted = |path: &std::path::PathBuf| {
            path.extension().and_then(|ending| ending.to_str()).is_some_and(|ending| endings.contains(&ending))
        };
        let mut files: Vec<_> = entries.filter(is_wanted).collect();
        files.sort();
        files.iter().for_each(|file| sum.update(&fs::read(file).expect("a file")));
    };
    add(&workspace().join("crates/figures/src/page"), &["html", "css", "js"]);
    add(here, &["onnx"]);
    sum.update(&fs::read(here.join(&picture.experiment)).expect("an experiment"));
    let plan = succeed(depthloom().current_dir(here).args(["plan", "--json", &picture.experiment])).stdout;
    let plan: Json = serde_json::from_slice(&plan).expect("JSON");
    let runs = plan["runs"].as_array().expect("a list");
    let parts = runs.iter().flat_map(|run| run["source"]["parts"].as_array().into_iter().flatten());
    let nodes = runs.iter().flat_map(|run| run["nodes"].as_array().into_iter().flatten());
    for kind in parts.chain(nodes) {
        sum.update(format!("{} {} ", kind["kind"], kind["version"]).as_bytes());
    }
    format!("{:08x}", sum.finalize())
}

/// A JPEG of a section of a page: a PNG of the same frames is three times as large.
fn screenshot(program: &Path, page: &Path, section: &str) -> Vec<u8> {
    let mut browser = Browser::start(program);
    let window = json!({ "width": WIDTH_PX, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
    browser.call("Emulation.setDeviceMetricsOverride", &window);
    let light = json!({ "features": [{ "name": "prefers-color-scheme", "value": "light" }] });
    browser.call("Emulation.setEmulatedMedia", &light);
    browser.open(&page.canonicalize().expect("a page"));
    browser.until("window.depthloomPage && depthloomPage.state.drawn > 0 && !depthloomPage.state.busy");
    let place = browser.eval(&format!(
        "(() => {{ const box = document.getElementById({section:?}).getBoundingClientRect(); return [box.left + scrollX, box.top + scrollY, box.width, box.height]; }})()"
    ));
    let clip = json!({ "x": 0, "y": place[1], "width": WIDTH_PX, "height": place[3], "scale": 1 });
    let taken = browser.call(
        "Page.captureScreenshot",
        &json!({ "format": "jpeg", "quality": 80, "captureBeyondViewport": true, "clip": clip }),
    );
    let text = taken["data"].as_str().expect("base64");
    base64::engine::general_purpose::STANDARD.decode(text).expect("base64")
}

#[test]
fn figures_are_equal_where_numbers_differ_by_the_tolerance() {
    let a = "M12.5 3.25L7 88 id=a";
    assert!(is_close(a, a, 0.0));
    assert!(is_close(a, "M12.51 3.25L7 88 id=a", 0.02) && !is_close(a, "M12.51 3.25L7 88 id=a", 0.0));
    for other in ["M12.5 3.25L7 88 id=b", "M12.5 3.25L7 88", "M12.5 3.25L7 90 id=a"] {
        assert!(!is_close(a, other, 0.5), "{other}");
    }
}
