//! `table` and `explain`, checked against the run's own files and against calculations in the tests.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value as Json;

use crate::support::{Row, depthloom, label, number, read_csv, skipped, succeed};

/// Stereo with 2 x 2 x 2 settings on two small frames, scored with and without a median filter.
const SWEEP: &str = "experiment: sweep
sources:
  street: { kind: synthetic/road, with: { frames: 0..2, seed: 3, width: 320, height: 96 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      smooth: { kind: filter/median, inputs: { depth: depth/depth } }
    score:
      ground_truth: source/depth
      estimates:
        raw: { from: depth/depth, sets: [valid, all] }
        smooth: { from: smooth/depth, sets: [valid, all] }
matrix:
  look.stereo.with.block: [3, 9]
  look.stereo.with.uniqueness: [0, 10]
  look.stereo.with.mode: [hh, sgbm]
record: []
";

/// Runs an experiment into a folder.
fn run(folder: &Path, experiment: &str) -> (PathBuf, String) {
    let (file, out) = (folder.join("sweep.yaml"), folder.join("run"));
    std::fs::write(&file, experiment).expect("written");
    let output = succeed(depthloom().args(["run", "--no-page"]).arg(&file).arg("--out").arg(&out));
    (out, String::from_utf8(output.stdout).expect("UTF-8"))
}

fn table(run: &Path, arguments: &[&str]) -> Output {
    succeed(depthloom().arg("table").arg(run).args(arguments))
}

/// Standard error of a `table` command that is refused.
fn refused(run: &Path, arguments: &[&str]) -> String {
    let output = depthloom().arg("table").arg(run).args(arguments).output().expect("the binary starts");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

fn assert_near(a: f64, b: f64, what: &str) {
    assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{what}: {a} differs from {b}");
}

#[test]
fn table_matches_the_runs_files_and_effects_match_a_calculation() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let csv = folder.path().join("rows.csv");
    table(&run, &["--format", "csv", "--out", csv.to_str().expect("UTF-8")]);
    let rows = read_csv(&csv);
    let written: BTreeMap<String, Row> = read_csv(&run.join("table.csv"))
        .into_iter()
        .filter(|row| row["set"] == "all")
        .map(|row| (label(&row), row))
        .collect();
    assert_eq!((rows.len(), written.len()), (16, 16));
    for row in &rows {
        let name = &label(row);
        let axes = ["block", "uniqueness", "mode"];
        assert_eq!(row["variant"], axes.map(|axis| format!("{axis}={}", row[axis])).join("+"));
        let same = ["stage", "variant", "estimate", "set"].into_iter().chain(axes);
        assert!(same.into_iter().all(|column| row[column] == written[name][column]), "{row:?}");
        for score in ["a1", "a2", "a3", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog"] {
            assert_near(number(row, score), number(&written[name], score), name);
        }
        assert!(number(row, "ms") > 0.0);
    }
    assert!(rows.is_sorted_by(|a, b| number(a, "abs_rel") <= number(b, "abs_rel")));

    // The time of a filtered estimate includes that of its input.
    let row_of = |name: &str| rows.iter().find(|row| label(row) == name).expect("a row");
    for row in rows.iter().filter(|row| row["estimate"] == "smooth") {
        assert!(number(row, "ms") > number(row_of(&label(row).replace("/smooth", "/raw")), "ms"));
    }

    // No row of the front is dominated, and every other row is dominated by a row of the front. Times that differ by at
    // most 5 % count as equal, as the table states.
    let front = text(&table(&run, &["--pareto", "abs_rel,ms", "--format", "csv"]));
    let named = |line: &str| line.split(',').skip(1).take(2).collect::<Vec<_>>().join("/");
    let front: Vec<String> = front.lines().skip(1).map(named).collect();
    for row in &rows {
        let beats = |other: &String| {
            let other = row_of(other);
            let [(error, other_error), (ms, other_ms)] =
                ["abs_rel", "ms"].map(|column| (number(row, column), number(other, column)));
            let slower = other_ms > ms && other_ms - ms > 0.05 * ms;
            other_error <= error && !slower && (other_error < error || other_ms < ms)
        };
        assert_eq!(front.iter().any(beats), !front.contains(&label(row)), "{row:?}");
    }

    // Marginal means and eta squared, from the rows.
    let effects: Json = serde_json::from_slice(&table(&run, &["--effects", "abs_rel", "--json"]).stdout).expect("JSON");
    let mean = |rows: &mut dyn Iterator<Item = &Row>| {
        let values: Vec<f64> = rows.map(|row| number(row, "abs_rel")).collect();
        (values.len() as f64, values.iter().sum::<f64>() / values.len() as f64)
    };
    let (_, all) = mean(&mut rows.iter());
    let spread: f64 = rows.iter().map(|row| (number(row, "abs_rel") - all).powi(2)).sum();
    let mut remainder = 1.0;
    for axis in ["block", "uniqueness", "mode", "estimate"] {
        let levels: Vec<&Json> =
            effects["rows"].as_array().expect("rows").iter().filter(|row| row["axis"] == axis).collect();
        assert_eq!(levels.len(), 2, "{axis}");
        let mut between = 0.0;
        for level in &levels {
            // Numbers of an axis are numbers in JSON.
            let name = level["level"].as_str().map_or_else(|| level["level"].to_string(), str::to_owned);
            assert_eq!(level["level"].is_number(), ["block", "uniqueness"].contains(&axis), "{level}");
            let (count, expected) = mean(&mut rows.iter().filter(|row| name == row[axis]));
            assert_eq!(level["rows"].as_f64(), Some(count));
            assert_near(level["abs_rel"].as_f64().expect("a mean"), expected, axis);
            between += count * (expected - all).powi(2);
        }
        assert_near(levels[0]["share"].as_f64().expect("a share"), between / spread, axis);
        remainder -= between / spread;
    }
    let interactions = effects["rows"].as_array().expect("rows").iter().find(|row| row["axis"] == "interactions");
    assert!((interactions.expect("the interactions")["share"].as_f64().expect("a share") - remainder).abs() < 1e-9);
}

#[test]
fn compare_notes_a_side_that_is_the_best_of_several_variants() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let ranked = text(&table(&run, &["--estimates", "*/smooth", "--sort", "abs_rel", "--format", "csv"]));
    let variants: Vec<&str> = ranked.lines().skip(1).filter_map(|line| line.split(',').nth(1)).collect();
    let compared = |sides: &[&str]| {
        let sides = sides.iter().map(|variant| format!("{variant}/smooth"));
        text(&succeed(depthloom().arg("compare").arg(&run).args(sides).args(["--resamples", "200"])))
    };
    let flat = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let note = format!("{}/smooth has the best abs_rel of 8 variants on the same frames", variants[0]);
    let printed = flat(compared(&[variants[1], variants[0]]));
    assert!(printed.contains(&note), "{printed}");
    // The correction for multiple tests covers a comparison of all variants.
    let printed = flat(compared(&variants));
    assert!(!printed.contains("on the same frames"), "{printed}");
}

#[test]
fn explain_prints_the_origin_of_a_number() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let estimate = "block=3+uniqueness=0+mode=hh/smooth";
    let explain = |arguments: &[&str]| succeed(depthloom().arg("explain").arg(&run).args(arguments));
    let printed = text(&explain(&["abs_rel", estimate]));
    for part in [
        "mean(|y - t| / t) (as in Martins et al. 2018)",
        "preset martins2018",
        "all pixels with ground truth (set `all`)",
        "0.001 m < ground truth < 80 m",
        "2 of 2 (000000_10, 000001_10)",
        "synthetic/road",
        "/look/block=3+uniqueness=0+mode=hh/smooth/depth",
        "(filter/median version",
        "frames that made it worse, largest change first",
    ] {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    let json: Json = serde_json::from_slice(&explain(&["abs_rel", estimate, "--json"]).stdout).expect("JSON");
    let frames: Vec<Row> = read_csv(&run.join("scores.csv"))
        .into_iter()
        .filter(|row| label(row) == estimate && row["set"] == "all")
        .collect();
    let values: Vec<f64> = frames.iter().map(|row| number(row, "abs_rel")).collect();
    assert_near(json["value"].as_f64().expect("a value"), (values[0] + values[1]) / 2.0, "mean");
    for (frame, row) in json["frames"].as_array().expect("frames").iter().zip(&frames) {
        assert_eq!(frame["frame"], row["frame"].as_str());
        assert_eq!(frame["pixels"].as_f64(), Some(number(row, "pixels")));
        assert_near(frame["value"].as_f64().expect("a value"), number(row, "abs_rel"), "a frame");
    }
    // The worse of two frames raised the mean; without it, the value is that of the other frame.
    let worst = usize::from(values[1] > values[0]);
    let worst_frames = json["worst"].as_array().expect("frames");
    assert_eq!((worst_frames.len(), &worst_frames[0]["frame"]), (1, &Json::from(frames[worst]["frame"].as_str())));
    assert_near(worst_frames[0]["without"].as_f64().expect("a value"), values[1 - worst], "without it");

    let wrong = depthloom().arg("explain").arg(&run).args(["abs_rel", "block=3+uniqueness=0+mode=hh/smoth"]).output();
    let wrong = wrong.expect("the binary starts");
    assert_eq!(wrong.status.code(), Some(2));
    let wrong = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(wrong.contains(&format!("did you mean `{estimate}`?")), "{wrong}");
}

#[test]
fn a_run_of_many_variants_prints_the_best_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = SWEEP.replace("[3, 9]", "[3, 5, 7, 9]");
    let (run, printed) = run(folder.path(), &sweep);
    let head = "all pixels with ground truth, preset martins2018, mean over 2 frames; the first 20 of 32 rows by abs_rel; * best";
    assert!(printed.replace('\n', " ").starts_with(head), "{printed}");
    assert!(printed.contains("depthloom table RUN"), "{printed}");
    let markdown = std::fs::read_to_string(run.join("table.md")).expect("the table");
    assert_eq!(markdown.lines().filter(|line| line.starts_with('|')).count(), 2 + 32);
    let latex = std::fs::read_to_string(run.join("table.tex")).expect("the table");
    assert!(latex.contains("the first 20 of 32 rows by abs\\_rel") && !latex.contains("resizebox"), "{latex}");
    // The table with metrics in rows is available on request.
    let few = text(&table(&run, &["--rows", "score", "--estimates", "block=3*/smooth", "--pixels", "all"]));
    assert!(few.lines().any(|line| line.starts_with("abs_rel ↓")), "{few}");
}

