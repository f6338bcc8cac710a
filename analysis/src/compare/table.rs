//! A comparison as a table, with limits and parameters below it.

use depthloom_graphs::plan::VariantId;
use depthloom_graphs::{Key, counted};
use depthloom_scores::{PixelSet, Pooling};

use super::contrast::{Contrast, smallest_reachable, tests};
use super::limit::JudgedLimit;
use super::output::{CompareMethod, ComparisonOutput, OtherParameters};
use super::side::{Kind, Party};
use super::{CompareOptions, Pair, RunScores, few_frames, significance};
use crate::ablation::pixels_in_words;
use crate::error::AnalysisError;
use crate::input::condition::recording_notes;
use crate::input::parameters::{Changed, changed};
use crate::scores::averaged;
use crate::statistics::Interval;
use crate::tables::{COMMON, Column, DIMENSIONLESS, Level, Rows, Table, plan_key, unit_of};
use crate::titles::Titles;

/// The maximum number of sides in a heading, and of parameters below the table.
const NAMED: usize = 4;
const SHOWN: usize = 12;

/// Estimates compared with others: a row per score of a pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The table; [`Comparison::terminal`] and [`Comparison::markdown`] have more.
    pub table: Table,
    /// The JSON output, with the columns of the table's CSV form.
    pub output: ComparisonOutput,
    /// The key of the baseline's plan.
    key: Key,
}

/// Sides with the results of their pairs.
pub(super) struct Compared<'a> {
    pub(super) kind: Kind,
    pub(super) run_scores: &'a [RunScores<'a>],
    pub(super) parties: &'a [Party],
    /// The place of the baseline among the parties.
    pub(super) baseline: usize,
    pub(super) pairs: &'a [Pair<'a>],
    pub(super) contrasts: &'a [Contrast],
    pub(super) options: &'a CompareOptions,
}

impl<'a> Compared<'a> {
    /// Builds the comparison. `notes` are the notes on sides without a pair.
    pub(super) fn comparison(&self, limits: Vec<JudgedLimit>, mut notes: Vec<String>) -> Comparison {
        let (options, contrasts) = (self.options, self.contrasts);
        let first = &self.parties[self.baseline];
        let plan = self.run_scores[first.run].run.recording.plan();
        notes.extend(self.notes());
        if options.baseline.as_deref() == Some("best") && first.title != "best" {
            let title = &first.title;
            notes.push(format!(
                "{title} was chosen because it was best on the same frames, so the other sides look worse than they are"
            ));
        }
        for RunScores { run, .. } in self.run_scores {
            let prefix = if self.run_scores.len() > 1 { format!("{}: ", run.called) } else { String::new() };
            let recording_notes = recording_notes(run.recording);
            notes.extend(recording_notes.into_iter().map(|note| format!("{prefix}{note}")));
        }
        let method = CompareMethod::new(&options.resampling, options.grouping.as_ref(), tests(contrasts));
        let compared_with = vec![format!("{}-compared-{}", plan.experiment, first.title)];
        let starts: Vec<usize> =
            (0..contrasts.len()).filter(|&row| row == 0 || contrasts[row].pair != contrasts[row - 1].pair).collect();
        let mut table = Table {
            about: self.about(&method),
            label: [compared_with, options.selection.label(), options.scores.clone()].concat().join("-"),
            gaps: if starts.len() < contrasts.len() { starts.clone() } else { Vec::new() },
            starts,
            notes,
            ..Table::new(self.columns())
        };
        Titles::new(self.run_scores.iter().map(|scores| scores.run.recording.plan())).apply(&mut table);
        table.typeset(&options.typesetting);
        let parameters = self
            .others()
            .map(|party| OtherParameters { side: party.title.clone(), differences: self.parameters(first, party) });
        let output = ComparisonOutput {
            about: table.about.clone(),
            method,
            verdicts: contrasts.iter().map(|contrast| contrast.verdict).collect(),
            parameters: parameters.collect(),
            rows: table.json_rows(),
            limits,
            notes: table.notes.clone(),
        };
        Comparison { table, output, key: plan_key(plan) }
    }

