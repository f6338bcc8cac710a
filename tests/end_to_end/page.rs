//! `report.html` in a browser: it opens without errors and without a network, and its controls work.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use depthloom_test_needs::chromium;

use crate::browser::Browser;
use crate::support::{Row, depthloom, number, read_csv, succeed, workspace};

/// Markup with scripts that must not run.
const HOSTILE: &str = r#"</script><script>window.broken=1</script><img src=x onerror="window.broken=1">"#;

/// Two variants of table1 on small frames, with training, and a description that must be shown as text.
fn small(folder: &Path) -> PathBuf {
    let experiment = folder.join("small.yaml");
    let table1 = workspace().join("experiments/table1.yaml");
    let text = format!(
        "extends: {}\nexperiment: small page\ndescription: '{HOSTILE}'\nsources:\n  train: {{ with: {{ frames: 0..3, width: 320, height: 96 }} }}\n  test: {{ with: {{ frames: 0..6, width: 320, height: 96 }} }}\n\
         stages: {{ learn: {{ nodes: {{ train: {{ with: {{ steps: 12, curve_every: 4 }} }} }} }} }}\nvariants: {{ no_weighting: null, average_scaling: null }}\n",
        table1.display()
    );
    fs::write(&experiment, text).expect("written");
    let out = folder.join("run");
    succeed(depthloom().arg("run").arg(&experiment).args(["--quiet", "--out"]).arg(&out));
    out
}

fn opened(test: &str, page: &Path) -> Option<Browser> {
    let mut browser = Browser::start(&chromium(test)?);
    browser.open(page);
    browser.until("window.depthloomPage && depthloomPage.state.drawn > 0 && !depthloomPage.state.busy");
    Some(browser)
}

/// The numbers of a column of the table.
fn column_values(page: &mut Browser, column: usize) -> Vec<f64> {
    let values = page.eval(&format!(
        "[...document.querySelectorAll('#scores tbody tr')].map((tr) => Number(tr.children[{column}].title))"
    ));
    values.as_array().expect("a column").iter().filter_map(serde_json::Value::as_f64).collect()
}

/// Checks the order of the table, the statement on significance, and the colours of variants. Returns the column of the
/// leading metric.
fn check_order(page: &mut Browser, rows: &[Row]) -> usize {
    let abs_rel =
        "[...document.querySelectorAll('#scores thead th')].findIndex((th) => th.textContent.startsWith('abs_rel'))";
    let column = page.eval(abs_rel).as_u64().expect("a column") as usize;
    // The best rows are first, in each pixel set; a button restores the order of table.csv.
    let shown = column_values(page, column);
    let sets: HashSet<&str> = rows.iter().map(|row| row["set"].as_str()).collect();
    let breaks = shown.windows(2).filter(|pair| pair[0] > pair[1]).count();
    assert!(shown.len() == rows.len() && breaks < sets.len(), "{shown:?}");
    page.eval("[...document.querySelectorAll('#table button')].find((button) => button.textContent === 'order of the experiment').click()");
    for (theirs, row) in column_values(page, column).into_iter().zip(rows) {
        let ours = number(row, "abs_rel");
        assert!((ours - theirs).abs() <= 1e-6 * ours, "{ours} in table.csv, {theirs} on the page");
    }
    // Six frames are too few for several tests.
    assert_eq!(page.eval("document.querySelectorAll('#scores .verdict').length"), 0);
    let tested = page.eval("document.querySelector('#table .tested').textContent");
    assert!(tested.as_str().is_some_and(|text| text.contains("6 frames are too few")), "{tested}");
    // Each variant has its own colour.
    let strokes = "new Set([...document.querySelectorAll('#scores tbody tr')].filter((tr) => tr.textContent.includes('fused')).map((tr) => tr.querySelector('svg.line line').getAttribute('stroke'))).size";
    assert_eq!(page.eval(strokes), 2);
    column
}