#[test]
fn every_format_is_valid_and_latex_compiles() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let parquet = folder.path().join("rows.parquet");
    table(&run, &["--format", "parquet", "--out", parquet.to_str().expect("UTF-8")]);
    let bytes = std::fs::read(&parquet).expect("a file");
    assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
    assert!(
        text(&table(&run, &["--format", "md", "--top", "2"])).lines().filter(|line| line.starts_with('|')).count() == 4
    );

    let tables = [&["--top", "5"][..], &["--effects", "abs_rel"], &["--rows", "score", "--estimates", "*hh/raw"]];
    let mut document = "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n".to_owned();
    for arguments in tables {
        let latex = text(&table(&run, &[arguments, &["--format", "latex"]].concat()));
        assert!(latex.contains("\\caption{") && latex.contains("\\label{tab:sweep") && !latex.contains("resizebox"));
        document.push_str(&latex);
    }
    document.push_str("\\end{document}\n");
    std::fs::write(folder.path().join("tables.tex"), document).expect("written");
    let compiled = ["tectonic", "pdflatex"].into_iter().find_map(|program| {
        let mut command = Command::new(program);
        if program == "pdflatex" {
            command.args(["-halt-on-error", "-interaction=nonstopmode"]);
        }
        command.arg("tables.tex").current_dir(folder.path()).output().ok()
    });
    match compiled {
        None => skipped("every_format_is_valid_and_latex_compiles", "there is no TeX (tectonic, pdflatex)"),
        Some(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
            assert!(folder.path().join("tables.pdf").is_file());
        }
    }
}