    fn others(&self) -> impl Iterator<Item = &'a Party> {
        self.parties.iter().enumerate().filter(|(place, _)| *place != self.baseline).map(|(_, party)| party)
    }

    fn pair(&self, contrast: &Contrast) -> &'a Pair<'a> {
        &self.pairs[contrast.pair]
    }

    /// The parameters of a side that differ from the baseline.
    fn parameters(&self, first: &Party, other: &Party) -> Vec<Changed> {
        let plan = |party: &Party| self.run_scores[party.run].run.recording.plan();
        // An estimate has the parameters of its variant; a run has those of all variants.
        let is_run = first.entries.iter().any(|(name, label)| name == label);
        let variant_of_estimate = |party: &Party| {
            let (_, label) = party.entries.first()?;
            let estimates = &self.run_scores[party.run].estimates;
            let variant = estimates.iter().find(|estimate| estimate.label == *label)?.row_key.variant.as_ref()?;
            plan(party).variants.iter().position(|name| name == variant).map(VariantId)
        };
        let variant = |party: &Party| if is_run { None } else { party.variant.or_else(|| variant_of_estimate(party)) };
        changed((plan(first), variant(first)), (plan(other), variant(other)))
    }

    /// Notes on frames and pixels.
    fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = Vec::new();
        for pair in self.pairs {
            let (paired, all) = (&pair.paired, pair.paired.frames.len());
            let stage = pair.other.stage();
            if paired.only_baseline + paired.only_other > 0 {
                notes.push(format!(
                    "stage {stage}: {all} frames are in both; {} frames only in the baseline and {} only in the other are excluded",
                    paired.only_baseline, paired.only_other
                ));
            }
            if paired.other_values > 0 {
                notes.push(format!(
                    "stage {stage}: on {} of {all} frames the source values differ",
                    paired.other_values
                ));
            }
            let label = &pair.other.estimate.label;
            if paired.other_truth > 0 && pair.set != PixelSet::Valid {
                notes.push(format!(
                    "{label}: on {} of {all} frames different pixels with ground truth were scored",
                    paired.other_truth
                ));
            }
            if !pair.is_scored_alike(self.options) {
                let (one, two) = (&pair.baseline.estimate.preset, &pair.other.estimate.preset);
                notes.push(format!(
                    "{label} and its baseline were scored in different ways ({two}; {one}): differences also include the difference of scoring"
                ));
            }
        }
        if self.pairs.iter().any(|pair| pair.set == PixelSet::Valid) {
            notes.push("each side covers its own valid pixels, so differences are partly differences of pixels: compare density, or use `--pixels common`".to_owned());
        }
        for Contrast { metric, .. } in self.contrasts.iter().filter(|contrast| self.pair(contrast).set == PixelSet::All)
        {
            if metric.pooling == Pooling::MeanOfValid {
                let name = metric.name;
                notes.push(format!(
                    "{name} excludes invalid pixels, also over all pixels with ground truth: use `--pixels filled`"
                ));
            }
        }
        for contrast in self.contrasts.iter().filter(|contrast| contrast.is_identical) {
            let label = &self.pair(contrast).other.estimate.label;
            notes.push(format!("{label} is identical on both sides, so it is not tested"));
        }
        let units = || self.contrasts.iter().map(|contrast| contrast.units);
        let unit = if self.options.grouping.is_some() { "group" } else { "frame" };
        let resampling = &self.options.resampling;
        if let Some(p) = smallest_reachable(self.contrasts).filter(|p| *p >= 1.0 - resampling.confidence) {
            notes.push(format!(
                "no verdict is possible: with {} of {} the smallest possible p_holm is {p:.3}, not below {}; use more {unit}s, fewer sides or fewer `--metrics`",
                counted(tests(self.contrasts), "test"),
                counted(units().max().unwrap_or(0), unit),
                significance(resampling),
            ));
        }
        notes.extend(few_frames(units().min().unwrap_or(0), unit));
        distinct(notes)
    }

    /// Describes the numbers.
    fn about(&self, method: &CompareMethod) -> String {
        let selection = &self.options.selection;
        let labels = Titles::new(self.run_scores.iter().map(|scores| scores.run.recording.plan()));
        let titles: Vec<&str> = self.others().map(|party| labels.side(&party.title)).collect();
        let titles = match (titles.len(), self.kind) {
            (..=NAMED, _) => titles.join(", "),
            (many, Kind::Runs) => format!("{many} runs"),
            (many, Kind::Variants) => format!("{many} variants"),
            (many, Kind::Estimates) => format!("{many} estimates"),
        };
        let pixels = self.pairs.iter().map(|pair| match &selection.zone {
            _ if selection.common => "the pixels with ground truth that are valid in all".to_owned(),
            None => pixels_in_words(pair.set).to_owned(),
            Some(zone) => format!("{} of zone {zone}", pixels_in_words(pair.set)),
        });
        let presets = self.pairs.iter().map(|pair| pair.other.estimate.preset.clone());
        let frames = || self.contrasts.iter().map(|contrast| contrast.frames as u64);
        let frames = frames().min().unwrap_or(0)..=frames().max().unwrap_or(0);
        let is_all = |mean| self.contrasts.iter().all(|contrast| self.pair(contrast).mean(self.options) == mean);
        let over = match &self.options.grouping {
            None => "frames".to_owned(),
            Some(grouping) => {
                let units: Vec<usize> = self.contrasts.iter().map(|contrast| contrast.units).collect();
                grouping.counted(units.iter().max().copied().unwrap_or(0))
            }
        };
        let test = match method.tests {
            0 => "nothing was tested, because no value differs".to_owned(),
            tests => format!(
                "p: Wilcoxon signed rank over {over}, two-sided; p_holm: corrected for the {} here; verdict: p_holm below {} and an interval without 0",
                counted(tests, "test"),
                significance(&self.options.resampling),
            ),
        };
        format!(
            "{titles} compared with {}: {}, {}, {}; interval of the difference: {}; {test}",
            labels.side(&self.parties[self.baseline].title),
            distinct(pixels).join(" and "),
            distinct(presets).join(" and "),
            averaged(frames, is_all),
            self.options.resampling.about_units(&over),
        )
    }

    fn columns(&self) -> Vec<Column> {
        let (rows, options) = (Rows(self.contrasts), self.options);
        let other = |of: &Contrast| &self.pair(of).other;
        let baseline = |of: &Contrast| &self.pair(of).baseline;
        let decimals = |of: &Contrast| options.typesetting.decimals.unwrap_or(of.metric.decimals + 1);
        let plain = |of: &Contrast, value: f64| (value, format!("{value:.*}", decimals(of)));
        let signed = |of: &Contrast, value: f64| format!("{value:+.*}", decimals(of));
        let probability = |p: f64| (p, if p < 1e-4 { "<0.0001".to_owned() } else { format!("{p:.4}") });
        let interval = |of: &Contrast| match of.interval {
            Some(Interval { low, high }) => format!("[{}, {}]", signed(of, low), signed(of, high)),
            None => "-".to_owned(),
        };
        let frames = rows.count("frames", |of| of.frames as u64);
        let differ_in_frames = self.contrasts.iter().any(|of| of.frames != self.contrasts[0].frames);

        let mut columns = vec![
            rows.key("stage", |of| &other(of).estimate.row_key.stage).in_files(),
            rows.key("variant", |of| other(of).estimate.row_key.variant.as_ref()).in_files(),
            rows.key("estimate", |of| &other(of).estimate.name).in_files(),
            rows.key("set", |of| if options.selection.common { COMMON } else { self.pair(of).set.name() }).in_files(),
        ];
        columns.extend(self.axes());
        columns.extend([
            rows.key("run", |of| other(of).run.called).in_files(),
            rows.key("baseline_run", |of| baseline(of).run.called).in_files(),
            rows.key("baseline_stage", |of| &baseline(of).estimate.row_key.stage).in_files(),
            rows.key("baseline_variant", |of| baseline(of).estimate.row_key.variant.as_ref()).in_files(),
            rows.key("baseline_estimate", |of| &baseline(of).estimate.name).in_files(),
            rows.key("zone", |_| options.selection.zone.as_ref()).in_files(),
            rows.key("mean", |of| self.pair(of).mean(options).name()).in_files(),
        ]);
        columns.extend(self.names());
        columns.extend([
            rows.key("score", |of| of.metric.name),
            rows.key("unit", |of| unit_of(of.metric)).in_files(),
            if differ_in_frames { frames } else { frames.in_files() },
            rows.written("baseline", |of| Some(plain(of, of.baseline))),
            rows.written("value", |of| Some(plain(of, of.value))),
            rows.written("difference", |of| Some((of.difference(), signed(of, of.difference())))),
            rows.text(format!("{} interval", options.resampling.level()), interval).in_text().joins(),
            rows.number("difference_low", |of| of.interval.map(|interval| interval.low)).in_files(),
            rows.number("difference_high", |of| of.interval.map(|interval| interval.high)).in_files(),
            rows.written("change", |of| Some((of.change(), format!("{:+.1} %", 100.0 * of.change()))))
                .unit(DIMENSIONLESS),
            rows.text("win/tie/loss", |of| format!("{}/{}/{}", of.wins, of.ties, of.losses)).in_text(),
            rows.count("wins", |of| of.wins).in_files(),
            rows.count("ties", |of| of.ties).in_files(),
            rows.count("losses", |of| of.losses).in_files(),
            rows.written("p", |of| Some(probability(of.test?.p))).latex("$p$"),
            rows.key("p_from", |of| Some(of.test?.distribution.name())).in_files(),
            rows.written("p_holm", |of| of.p_holm.map(probability)).latex("$p$ (Holm)"),
            rows.text("verdict", |of| of.verdict.name()),
        ]);
        columns
    }

    /// The axes of all compared sides; empty for a side whose experiment lacks the axis.
    fn axes(&self) -> Vec<Column> {
        let factors = |of: &Contrast| &self.pair(of).other.estimate.row_key.factors;
        let mut axes: Vec<&Level> = Vec::new();
        for level in self.contrasts.iter().flat_map(factors) {
            if !axes.iter().any(|known| known.axis == level.axis) {
                axes.push(level);
            }
        }
        let column = |axis: &Level| {
            let level = |of: &Contrast| factors(of).iter().find(|level| level.axis == axis.axis);
            let is_numeric = self.contrasts.iter().filter_map(level).all(|level| level.is_numeric);
            let cells = self.contrasts.iter().map(|of| level(of)?.value.clone());
            Column::levels(&axis.column, cells, |_| is_numeric).axis().in_files()
        };
        axes.into_iter().map(column).collect()
    }

    /// The columns that identify a row in text, as few as possible.
    fn names(&self) -> Vec<Column> {
        let rows = Rows(self.contrasts);
        let title = |name: &str| rows.key(name, |of| &self.parties[self.pair(of).party].title).once().in_text();
        let name = rows.key("estimate", |of| &self.pair(of).name).once().in_text();
        let has_several_names = self.pairs.iter().any(|pair| pair.name != self.pairs[0].name);
        let has_several_titles = self.pairs.iter().any(|pair| pair.party != self.pairs[0].party);
        match self.kind {
            Kind::Estimates => vec![title("estimate")],
            Kind::Variants if !has_several_names => vec![title("variant")],
            Kind::Variants => vec![title("variant"), name],
            Kind::Runs if !has_several_titles => vec![name],
            Kind::Runs => vec![title("run"), name],
        }
    }
}