/// Checks the filter of frames, and shows the second frame.
fn check_filter(page: &mut Browser) {
    // A filter leaves some frames, through which slider and buttons move.
    let typed = |page: &mut Browser, field: &str, text: &str| {
        page.eval(&format!(
            "(() => {{ const field = document.getElementById('{field}'); field.value = {text:?}; field.dispatchEvent(new Event('input')); }})()"
        ));
        page.until("!depthloomPage.state.busy");
    };
    let count = "document.getElementById('filter-count').textContent";
    let visible = "depthloomPage.state.visible";
    typed(page, "filter-id", "000004");
    assert_eq!(page.eval(count), "1 of 6 frames match");
    assert_eq!(page.eval("depthloomPage.state.part.frames[depthloomPage.state.place].id"), "000004_10");
    typed(page, "filter-id", "");
    let scores = page.eval("JSON.parse(document.getElementById('data').textContent).scores[0].lines.find((line) => JSON.parse(document.getElementById('data').textContent).estimates[line.estimate].name === 'fused').values.abs_rel");
    let mut sorted: Vec<f64> =
        scores.as_array().expect("values").iter().filter_map(serde_json::Value::as_f64).collect();
    sorted.sort_by(f64::total_cmp);
    typed(page, "filter-condition", &format!("abs_rel > {}", f64::midpoint(sorted[2], sorted[3])));
    assert_eq!((page.eval(count), page.eval(&format!("{visible}.length"))), ("3 of 6 frames match".into(), 3.into()));
    page.eval("document.querySelector('[aria-label=\"previous frame\"]').click()");
    page.until(&format!("!depthloomPage.state.busy && {visible}.includes(depthloomPage.state.place)"));
    typed(page, "filter-condition", "abs_rel > nine");
    assert!(page.eval(count).as_str().is_some_and(|text| text.contains("a metric, a comparison and a number")));
    typed(page, "filter-condition", "abs_rel > 9");
    assert_eq!(page.eval(count), "0 of 6 frames match");
    page.eval("[...document.querySelectorAll('#filter button')].find((button) => button.textContent === 'all frames').click()");
    page.until("!depthloomPage.state.busy && depthloomPage.state.visible.length === 6");
    page.eval("depthloomPage.show(1)");
    page.until("depthloomPage.state.place === 1 && !depthloomPage.state.busy");
}

