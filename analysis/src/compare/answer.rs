//! A comparison as it is shown and written.

use depthloom_graphs::plan::VariantId;
use depthloom_graphs::{Key, counted};
use depthloom_scores::{Mean, PixelSet, Pooling};

use super::contrast::{Contrast, smallest_reachable, tests};
use super::json::{CompareMethod, OtherParameters};
use super::limit::Judged;
use super::parameters::{Changed, changed};
use super::side::{Kind, Party};
use super::{CompareOptions, Opened, Pair, few_frames};
use crate::ablation::pixels_of;
use crate::condition;
use crate::error::{AnalysisError, caught};
use crate::grid::{Grid, GridCells, GridColumn};
use crate::leading::{COMMON, Lead, Level, plan_key};
use crate::scores::averaged;
use crate::sheet::{DIMENSIONLESS, unit_of};

/// So many sides are named in a heading, and of so many parameters are shown.
const NAMED: usize = 4;
const SHOWN: usize = 12;

/// A number, and as text shows it.
type Cell = (Option<f64>, Option<String>);

/// Estimates held against others: a row a score of a pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    pub(super) grid: Grid,
    pub(super) rows: Vec<Row>,
    /// How sure numbers are, and how that was found.
    pub(super) method: CompareMethod,
    /// By other side.
    pub(super) parameters: Vec<OtherParameters>,
    pub(super) judged: Vec<Judged>,
    /// The key of the baseline's plan.
    key: Key,
}

/// A score of a pair, and of what it is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    pub(super) other: Of,
    pub(super) baseline: Of,
    pub(super) set: PixelSet,
    /// `None`: the whole image.
    pub(super) zone: Option<String>,
    pub(super) mean: Mean,
    pub(super) contrast: Contrast,
}

/// An estimate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Of {
    pub(super) run: String,
    pub(super) lead: Lead,
    pub(super) estimator: String,
}