/// If one estimate is dense, the pixels that are valid in both are those valid in the other, so the metrics of the
/// other equal those over its own valid pixels.
#[test]
fn the_common_pixel_set_is_scored_from_recorded_maps() {
    let experiment = "experiment: common
sources:
  street: { kind: synthetic/road, with: { frames: 0..2, seed: 3, width: 320, height: 96 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      dense: { kind: disparity/fill, inputs: { disparity: stereo/disparity } }
      filled: { kind: depth/from-disparity, inputs: { disparity: dense/disparity, calibration: source/calibration } }
      smooth: { kind: filter/median, inputs: { depth: filled/depth } }
    score:
      ground_truth: source/depth
      sets: [valid, all]
      metrics: [a1, abs_rel, rmse, silog, mae, median_error]
      estimates: { sparse: depth/depth, dense: smooth/depth }
";
    let folder = tempfile::tempdir().expect("a folder");
    let (recorded, _) = run(folder.path(), experiment);
    let rows: Json = serde_json::from_slice(&table(&recorded, &["--pixels", "common", "--json"]).stdout).expect("JSON");
    let rows = rows["rows"].as_array().expect("rows");
    let row = |name: &str| rows.iter().find(|row| row["estimate"] == name).expect("a row");
    let written = read_csv(&recorded.join("table.csv"));
    let own = written.iter().find(|row| row["estimate"] == "sparse" && row["set"] == "valid");
    let own = own.expect("a row");
    for score in ["a1", "abs_rel", "rmse", "silog", "mae", "median_error"] {
        assert_near(row("sparse")[score].as_f64().expect("a score"), number(own, score), score);
    }
    assert!(row("sparse").get("sq_rel").is_none(), "sq_rel is not in `metrics`");
    assert!(row("dense")["abs_rel"].as_f64() != row("sparse")["abs_rel"].as_f64());
    assert_eq!(row("dense")["density"], row("sparse")["density"]);
    assert_near(row("dense")["density"].as_f64().expect("a share"), number(own, "density"), "density");

    // Without recorded maps, the error names those to record.
    let other = tempfile::tempdir().expect("a folder");
    let (bare, _) = run(other.path(), &format!("{experiment}record: []\n"));
    let refused = refused(&bare, &["--pixels", "common"]);
    assert!(refused.contains("`look.smooth/depth`") && refused.contains("`record:`"), "{refused}");
}

#[test]
fn table_out_does_not_replace_other_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let recording = run.join("recording.mcap");
    let before = std::fs::read(&recording).expect("read");
    let csv = |out: &Path| ["--format", "csv", "--out", out.to_str().expect("UTF-8")].map(str::to_owned);
    let refusal = |out: &Path| refused(&run, &csv(out).each_ref().map(String::as_str));
    for own in [recording.clone(), run.join("../run/recording.mcap"), run.join("scores.csv")] {
        assert!(refusal(&own).contains("it is a file of a run"));
    }
    // `samples` does not replace them either.
    let copy = folder.path().join("copy.mcap");
    std::fs::copy(&recording, &copy).expect("copied");
    for (out, why) in [(&recording, "it is a file of a run"), (&copy, "it is a recording")] {
        let refused =
            depthloom().args(["analyse", "--samples-only"]).arg(&run).arg("--out").arg(out).output().expect("it runs");
        assert_eq!(refused.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&refused.stderr).contains(why));
        assert!(std::fs::read(out).expect("read") == before);
    }
    // Files of the user that are not tables or figures are not replaced.
    for name in ["mine.yaml", "mine.onnx", "mine.py"] {
        let mine = folder.path().join(name);
        std::fs::write(&mine, "mine").expect("written");
        assert!(refusal(&mine).contains("is not a table or a picture"), "{name}");
        assert_eq!(std::fs::read(&mine).expect("read"), b"mine");
    }
    let in_folder = refusal(folder.path());
    assert!(in_folder.contains("it is a folder") && in_folder.contains("table.csv"), "{in_folder}");
    let nowhere = refusal(&folder.path().join("not/there.csv"));
    assert!(nowhere.contains("there is no folder") && nowhere.contains("mkdir -p"), "{nowhere}");
    assert!(std::fs::read(&recording).expect("read") == before);
    // A link is not followed, because its target may be any file.
    #[cfg(unix)]
    {
        let (link, file) = (folder.path().join("link.csv"), folder.path().join("file.csv"));
        std::os::unix::fs::symlink(&file, &link).expect("linked");
        std::fs::write(&file, "years").expect("written");
        let output = refused(&run, &csv(&link).each_ref().map(String::as_str));
        assert!(output.contains("it is a symbolic link"), "{output}");
        assert_eq!(std::fs::read_to_string(&file).expect("read"), "years");
    }
}