#[test]
fn the_page_shows_the_results_and_reacts_to_pointer_and_keys() {
    const TEST: &str = "the_page_shows_the_results_and_reacts_to_pointer_and_keys";
    if chromium(TEST).is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let run = small(folder.path());
    let Some(mut browser) = opened(TEST, &run.join("report.html")) else { return };
    let page = &mut browser;
    assert_eq!(page.eval("document.getElementById('about').textContent"), HOSTILE);
    assert_eq!(page.eval("window.broken === undefined && !document.querySelector('img')"), true);

    // The table has the numbers of table.csv, marks the best, sorts, and shows the paper's numbers on demand.
    let rows = read_csv(&run.join("table.csv"));
    assert_eq!(page.eval("document.querySelectorAll('#scores tbody tr').length"), rows.len());
    let column = check_order(page, &rows);
    assert!(page.eval("document.querySelectorAll('#scores td.best').length").as_u64() > Some(0));
    page.eval(&format!("document.querySelectorAll('#scores thead button')[{column}].click()"));
    let values = column_values(page, column);
    assert!(values.len() == rows.len() && values.is_sorted(), "{values:?}");
    page.eval("document.getElementById('paper').click()");
    assert!(page.eval("document.querySelectorAll('#scores .beside').length").as_u64() >= Some(8));

    // Hovering over the figure shows metres, medians and counts; an estimate can be hidden.
    let hover = "document.querySelector('#distance-plot .hover:not([hidden])')?.textContent ?? ''";
    page.point_at("#distance-plot .u-over", (0.3, 0.5));
    page.until(&format!("({hover}).includes('ground-truth distance')"));
    let text = page.eval(hover);
    assert!(text.as_str().is_some_and(|text| text.contains("stereo") && text.contains("median")), "{text}");
    page.eval(
        "[...document.querySelectorAll('#distance .pick label')].find((label) => label.textContent === 'stereo').click()",
    );
    page.point_at("#distance-plot .u-over", (0.31, 0.5));
    page.until(&format!("({hover}).includes('ground-truth distance') && !({hover}).includes('stereo')"));

    // Keys move the slider; all views show the frame.
    assert_eq!(page.eval("depthloomPage.state.part.frames.length"), 6);
    let sum = "document.querySelectorAll('.view canvas')[2].toDataURL()";
    let before = page.eval(sum);
    page.eval("document.getElementById('slider').focus()");
    for kind in ["keyDown", "keyUp"] {
        let key =
            serde_json::json!({ "type": kind, "key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39 });
        page.call("Input.dispatchKeyEvent", &key);
    }
    page.until("depthloomPage.state.place === 1 && !depthloomPage.state.busy");
    assert_ne!(page.eval(sum), before, "another frame has another picture");

    check_filter(page);

    // The values on hover equal the recorded ones.
    page.point_at(".view:nth-child(2) .glass", (0.5, 0.9));
    page.until("document.querySelectorAll('#values tbody tr').length > 5");
    let pixel = page.eval("document.getElementById('pixel').textContent");
    let pixel = pixel.as_str().expect("a text").to_owned();
    let after = |word: &str| -> usize {
        let rest = pixel.split_once(word).unwrap_or_else(|| panic!("{pixel}")).1.trim_start();
        rest.split(|c: char| !c.is_ascii_digit()).next().and_then(|digits| digits.parse().ok()).expect("a number")
    };
    let (column, row) = (after("column"), after("row"));
    let id = pixel.split_once(',').expect("the frame's id").0;
    let out = folder.path().join("export");
    succeed(depthloom().arg("export").arg(&run).args(["/compare/depth/depth", "--format", "npy", "--out"]).arg(&out));
    let stereo = page.eval("[...document.querySelectorAll('#values tbody tr')].find((tr) => tr.firstChild.textContent === 'stereo').children[2].textContent");
    let exported = npy(&find(&out, &format!("{id}.npy")), column, row);
    match stereo.as_str().expect("a text").split_once(' ') {
        Some((metres, "m")) => {
            let metres: f32 = metres.parse().expect("metres");
            assert!(
                (metres / exported - 1.0).abs() < 0.002,
                "{metres} m on the page, {exported} in the recording, at {pixel}"
            );
        }
        _ => assert!(exported.is_nan(), "no value on the page, {exported} in the recording, at {pixel}"),
    }

    // A click on the worst frame selects it.
    page.eval("document.querySelector('button.jump').click()");
    page.until("!depthloomPage.state.busy && document.getElementById('frame-name').textContent.startsWith(document.querySelector('button.jump').textContent.split(':')[0])");
    // Dark and light themes, and printing.
    page.eval("document.getElementById('theme').click()");
    page.eval("dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint'));");
    assert!(
        page.eval("document.getElementById('command').textContent").as_str().is_some_and(|text| text.contains(" run "))
    );
    assert_eq!(page.complaints(), Vec::<String>::new());
}

/// The first file below a folder whose path has this ending.
fn find(folder: &Path, ending: &str) -> PathBuf {
    let mut all = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
            if entry.is_dir() { folders.push(entry) } else { all.push(entry) }
        }
    }
    all.sort();
    all.into_iter().find(|path| path.to_string_lossy().ends_with(ending)).expect("the file was exported")
}