#[expect(clippy::too_many_arguments, reason = "an answer is of each of them")]
pub(super) fn put_together(
    kind: Kind,
    opened: &[Opened<'_>],
    parties: &[Party],
    baseline: usize,
    pairs: &[Pair<'_>],
    contrasts: Vec<Contrast>,
    judged: Vec<Judged>,
    mut notes: Vec<String>,
    options: &CompareOptions,
) -> Comparison {
    let first = &parties[baseline];
    let others = || parties.iter().enumerate().filter(|(place, _)| *place != baseline).map(|(_, party)| party);
    let tests = tests(&contrasts.iter().collect::<Vec<_>>());
    let method = CompareMethod::new(&options.resampling, tests);
    let rows: Vec<Row> = contrasts.into_iter().map(|contrast| row(&pairs[contrast.pair], contrast, options)).collect();
    notes.extend(said_of(pairs, &rows, options));
    if options.baseline.as_deref() == Some("best") && first.title != "best" {
        let title = &first.title;
        notes.push(format!(
            "{title} was chosen for its scores on these frames: against it, others look worse than they are"
        ));
    }
    for Opened { run, .. } in opened {
        let prefix = if opened.len() > 1 { format!("{}: ", run.called) } else { String::new() };
        notes.extend(condition::told(run.recording, &[], true).notes.into_iter().map(|note| format!("{prefix}{note}")));
    }
    let parameters = others()
        .map(|party| OtherParameters { side: party.title.clone(), differences: parameters(opened, first, party) })
        .collect();
    let mut grid = Grid {
        about: about(kind, first, &others().collect::<Vec<_>>(), pairs, &rows, &method, options),
        label: [
            vec![format!("{}-compared-{}", opened[first.run].run.recording.plan().experiment, first.title)],
            options.selection.label(),
            options.scores.clone(),
        ]
        .concat()
        .join("-"),
        notes,
        ..Grid::default()
    };
    let shown = Shown { kind, parties, pairs, rows: &rows };
    grid.starts = (0..rows.len()).filter(|&row| row == 0 || shown.pair(row) != shown.pair(row - 1)).collect();
    let is_long = grid.starts.len() < rows.len();
    grid.gaps = if is_long { grid.starts.clone() } else { Vec::new() };
    grid.columns = shown.columns(options);
    grid.typeset(&options.typesetting);
    let key = plan_key(opened[first.run].run.recording.plan());
    Comparison { grid, rows, method, parameters, judged, key }
}

fn row(pair: &Pair<'_>, contrast: Contrast, options: &CompareOptions) -> Row {
    let of = |of: &super::ScoredBy<'_>| Of {
        run: of.run.called.to_owned(),
        lead: of.estimator.lead.clone(),
        estimator: of.estimator.name.clone(),
    };
    Row {
        other: of(&pair.other),
        baseline: of(&pair.baseline),
        set: pair.set,
        zone: options.selection.zone.clone(),
        mean: pair.mean(options),
        contrast,
    }
}

/// What was set otherwise in a side.
fn parameters(opened: &[Opened<'_>], first: &Party, other: &Party) -> Vec<Changed> {
    let plan = |party: &Party| opened[party.run].run.recording.plan();
    let variant = |party: &Party| {
        let label = party.entries.first().filter(|_| party.variant.is_none()).map(|(_, label)| label)?;
        let of = opened[party.run].estimators.iter().find(|of| of.label == *label)?.lead.variant.as_ref()?;
        plan(party).variants.iter().position(|name| name == of).map(VariantId)
    };
    // Of an estimator, those of its variant; a run has all of its variants.
    let is_run = first.entries.iter().any(|(name, label)| name == label);
    let of = |party: &Party| if is_run { None } else { party.variant.or_else(|| variant(party)) };
    changed((plan(first), of(first)), (plan(other), of(other)))
}

/// What is to be said of frames and pixels.
fn said_of(pairs: &[Pair<'_>], rows: &[Row], options: &CompareOptions) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    let mut note = |text: String| {
        if !notes.contains(&text) {
            notes.push(text);
        }
    };
    for pair in pairs {
        let (paired, all) = (&pair.paired, pair.paired.frames.len());
        let stage = pair.other.stage();
        if paired.only_baseline + paired.only_other > 0 {
            note(format!(
                "stage {stage}: {all} frames are in both; {} in the baseline alone and {} in the other alone do not count",
                paired.only_baseline, paired.only_other
            ));
        }
        if paired.other_values > 0 {
            note(format!(
                "stage {stage}: on {} of {all} frames the source's values are not the same",
                paired.other_values
            ));
        }
        let label = &pair.other.estimator.label;
        if paired.other_truth > 0 && pair.set != PixelSet::Answered {
            note(format!("{label}: on {} of {all} frames other true pixels were scored", paired.other_truth));
        }
        if !pair.is_scored_alike(options) {
            let (one, two) = (&pair.baseline.estimator.preset, &pair.other.estimator.preset);
            note(format!(
                "{label} and its baseline were scored in different ways ({two}; {one}): differences are of the scoring too"
            ));
        }
    }
    if pairs.iter().any(|pair| pair.set == PixelSet::Answered) {
        note("each is over the pixels that it answered itself, so differences are of the pixels too: look at density, or take `--set common`".to_owned());
    }
    let of_answers = rows.iter().filter(|row| row.set == PixelSet::All);
    for row in of_answers.filter(|row| row.contrast.metric.pooling == Pooling::MeanOfAnswers) {
        note(format!(
            "{} leaves out what was not answered, also over all true pixels: take `--set filled`",
            row.contrast.metric.name
        ));
    }
    for row in rows.iter().filter(|row| row.contrast.is_identical) {
        let label = &pairs[row.contrast.pair].other.estimator.label;
        note(format!("{label} is the same on both sides: it is not tested"));
    }
    let contrasts: Vec<&Contrast> = rows.iter().map(|row| &row.contrast).collect();
    let level = 1.0 - options.resampling.confidence;
    if let Some(p) = smallest_reachable(&contrasts).filter(|p| *p >= level) {
        let (tests, frames) = (tests(&contrasts), contrasts.iter().map(|of| of.frames).max().unwrap_or(0));
        note(format!(
            "no verdict is possible: with {} of {} the smallest p_holm that can be reached is {p:.3}, not below {}; take more frames, or fewer sides or `--scores`",
            counted(tests, "test"),
            counted(frames, "frame"),
            (level * 1e8).round() / 1e8,
        ));
    }
    let least = contrasts.iter().map(|of| of.frames).min().unwrap_or(0);
    few_frames(least).into_iter().for_each(&mut note);
    notes
}

/// What the numbers are.
fn about(
    kind: Kind,
    first: &Party,
    others: &[&Party],
    pairs: &[Pair<'_>],
    rows: &[Row],
    method: &CompareMethod,
    options: &CompareOptions,
) -> String {
    let once = |texts: &mut dyn Iterator<Item = String>| {
        let mut known: Vec<String> = Vec::new();
        texts.for_each(|text| {
            if !known.contains(&text) {
                known.push(text);
            }
        });
        known.join(" and ")
    };
    let titles: Vec<&str> = others.iter().map(|party| party.title.as_str()).collect();
    let titles = match (titles.len(), kind) {
        (..=NAMED, _) => titles.join(", "),
        (many, Kind::Runs) => format!("{many} runs"),
        (many, Kind::Variants) => format!("{many} variants"),
        (many, Kind::Estimators) => format!("{many} estimators"),
    };
    let pixels = once(&mut pairs.iter().map(|pair| match &options.selection.zone {
        _ if options.selection.common => "the true pixels that all answered".to_owned(),
        None => pixels_of(pair.set).to_owned(),
        Some(zone) => format!("{} of zone {zone}", pixels_of(pair.set)),
    }));
    let presets = once(&mut pairs.iter().map(|pair| pair.other.estimator.preset.clone()));
    let (least, most) = rows
        .iter()
        .fold((usize::MAX, 0), |(least, most), row| (least.min(row.contrast.frames), most.max(row.contrast.frames)));
    let mean = averaged(least as u64..=most as u64, |mean| rows.iter().all(|row| row.mean == mean));
    let (tests, level) = (method.tests, (100.0 - 100.0 * method.confidence) / 100.0);
    let level = (level * 1e8).round() / 1e8;
    let tested = counted(tests, "test");
    format!(
        "{titles} against {}: {pixels}, {presets}, {mean}; interval of the difference: {}; p: Wilcoxon signed rank over frames, two-sided; \
         p_holm: corrected for the {tested} here; verdict: p_holm below {level} and an interval without 0",
        first.title,
        options.resampling.about(),
    )
}

/// What columns are made of.
struct Shown<'a> {
    kind: Kind,
    parties: &'a [Party],
    pairs: &'a [Pair<'a>],
    rows: &'a [Row],
}

impl Shown<'_> {
    fn pair(&self, row: usize) -> usize {
        self.rows[row].contrast.pair
    }

    fn columns(&self, options: &CompareOptions) -> Vec<GridColumn> {
        let text = |of: &dyn Fn(&Row) -> Option<String>| self.rows.iter().map(of).collect::<Vec<_>>();
        let in_files = |name: &str, of: &dyn Fn(&Row) -> Option<String>| GridColumn {
            only_in_files: true,
            ..GridColumn::key(name, text(of))
        };
        let contrast = |of: &dyn Fn(&Contrast) -> Cell| {
            let (values, texts) = self.rows.iter().map(|row| of(&row.contrast)).unzip();
            GridCells::Written { values, texts }
        };
        let count = |of: &dyn Fn(&Contrast) -> u64| {
            GridCells::Count(self.rows.iter().map(|row| Some(of(&row.contrast))).collect())
        };
        let hidden = |name: &str, cells| GridColumn { only_in_files: true, ..GridColumn::of(name, cells) };
        let shown = |name: &str, latex, cells| GridColumn { latex, ..GridColumn::of(name, cells) };
        let in_text = |name: String, of: &dyn Fn(&Contrast) -> String| GridColumn {
            only_in_text: true,
            ..GridColumn::of(name, GridCells::Text(self.rows.iter().map(|row| Some(of(&row.contrast))).collect()))
        };
        let decimals = |of: &Contrast| options.typesetting.decimals.unwrap_or(of.metric.decimals + 1);
        let plain = |value: f64, of: &Contrast| format!("{value:.*}", decimals(of));
        let signed = |value: f64, of: &Contrast| format!("{value:+.*}", decimals(of));
        let number = |of: &dyn Fn(&Contrast) -> f64| contrast(&|row| (Some(of(row)), Some(plain(of(row), row))));

        let mut columns = vec![
            in_files("stage", &|row| Some(row.other.lead.stage.clone())),
            in_files("variant", &|row| row.other.lead.variant.clone()),
            in_files("estimator", &|row| Some(row.other.estimator.clone())),
            in_files("set", &|row| Some(set_name(row.set, options).to_owned())),
        ];
        columns.extend(self.axes());
        columns.extend([
            in_files("run", &|row| Some(row.other.run.clone())),
            in_files("baseline_run", &|row| Some(row.baseline.run.clone())),
            in_files("baseline_stage", &|row| Some(row.baseline.lead.stage.clone())),
            in_files("baseline_variant", &|row| row.baseline.lead.variant.clone()),
            in_files("baseline_estimator", &|row| Some(row.baseline.estimator.clone())),
            in_files("zone", &|row| row.zone.clone()),
            in_files("mean", &|row| Some(mean_name(row.mean).to_owned())),
        ]);
        columns.extend(self.names());
        columns.push(GridColumn::key("score", text(&|row| Some(row.contrast.metric.name.to_owned()))));
        columns.push(in_files("unit", &|row| Some(unit_of(row.contrast.metric).to_owned())));
        let are_many = self.rows.iter().any(|row| row.contrast.frames != self.rows[0].contrast.frames);
        columns
            .push(GridColumn { only_in_files: !are_many, ..GridColumn::of("frames", count(&|of| of.frames as u64)) });
        columns.extend([
            shown("baseline", None, number(&|of| of.baseline)),
            shown("value", None, number(&|of| of.value)),
            shown("difference", None, contrast(&|of| (Some(of.difference()), Some(signed(of.difference(), of))))),
            GridColumn {
                joins: true,
                ..in_text(format!("{} interval", options.resampling.level()), &|of| match of.interval {
                    Some(interval) => format!("[{}, {}]", signed(interval.low, of), signed(interval.high, of)),
                    None => "-".to_owned(),
                })
            },
            hidden("difference_low", contrast(&|of| (of.interval.map(|of| of.low), None))),
            hidden("difference_high", contrast(&|of| (of.interval.map(|of| of.high), None))),
            GridColumn {
                unit: Some(DIMENSIONLESS),
                ..shown(
                    "change",
                    None,
                    contrast(&|of| (Some(of.change()), Some(format!("{:+.1} %", 100.0 * of.change())))),
                )
            },
            in_text("win/tie/loss".to_owned(), &|of| format!("{}/{}/{}", of.wins, of.ties, of.losses)),
            hidden("wins", count(&|of| of.wins)),
            hidden("ties", count(&|of| of.ties)),
            hidden("losses", count(&|of| of.losses)),
            shown("p", Some("$p$"), contrast(&|of| (of.test.map(|of| of.p), of.test.map(|of| probability(of.p))))),
            in_files("p_from", &|row| Some(row.contrast.test?.distribution.name().to_owned())),
            shown("p_holm", Some("$p$ (Holm)"), contrast(&|of| (of.p_holm, of.p_holm.map(probability)))),
            GridColumn::of("verdict", GridCells::Text(text(&|row| Some(row.contrast.verdict.name().to_owned())))),
        ]);
        columns
    }

    /// The axes of all that is compared; one that a side's experiment does not have is empty.
    fn axes(&self) -> Vec<GridColumn> {
        let mut axes: Vec<&Level> = Vec::new();
        for level in self.rows.iter().flat_map(|row| &row.other.lead.factors) {
            if !axes.iter().any(|of| of.axis == level.axis) {
                axes.push(level);
            }
        }
        let column = |axis: &Level| {
            let of = |row: &Row| row.other.lead.level(&axis.axis).cloned();
            let is_numeric = self.rows.iter().filter_map(of).all(|level| level.is_numeric);
            let cells = self.rows.iter().map(|row| of(row)?.value).collect();
            GridColumn { only_in_files: true, ..GridColumn::levels(axis.column.as_str(), cells, |_| is_numeric) }
        };
        axes.into_iter().map(column).collect()
    }

    /// What a row is of, for people: as little as tells it from others.
    fn names(&self) -> Vec<GridColumn> {
        let column = |name: &str, of: &dyn Fn(&Pair<'_>) -> String| GridColumn {
            once: true,
            only_in_text: true,
            ..GridColumn::key(name, (0..self.rows.len()).map(|row| Some(of(&self.pairs[self.pair(row)]))).collect())
        };
        let title = |pair: &Pair<'_>| self.parties[pair.party].title.clone();
        let name = |pair: &Pair<'_>| pair.name.clone();
        let several = |of: &dyn Fn(&Pair<'_>) -> String| self.pairs.iter().any(|pair| of(pair) != of(&self.pairs[0]));
        match self.kind {
            Kind::Estimators => vec![column("estimator", &title)],
            Kind::Variants if !several(&name) => vec![column("variant", &title)],
            Kind::Variants => vec![column("variant", &title), column("estimator", &name)],
            Kind::Runs if !several(&title) => vec![column("estimator", &name)],
            Kind::Runs => vec![column("run", &title), column("estimator", &name)],
        }
    }
}

/// The pixel set as all tables call it.
const fn set_name(set: PixelSet, options: &CompareOptions) -> &'static str {
    if options.selection.common { COMMON } else { set.name() }
}