#[test]
fn the_model_ablation_is_evaluated_with_three_commands() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let small = ["frames=0..2", "width=320", "height=96"].map(|set| format!("sources.frames.with.{set}"));
    let mut run = depthloom();
    run.args(["run", "--no-page", "experiments/sgbm-ablation.yaml", "--quiet", "--out"]).arg(&out);
    succeed(small.iter().fold(&mut run, |run, set| run.args(["--set", set.as_str()])));
    let first = text(&table(&out, &["--sort", "abs_rel", "--top", "3", "--estimates", "*/depth"]));
    let heads = ["block", "uniqueness", "mode", "holes"];
    assert!(
        heads.iter().all(|head| first.contains(head)) && first.contains("the first 3 of 32 rows by abs_rel"),
        "{first}"
    );
    // A depth and the disparity that it is computed from share one row, with holes kept or filled.
    let both: Json = serde_json::from_slice(&table(&out, &["--json"]).stdout).expect("JSON");
    let both = both["rows"].as_array().expect("rows");
    assert_eq!(both.len(), 32);
    assert!(both.iter().all(|row| row["abs_rel"].is_number() && row["d1"].is_number()), "{:?}", both[0]);
    let front: Json = serde_json::from_slice(&table(&out, &["--pareto", "abs_rel,d1", "--json"]).stdout).expect("JSON");
    assert!(front["about"].to_string().contains("on the Pareto front of abs_rel and d1"), "{front}");
    let [variant, name] = ["variant", "estimate"].map(|column| both[0][column].as_str().expect("a name"));
    let label = format!("{variant}/{name}");
    let output = succeed(depthloom().arg("explain").arg(&out).args(["d1", &label, "--json"]));
    let explained: Json = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(explained["value"], both[0]["d1"]);
    let zones = text(&table(&out, &["--best-per-zone", "abs_rel"]));
    assert!(zones.contains("whole image") && zones.contains("10..20"), "{zones}");
    let effects = text(&table(&out, &["--effects", "abs_rel"]));
    assert!(heads.iter().all(|head| effects.contains(head)) && effects.contains("interactions"), "{effects}");
    // The page has both tables.
    succeed(depthloom().arg("report").arg(&out));
    let page = std::fs::read_to_string(out.join("report.html")).expect("a page");
    let data = page.split_once("id=\"data\">").and_then(|(_, rest)| rest.split_once("</script>")).expect("data").0;
    let data: Json = serde_json::from_str(data).expect("JSON");
    for (answer, option) in data["answers"].as_array().expect("tables").iter().zip(["--effects", "--best-per-zone"]) {
        let printed: Json = serde_json::from_slice(&table(&out, &[option, "abs_rel", "--json"]).stdout).expect("JSON");
        assert_eq!(answer["table"]["about"], printed["about"]);
        assert_eq!(answer["table"]["rows"].as_array().map(Vec::len), printed["rows"].as_array().map(Vec::len));
    }
    assert_eq!(data["answers"].as_array().map(Vec::len), Some(2));
    // A matcher runs once for both treatments of holes.
    let plan = succeed(depthloom().args(["plan", "experiments/sgbm-ablation.yaml", "--json"]));
    let plan: Json = serde_json::from_slice(&plan.stdout).expect("JSON");
    let is_matcher = |node: &&Json| node["kind"] == "stereo/sgbm";
    let nodes = plan["stages"][0]["nodes"].as_array().or_else(|| plan["runs"][0]["nodes"].as_array()).expect("nodes");
    assert_eq!(nodes.iter().filter(is_matcher).count(), 32);
}