/// The distinct texts, in their order.
fn distinct(texts: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut known: Vec<String> = Vec::new();
    for text in texts {
        if !known.contains(&text) {
            known.push(text);
        }
    }
    known
}

impl Comparison {
    /// As aligned text, followed by the limits and the parameters that differ. A table wider than `width` columns is
    /// split into blocks.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        let mut text = self.table.terminal(width);
        for limit in &self.output.limits {
            text.push_str(&format!(
                "{}: {}\n",
                if limit.exceeded { "limit exceeded" } else { "within limit" },
                limit.text
            ));
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
        let mut text = self.table.markdown();
        for (heading, lines) in self.differing() {
            text.push_str(&format!("\n{heading}:\n\n"));
            lines.iter().for_each(|line| text.push_str(&format!("- `{line}`\n")));
        }
        for limit in &self.output.limits {
            text.push_str(&format!("\n{}: `{}`\n", if limit.exceeded { "Fails" } else { "Holds" }, limit.text));
        }
        text
    }

    /// The bytes of a Parquet file with the columns of its CSV form.
    ///
    /// # Errors
    /// If polars fails.
    pub fn parquet(&self) -> Result<Vec<u8>, AnalysisError> {
        self.table.parquet("compared", &self.key)
    }

    /// The exceeded limits, each with the change that exceeds it.
    #[must_use]
    pub fn exceeded(&self) -> Vec<String> {
        self.output.limits.iter().filter(|limit| limit.exceeded).map(|limit| limit.text.clone()).collect()
    }

    /// For each side, the first parameters that differ.
    fn differing(&self) -> Vec<(String, Vec<String>)> {
        let mut sections = Vec::new();
        let differs = |side: &&OtherParameters| !side.differences.is_empty();
        let sides = self.output.parameters.iter().filter(differs).count();
        let most = (SHOWN / sides.max(1)).max(1);
        for OtherParameters { side, differences } in self.output.parameters.iter().take(SHOWN).filter(differs) {
            let mut lines: Vec<String> = differences.iter().take(most).map(Changed::text).collect();
            if differences.len() > most {
                lines.push(format!("and {} more (all with `--json`)", differences.len() - most));
            }
            sections.push((format!("{side} differs in"), lines));
        }
        if self.output.parameters.len() > SHOWN {
            let more = self.output.parameters.len() - SHOWN;
            sections.push((format!("and {more} more sides (all with `--json`)"), Vec::new()));
        }
        sections
    }
}