const fn mean_name(mean: Mean) -> &'static str {
    match mean {
        Mean::Frames => "frames",
        Mean::Pixels => "pixels",
    }
}

fn probability(p: f64) -> String {
    if p < 1e-4 { "<0.0001".to_owned() } else { format!("{p:.4}") }
}

impl Comparison {
    /// As aligned text, with how limits are kept and the parameters that differ behind; in blocks below each other where it is wider than
    /// `width` columns of text.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        let mut text = self.grid.terminal(width);
        for (limit, is_exceeded) in self.limits() {
            text.push_str(&format!("{}: {limit}\n", if is_exceeded { "FAILS" } else { "holds" }));
        }
        let differing = self.differing();
        if !differing.is_empty() {
            text.push('\n');
        }
        for (heading, lines) in differing {
            text.push_str(&format!("{heading}\n"));
            lines.iter().for_each(|line| text.push_str(&format!("  {line}\n")));
        }
        text
    }

    /// In Markdown (GitHub's).
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = self.grid.markdown();
        for (heading, lines) in self.differing() {
            text.push_str(&format!("\n{heading}:\n\n"));
            lines.iter().for_each(|line| text.push_str(&format!("- `{line}`\n")));
        }
        for (limit, is_exceeded) in self.limits() {
            text.push_str(&format!("\n{}: `{limit}`\n", if is_exceeded { "Fails" } else { "Holds" }));
        }
        text
    }

    /// In LaTeX, for the package `booktabs`, with caption and label.
    #[must_use]
    pub fn latex(&self) -> String {
        self.grid.latex()
    }

    /// As CSV: all digits, an empty field where there is no value.
    #[must_use]
    pub fn csv(&self) -> Vec<u8> {
        self.grid.sheet().csv()
    }

    /// The bytes of a Parquet file with the columns of [`Comparison::csv`].
    ///
    /// # Errors
    /// If polars makes none of them.
    pub fn parquet(&self) -> Result<Vec<u8>, AnalysisError> {
        caught(|| self.grid.sheet().parquet("compared", &self.key).map_err(AnalysisError::compute("the comparison")))
    }

    /// The limits that are exceeded, each with what exceeds it.
    #[must_use]
    pub fn exceeded(&self) -> Vec<String> {
        self.limits().into_iter().filter(|(_, is_exceeded)| *is_exceeded).map(|(text, _)| text).collect()
    }

    fn limits(&self) -> Vec<(String, bool)> {
        let told = |judged: &Judged| {
            let row = &self.rows[judged.contrast];
            let Of { lead, estimator, .. } = &row.other;
            let label =
                lead.variant.as_ref().map_or_else(|| estimator.clone(), |variant| format!("{variant}/{estimator}"));
            let name = judged.measure.name();
            let change = match judged.is_relative {
                true => format!("{:+.2} %", judged.change),
                false => format!("{:+.*}", judged.measure.decimals(), judged.change),
            };
            (format!("{} ({label} {name}: {change})", judged.limit), judged.is_exceeded)
        };
        self.judged.iter().map(told).collect()
    }

    /// By side, the parameters that differ: as many as are read, of all sides together.
    fn differing(&self) -> Vec<(String, Vec<String>)> {
        let mut told = Vec::new();
        let differs = |side: &&OtherParameters| !side.differences.is_empty();
        let sides = self.parameters.iter().filter(differs).count();
        let most = (SHOWN / sides.max(1)).max(1);
        for OtherParameters { side, differences } in self.parameters.iter().take(SHOWN).filter(differs) {
            let mut lines: Vec<String> = differences.iter().take(most).map(Changed::text).collect();
            if differences.len() > most {
                lines.push(format!("and {} more, which --json lists", differences.len() - most));
            }
            told.push((format!("{side} differs in"), lines));
        }
        if self.parameters.len() > SHOWN {
            let more = self.parameters.len() - SHOWN;
            told.push((format!("and {more} more sides, which --json lists"), Vec::new()));
        }
        told
    }
}