/// A sample of an `<f4` array.
fn npy(path: &Path, column: usize, row: usize) -> f32 {
    let bytes = fs::read(path).expect("a file");
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let shape = String::from_utf8_lossy(&bytes[10..head]).into_owned();
    let shape = shape.split_once("'shape': (").expect("a shape").1;
    let width: usize = shape.split([',', ')']).nth(1).and_then(|width| width.trim().parse().ok()).expect("a width");
    let at = head + 4 * (row * width + column);
    f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

/// Runs with few recorded topics, with failures, with disparities only, and recordings outside of a run folder.
#[test]
fn pages_of_partial_and_failed_runs_open_without_errors() {
    const TEST: &str = "pages_of_partial_and_failed_runs_open_without_errors";
    let Some(program) = chromium(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let size = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    let run = |name: &str, experiment: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let ran = depthloom()
            .arg("run")
            .arg(experiment)
            .args(["--quiet", "--keep-going", "--out"])
            .arg(&out)
            .args(more)
            .output();
        let ran = ran.expect("started");
        assert!(out.join("report.html").is_file(), "{name}: {}", String::from_utf8_lossy(&ran.stderr));
        out.join("report.html")
    };
    let look = "experiments/first-look.yaml";
    let nothing = run("nothing", look, &[&size[..], &["--set", "record=[]"]].concat());
    let ground_truth = run("ground-truth", look, &[&size[..], &["--set", "record=[source/depth]"]].concat());
    let every = run("every", look, &[&size[..], &["--set", "record={ every: 3 }"]].concat());
    let text = fs::read_to_string(workspace().join(look)).expect("an experiment");
    let file = folder.path().join("unscored.yaml");
    fs::write(&file, text.split("    score:").next().expect("a part")).expect("written");
    let unscored = run("unscored", &file.to_string_lossy(), &size);
    let disparities = run("disparities", "experiments/stereo-scores.yaml", &[]);
    let moved = folder.path().join("moved");
    fs::create_dir(&moved).expect("a folder");
    fs::copy(every.with_file_name("recording.mcap"), moved.join("recording.mcap")).expect("copied");
    succeed(depthloom().arg("report").arg(&moved).arg("--json"));
    let mut browser = Browser::start(&program);
    for page in [nothing, ground_truth, every, unscored, disparities, moved.join("report.html")] {
        browser.open(&page);
        browser.until("document.querySelectorAll('nav a').length > 2");
        assert_eq!(browser.complaints(), Vec::<String>::new(), "{}", page.display());
    }
}

#[test]
fn the_page_without_intervals_says_how_to_get_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    let small = ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96"];
    succeed(depthloom().args(["run", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&run).args(small));
    let has_hint = |page: &Path| fs::read_to_string(page).expect("a page").contains("`depthloom report RUN --ci`");
    assert!(has_hint(&run.join("report.html")));
    succeed(depthloom().arg("report").arg(&run).arg("--ci"));
    assert!(!has_hint(&run.join("report.html")));
}

#[test]
fn no_page_and_open_control_the_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("look");
    let small =
        ["--set", "sources.street.with.width=320", "--set", "sources.street.with.height=96", "--no-page", "--out"];
    succeed(depthloom().args(["run", "experiments/first-look.yaml", "--quiet"]).args(small).arg(&out));
    assert!(!out.join("report.html").exists());
    // A browser that writes its argument to a file.
    let (browser, argument) = (folder.path().join("browser"), folder.path().join("argument"));
    fs::write(&browser, format!("#!/bin/sh\nprintf %s \"$1\" > '{}'\n", argument.display())).expect("written");
    #[cfg(unix)]
    fs::set_permissions(&browser, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("allowed");
    succeed(depthloom().arg("report").arg(&out).arg("--open").env("BROWSER", &browser));
    let page = fs::canonicalize(out.join("report.html")).expect("a page");
    assert_eq!(fs::read_to_string(&argument).expect("the browser was started"), page.to_string_lossy());
    let before = fs::read(&page).expect("a page");
    // A browser that does not start is a warning.
    let output = succeed(depthloom().arg("report").arg(&out).arg("--open").env("BROWSER", "/nonexistent/browser"));
    assert!(String::from_utf8_lossy(&output.stderr).contains("open it yourself"));
    assert!(fs::read(&page).expect("a page") == before, "equal recordings have equal pages");
    // A page that depthloom did not write is not replaced.
    let other_folder = folder.path().join("other_folder");
    fs::create_dir(&other_folder).expect("a folder");
    fs::write(other_folder.join("report.html"), "<html>mine</html>").expect("written");
    let refused = depthloom().arg("report").arg(&out).arg("--out").arg(&other_folder).output().expect("started");
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("report.html"));
}