#[test]
fn options_for_variant_rows_are_refused_with_score_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    for (option, value) in [("--columns", "rmse"), ("--sort", "rmse"), ("--top", "2"), ("--pareto", "rmse,ms")] {
        let error = refused(&run, &["--rows", "score", option, value]);
        assert!(error.contains(&format!("{option} needs variants in rows")), "{error}");
    }
}

#[test]
fn a_damaged_recording_exits_with_3_and_damaged_timings_remove_a_column() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let csv_table = |run: &Path| depthloom().args(["table", "--format", "csv"]).arg(run).output().expect("it runs");
    let timings = run.join("timings.parquet");
    std::fs::write(&timings, b"PAR1 damaged PAR1").expect("written");
    let output = csv_table(&run);
    let warning = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{warning}");
    assert!(warning.contains("`ms` is not available") && warning.contains("timings.parquet"), "{warning}");
    std::fs::remove_file(&timings).expect("removed");
    // A recording without its summary, and with damaged bytes after its first frames.
    let recording = run.join("recording.mcap");
    let mut bytes = std::fs::read(&recording).expect("read");
    bytes.truncate(bytes.len() - 100);
    let sound = bytes.clone();
    let mut tables = 0;
    for percent in (20..100).step_by(5) {
        let at = sound.len() * percent / 100;
        bytes.copy_from_slice(&sound);
        bytes[at..at + 64].fill(0xff);
        std::fs::write(&recording, &bytes).expect("written");
        let condition = depthloom().args(["inspect", "--json"]).arg(&run).output().expect("it runs");
        let is_damaged = String::from_utf8_lossy(&condition.stdout).contains("\"condition\": \"damaged");
        let output = csv_table(&run);
        // If the damage leaves no frame, there is no table.
        if output.stdout.is_empty() || !is_damaged {
            continue;
        }
        tables += 1;
        let warning = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{percent} %: {warning}");
        assert!(warning.contains("recording.mcap is damaged at byte"), "{percent} %: {warning}");
    }
    assert!(tables > 0, "no damage left a frame");
}

/// An untrusted run folder may have a pipe in place of the marker: listing runs must not wait for it.
#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_marker_does_not_block_the_list_of_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), SWEEP);
    let marker = run.join("depthloom-run.json");
    std::fs::remove_file(&marker).expect("removed");
    succeed(Command::new("mkfifo").arg(&marker));
    succeed(depthloom().args(["runs", "--runs"]).arg(folder.path()));
}

/// A confidence for all estimates, and a standard deviation for one of them.
#[test]
fn uncertainties_are_scored_in_the_same_table() {
    let experiment = "experiment: unsure
sources:
  street: { kind: synthetic/road, with: { frames: 0..2, seed: 3, width: 320, height: 96 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      edges: { kind: confidence/sobel, inputs: { image: source/left } }
    score:
      ground_truth: source/depth
      confidence: edges/weight
      estimates:
        stereo: depth/depth
        mono: { from: mono/depth, deviation: mono/depth }
        plain: { from: mono/depth, confidence: null }
";
    let folder = tempfile::tempdir().expect("a folder");
    let (recorded, _) = run(folder.path(), experiment);
    let rows: Json = serde_json::from_slice(&table(&recorded, &["--json"]).stdout).expect("JSON");
    let value = |name: &str, metric: &str| {
        let row = rows["rows"].as_array().expect("rows").iter().find(|row| row["estimate"] == name).expect("a row");
        row.get(metric).and_then(Json::as_f64)
    };
    // A deviation as large as the estimate covers every error that is not larger.
    assert!(value("mono", "coverage").is_some_and(|share| share > 0.9), "{rows}");
    assert!(
        value("mono", "ause").is_some_and(|area| area > 0.0)
            && value("mono", "coverage_2") >= value("mono", "coverage")
    );
    assert!(value("stereo", "ause").is_some() && value("stereo", "coverage").is_none(), "{rows}");
    assert!(value("plain", "ause").is_none() && value("plain", "abs_rel") == value("mono", "abs_rel"), "{rows}");
    let shown = text(&table(&recorded, &["--columns", "ause,coverage"]));
    assert!(shown.contains("ause ↓") && shown.contains("coverage") && !shown.contains("coverage ↑"), "{shown}");
    let drawn = folder.path().join("curves.csv");
    let figure =
        ["figure", recorded.to_str().expect("UTF-8"), "sparsification", "--out", "curves.svg", "--csv", "curves.csv"];
    succeed(depthloom().current_dir(folder.path()).args(figure));
    let points = read_csv(&drawn);
    let of_mono: Vec<_> = points.iter().filter(|point| point["estimate"] == "mono").collect();
    let area: f64 = of_mono.iter().map(|point| number(point, "predicted") - number(point, "oracle")).sum();
    assert_near(area / of_mono.len() as f64, value("mono", "ause").expect("an area"), "the area of the figure");

    let both = experiment.replace("deviation: mono/depth", "deviation: mono/depth, confidence: edges/weight");
    std::fs::write(folder.path().join("both.yaml"), both).expect("written");
    let output = depthloom().arg("plan").arg(folder.path().join("both.yaml")).output().expect("the binary starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && stderr.contains("both `deviation` and `confidence`"), "{stderr}");
}

#[test]
fn labels_are_shown_in_tables_and_figures_and_change_no_result() {
    const LABELS: &str = "labels:
  estimates: { smooth: Median (3 x 3), raw: }
  variants: { block=9+uniqueness=0+mode=hh: Winner }
  axes: { block: Block size, mode: { label: Paths, values: { sgbm: five, hh: eight } } }
";
    let folder = tempfile::tempdir().expect("a folder");
    let (plain, _) = run(folder.path(), SWEEP);
    let (file, labelled) = (folder.path().join("labelled.yaml"), folder.path().join("labelled"));
    std::fs::write(&file, format!("{SWEEP}{LABELS}")).expect("written");
    let output = succeed(depthloom().args(["run", "--no-page"]).arg(&file).arg("--out").arg(&labelled));
    assert!(!String::from_utf8_lossy(&output.stderr).contains("warning"), "{}", text(&output));
    let ranked = text(&table(&labelled, &["--columns", "abs_rel", "--sort", "block"]));
    for part in ["Block size", "Paths", "five", "eight", "Median (3 x 3)"] {
        assert!(ranked.contains(part), "{part} is not in {ranked}");
    }
    assert!(!ranked.contains("sgbm"), "{ranked}");
    let markdown = std::fs::read_to_string(labelled.join("table.md")).expect("a table");
    let places = ["Winner", "Block size 3"].map(|part| markdown.find(part).expect(part));
    assert!(places[0] < places[1], "the labelled variant is first: {markdown}");
    let effects = text(&table(&labelled, &["--effects", "abs_rel"]));
    assert!(effects.contains("Block size") && effects.contains("five"), "{effects}");
    let figure = folder.path().join("figure.svg");
    succeed(depthloom().arg("figure").arg(&labelled).args(["parameter", "--axes", "block", "--out"]).arg(&figure));
    let svg = std::fs::read_to_string(&figure).expect("a figure");
    assert!(svg.contains("Block size") && svg.contains("Median (3 x 3)"), "{svg}");
    // Files for programs have names and the same numbers.
    let rows = |run: &Path| -> BTreeMap<String, Row> {
        read_csv(&run.join("table.csv"))
            .into_iter()
            .map(|row| (format!("{} {}", label(&row), row["set"]), row))
            .collect()
    };
    assert_eq!(rows(&plain), rows(&labelled));
}

#[test]
fn intervals_of_groups_of_frames_match_those_of_compare_and_single_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let (run, _) = run(folder.path(), &SWEEP.replace("0..2", "0..6").replace("[hh, sgbm]", "[hh]"));
    let csv = |arguments: &[&str]| {
        let path = folder.path().join("rows.csv");
        let out =
            ["--columns", "abs_rel", "--estimates", "raw", "--format", "csv", "--out", path.to_str().expect("UTF-8")];
        table(&run, &[&out, arguments].concat());
        read_csv(&path)
    };
    let width = |row: &Row| number(row, "abs_rel_high") - number(row, "abs_rel_low");
    let (single, groups) = (csv(&["--ci"]), csv(&["--ci", "--group", "blocks:2"]));
    assert!(single.iter().zip(&groups).all(|(one, other)| one["abs_rel"] == other["abs_rel"]));
    assert!(single.iter().zip(&groups).any(|(one, other)| width(one) != width(other)));
    // Groups of one frame are frames.
    let file = folder.path().join("groups.csv");
    let frames: String =
        read_csv(&run.join("scores.csv")).iter().map(|row| format!("{},{0}\n", row["frame"])).collect();
    let frames: std::collections::BTreeSet<&str> = frames.lines().collect();
    let frames = frames.into_iter().collect::<Vec<_>>().join("\n");
    std::fs::write(&file, format!("frame,group\n{frames}\n")).expect("written");
    assert_eq!(csv(&["--ci", "--group", file.to_str().expect("UTF-8")]), single);
    let printed = text(&table(&run, &["--columns", "abs_rel", "--ci", "--group", "blocks:3"]));
    assert!(printed.contains("bootstrap over blocks of 3 frames"), "{printed}");
    assert!(refused(&run, &["--group", "sequence"]).contains("--ci"));
}
