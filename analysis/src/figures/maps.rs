//! Frames as the paper shows them (Martins et al. 2018, figures 4 and 5), one beside the other: the image, the estimates in one scale of colours, the
//! weight, the difference of two estimates' errors, the truth.

use depthloom_graphs::plan::{FrameIndex, RunId, VariantId};
use std::collections::BTreeMap;

use depthloom_figures::{
    Anchor, Axis, BLACK, Bar, DIVERGING, Drawing, HEADING_PT, LABEL_PT, Mark, POINTS_PER_INCH, SEQUENTIAL, Stroke,
    TICK_PT, Text, as_scored, ascent, bars_room, coloured, draw_bars, fitting, reduced, width,
};
use depthloom_graphs::values::Raster;
use depthloom_graphs::{Value, ValueType};
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_scores::{Align, Settings};

use super::{Figure, FigureRequest, FigureRun, wrong_size};
use crate::ablation::listed;
use crate::analyse::is_any;
use crate::error::AnalysisError;
use crate::estimators::{Estimator, estimators};
use crate::grid::{Grid, GridCells, GridColumn};

/// So many frames are shown where none are named, and at most.
const SHOWN: usize = 5;
const MOST: usize = 40;
const MARGIN: f64 = 5.0;
const GAP: f64 = 2.0;
/// The nearest distance that has a colour of its own, metres.
const NEAR_M: f64 = 2.0;
/// Of errors' difference so many per cent are within the scale.
const SCALE_PERCENT: f64 = 0.95;

/// A row of the figure.
enum Row {
    Image {
        topic: usize,
    },
    Depth {
        name: String,
        topic: usize,
    },
    Weight {
        topic: usize,
    },
    /// The error of the first less that of the second.
    Difference {
        names: [String; 2],
        topics: [usize; 2],
    },
}

/// What is read of a stage.
struct Shown {
    run: RunId,
    topics: Vec<String>,
    rows: Vec<Row>,
    truth: usize,
    settings: Settings,
    variant: Option<String>,
    /// By topic of an estimate that is aligned before it is scored: how.
    aligned: BTreeMap<usize, Settings>,
}

pub(super) fn panels(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let shown = Shown::of(run.recording, request)?;
    let positions = positions(run.recording, &shown, request)?;
    let mut reader = run.recording.reader(shown.run, &shown.topics)?;
    let mut frames: Vec<(FrameIndex, Vec<Option<Value>>)> = Vec::new();
    for position in positions {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        frames.push((position, shown.as_scored(reader.read(position)?)));
    }
    shown.drawn(run.recording, &frames, request)
}

impl Shown {
    fn of(recording: &Recording, request: &FigureRequest) -> Result<Self, AnalysisError> {
        let plan = recording.plan();
        let all = estimators(plan)?;
        let is = |patterns: &Option<String>, texts: &[&str]| {
            patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
        };
        let kept = |of: &&Estimator| {
            of.settings.is_some()
                && of.estimate_topic.is_some()
                && of.truth_topic.is_some()
                && is(&request.stages, &[&of.lead.stage])
                && is(&request.estimators, &[&of.label, &of.name])
        };
        let asked: Vec<&Estimator> = all
            .iter()
            .filter(kept)
            .filter(|of| of.lead.variant.as_deref().is_none_or(|variant| is(&request.variants, &[variant])))
            .collect();
        let Some(first) = asked.first() else {
            let labels = listed(all.iter().map(|of| of.label.as_str()));
            let what = "no estimate that is asked for has its depths and its truth recorded".to_owned();
            return Err(AnalysisError::asked(what, format!("there are {labels}; `record:` says what is kept")));
        };
        // Of several variants the first: maps of all of them are a figure each.
        let run = asked.iter().find(|of| of.lead.variant.is_some()).unwrap_or(first).run;
        let variant = asked.iter().filter(|of| of.run == run).find_map(|of| of.lead.variant.clone());
        let of_run: Vec<&Estimator> = asked
            .into_iter()
            .filter(|of| of.run == run && (of.lead.variant.is_none() || of.lead.variant == variant))
            .collect();
        let first = of_run[0];
        let mut shown = Self {
            run,
            topics: Vec::new(),
            rows: Vec::new(),
            truth: 0,
            settings: first.settings.unwrap_or_default(),
            variant,
            aligned: BTreeMap::new(),
        };
        shown.truth = shown.topic(first.truth_topic.as_deref().unwrap_or_default());
        if let Some(image) = image(plan, run) {
            let topic = shown.topic(&image);
            shown.rows.push(Row::Image { topic });
        }
        let mut depths: Vec<(String, usize)> = Vec::new();
        // As in the paper: stereo, mono, what is neither, what is fused.
        let mut in_order = of_run.clone();
        in_order.sort_by_key(|of| ["stereo", "mono", "", "fus"].iter().position(|word| is_of(&of.name, word)));
        for of in in_order {
            let topic = shown.topic(of.estimate_topic.as_deref().unwrap_or_default());
            let aligned = of.settings.filter(|settings| settings.align != Align::None);
            let name = match &aligned {
                Some(_) => format!("{}, aligned", of.name),
                None => of.name.clone(),
            };
            aligned.into_iter().for_each(|settings| _ = shown.aligned.insert(topic, settings));
            depths.push((of.name.clone(), topic));
            shown.rows.push(Row::Depth { name, topic });
        }
        if let Some(weight) = weight(plan, run, shown.variant.as_deref()) {
            let topic = shown.topic(&weight);
            shown.rows.push(Row::Weight { topic });
        }
        let of_family = |family: &str| depths.iter().find(|(name, _)| name.starts_with(family)).cloned();
        let two = match (of_family("mono"), of_family("stereo")) {
            (Some(mono), Some(stereo)) => Some([mono, stereo]),
            _ => match &depths[..] {
                [one, two, ..] => Some([one.clone(), two.clone()]),
                _ => None,
            },
        };
        if let Some([one, two]) = two {
            shown.rows.push(Row::Difference { names: [one.0, two.0], topics: [one.1, two.1] });
        }
        let topic = shown.truth;
        shown.rows.push(Row::Depth { name: "truth".to_owned(), topic });
        Ok(shown)
    }

    /// A frame's maps, estimates as they are scored.
    fn as_scored(&self, mut maps: Vec<Option<Value>>) -> Vec<Option<Value>> {
        let Some(truth) = maps[self.truth].clone() else { return maps };
        for (topic, settings) in &self.aligned {
            let aligned = maps[*topic].as_ref().and_then(|estimate| as_scored(estimate, &truth, settings));
            maps[*topic] = aligned.or_else(|| maps[*topic].take());
        }
        maps
    }

    fn topic(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }

    fn drawn(
        &self,
        recording: &Recording,
        frames: &[(FrameIndex, Vec<Option<Value>>)],
        request: &FigureRequest,
    ) -> Result<Figure, AnalysisError> {
        let depth_bar = Bar { ramp: SEQUENTIAL, axis: Axis::log(NEAR_M, self.settings.max_m, "depth, m") };
        let weight_bar = Bar { ramp: DIVERGING, axis: Axis::new(0.0, 1.0, "weight: 0 mono, 1 stereo") };
        let most = frames.iter().filter_map(|(_, maps)| self.most_difference(maps)).fold(0.1, f64::max);
        let mut bars = vec![depth_bar.clone()];
        let mut difference_bar = None;
        for row in &self.rows {
            match row {
                Row::Weight { .. } => bars.push(weight_bar.clone()),
                Row::Difference { names: [one, two], .. } => {
                    let label = format!("error, {one} − {two}, m");
                    let bar = Bar { ramp: DIVERGING, axis: Axis::new(-most, most, label) };
                    bars.push(bar.clone());
                    difference_bar = Some(bar);
                }
                Row::Image { .. } | Row::Depth { .. } => {}
            }
        }
        let (wide, high) = frames
            .iter()
            .find_map(|(_, maps)| maps.iter().flatten().find_map(size_of))
            .ok_or_else(|| AnalysisError::asked("these frames have no map".to_owned(), "name others".to_owned()))?;
        let page = request.size.width_pt();
        let names: Vec<String> = self.rows.iter().map(Row::name).collect();
        let of_names = LABEL_PT + 4.0;
        let room = page - 2.0 * MARGIN - of_names;
        let cell = (room - GAP * (frames.len() as f64 - 1.0)) / frames.len() as f64;
        if cell < 10.0 {
            return Err(wrong_size(format!("{} frames have no room side by side", frames.len())));
        }
        let cell_high = cell * f64::from(high) / f64::from(wide);
        let heading = if request.title.is_empty() { 0.0 } else { HEADING_PT + 4.0 };
        let top = MARGIN + heading + TICK_PT + 3.0;
        let rows = self.rows.len() as f64;
        let below = top + rows * (cell_high + GAP);
        let height = below + bars_room(&bars, page - 2.0 * MARGIN) + MARGIN;
        if request.size.height_mm.is_some() {
            let what = "a figure of panels has the height that its frames give it".to_owned();
            return Err(AnalysisError::asked(what, "leave --height out".to_owned()));
        }
        let mut drawing = Drawing::new(page, height);
        if !request.title.is_empty() {
            drawing.text((page / 2.0, MARGIN + ascent(HEADING_PT)), &request.title, HEADING_PT, Anchor::Middle);
        }
        // No more pixels than the maps have, or than can be seen.
        let pixels = (cell / POINTS_PER_INCH * request.dpi).round().clamp(1.0, f64::from(wide)) as u32;
        let mut table = Table::default();
        for (row, name) in self.rows.iter().zip(&names) {
            let at = self.rows.iter().position(|of| std::ptr::eq(of, row)).unwrap_or(0) as f64;
            let y = top + at * (cell_high + GAP);
            drawing.marks.push(Mark::Text(Text {
                at: (MARGIN + ascent(LABEL_PT), y + cell_high / 2.0),
                words: fitting(name, (cell_high + GAP).max(width(name, TICK_PT)), TICK_PT),
                size: if width(name, LABEL_PT) <= cell_high {
                    LABEL_PT
                } else {
                    TICK_PT * (cell_high / width(name, TICK_PT)).min(1.0)
                },
                colour: BLACK,
                anchor: Anchor::Middle,
                upwards: true,
            }));
            for (column, (position, maps)) in frames.iter().enumerate() {
                let x = MARGIN + of_names + column as f64 * (cell + GAP);
                let frame = recording.frames(self.run).get(position.0).map_or("", |frame| &frame.id);
                if at == 0.0 {
                    let (words, size) = ending(frame, cell);
                    drawing.text((x + cell / 2.0, y - 3.0), words, size, Anchor::Middle);
                }
                let picture = match row {
                    Row::Image { topic } => maps[*topic].as_ref().and_then(|value| match value {
                        Value::Image(image) => Some(reduced(image, pixels)),
                        _ => None,
                    }),
                    Row::Depth { name, topic } => depth(&maps[*topic]).map(|map| {
                        table.push(frame, name, map.as_raw().iter().copied());
                        coloured(map, pixels, &depth_bar)
                    }),
                    Row::Weight { topic } => maps[*topic].as_ref().and_then(|value| match value {
                        Value::Weight(weight) => {
                            table.push(frame, name, weight.share.as_raw().iter().copied());
                            Some(coloured(&weight.share, pixels, &weight_bar))
                        }
                        _ => None,
                    }),
                    Row::Difference { .. } => self.difference(maps).zip(difference_bar.as_ref()).map(|(map, bar)| {
                        table.push(frame, name, map.as_raw().iter().copied());
                        coloured(&map, pixels, bar)
                    }),
                };
                match picture {
                    Some(picture) => drawing.marks.push(Mark::Picture { at: (x, y), size: (cell, cell_high), picture }),
                    None => drawing.text((x + cell / 2.0, y + cell_high / 2.0), "none", TICK_PT, Anchor::Middle),
                }
                drawing.frame((x, y), (cell, cell_high), Stroke::new([150; 3], 0.3));
            }
        }
        draw_bars(&mut drawing, &bars, below, page - 2.0 * MARGIN);
        let variant = self.variant.as_ref().map(|of| format!(" of {of}")).unwrap_or_default();
        let ids = frames.iter().filter_map(|(at, _)| recording.frames(self.run).get(at.0)).map(|frame| &*frame.id);
        let ids = ids.collect::<Vec<_>>().join(", ");
        let about = format!("Frames {ids}{variant}, top to bottom: {}; white: no answer", names.join(", "));
        Ok(Figure { drawing, about, data: table.csv(), notes: Vec::new() })
    }

    /// The error of one less that of the other, metres, where there is a truth and both answered.
    fn difference(&self, maps: &[Option<Value>]) -> Option<Raster<f32>> {
        let (_, topics) = self.rows.iter().find_map(|row| match row {
            Row::Difference { names, topics } => Some((names, topics)),
            _ => None,
        })?;
        let truth = depth(&maps[self.truth])?;
        let [one, two] = topics.map(|topic| depth(&maps[topic]));
        let (one, two) = (one?, two?);
        if one.dimensions() != truth.dimensions() || two.dimensions() != truth.dimensions() {
            return None;
        }
        let (least, most) = (self.settings.min_m as f32, self.settings.max_m as f32);
        let error = |of: f32, truth: f32| (of.clamp(least, most) - truth).abs();
        let values = truth.as_raw().iter().zip(one.as_raw().iter().zip(two.as_raw()));
        let values = values.map(|(truth, (one, two))| match *truth > least && *truth < most {
            true => error(*one, *truth) - error(*two, *truth),
            false => f32::NAN,
        });
        Raster::from_raw(truth.width(), truth.height(), values.collect())
    }

    /// How far a frame's differences go, but for the few farthest.
    fn most_difference(&self, maps: &[Option<Value>]) -> Option<f64> {
        let map = self.difference(maps)?;
        let mut sizes: Vec<f32> = map.as_raw().iter().map(|of| of.abs()).filter(|of| of.is_finite()).collect();
        let last = sizes.len().checked_sub(1)?;
        let at = (SCALE_PERCENT * last as f64) as usize;
        Some(f64::from(*sizes.select_nth_unstable_by(at, f32::total_cmp).1))
    }
}

impl Row {
    fn name(&self) -> String {
        match self {
            Self::Image { .. } => "image".to_owned(),
            Self::Depth { name, .. } => name.clone(),
            Self::Weight { .. } => "weight".to_owned(),
            Self::Difference { .. } => "difference".to_owned(),
        }
    }
}

/// Whether an estimate's name begins with a word; the empty one is that of those that begin with none of them.
fn is_of(name: &str, word: &str) -> bool {
    match word {
        "" => !["stereo", "mono", "fus"].iter().any(|word| name.starts_with(word)),
        word => name.starts_with(word),
    }
}

/// A frame's id, small where it is long, and where that does not do its end: ids begin alike.
fn ending(id: &str, room: f64) -> (String, f64) {
    const SMALLEST_PT: f64 = 5.0;
    let size = (TICK_PT * room / width(id, TICK_PT).max(1e-9)).clamp(SMALLEST_PT, TICK_PT);
    let mut words = id.to_owned();
    let mut rest: Vec<char> = id.chars().collect();
    while width(&words, size) > room + 1e-6 && rest.len() > 1 {
        rest.remove(0);
        words = ['…'].iter().chain(&rest).collect();
    }
    (words, size)
}

/// The frames that are asked for.
fn positions(recording: &Recording, shown: &Shown, request: &FigureRequest) -> Result<Vec<FrameIndex>, AnalysisError> {
    let frames = recording.frames(shown.run);
    let Some(choice) = &request.frames else {
        // Those whose maps were kept.
        let every = recording.plan().every.max(1) as usize;
        let kept: Vec<FrameIndex> = FrameIndex::all(frames.len()).step_by(every).collect();
        let count = kept.len().min(SHOWN);
        return Ok((0..count).map(|at| kept[at * kept.len() / count]).collect());
    };
    let positions = choice.positions(&frames.iter().collect::<Vec<_>>())?;
    if positions.len() > MOST {
        let what = format!("{} frames are more than {MOST}", positions.len());
        return Err(AnalysisError::asked(what, "name fewer".to_owned()));
    }
    Ok(positions.into_iter().map(FrameIndex).collect())
}

/// The topic of the source's image: the left one, or the first.
fn image(plan: &RecordedPlan, run: RunId) -> Option<String> {
    let outputs = &plan.runs[run].source.outputs;
    let images = || outputs.iter().filter(|of| of.recorded && of.value_type() == Some(ValueType::Image));
    images().find(|of| of.port == "left").or_else(|| images().next()).map(|of| of.topic.clone())
}

/// The topic of the variant's weight, or of the one that all share.
fn weight(plan: &RecordedPlan, run: RunId, variant: Option<&str>) -> Option<String> {
    let place = variant.and_then(|name| plan.variants.iter().position(|of| of == name)).map(VariantId);
    let of_nodes = plan.runs[run].nodes.iter().flat_map(|node| node.outputs.iter().map(move |output| (node, output)));
    let kept: Vec<_> = of_nodes
        .filter(|(_, output)| output.recorded && !output.once && output.value_type() == Some(ValueType::Weight))
        .collect();
    let is_own = |variants: &[VariantId]| place.is_none_or(|place| variants.contains(&place));
    kept.iter().find(|(node, _)| is_own(&node.variants)).map(|(_, output)| output.topic.clone())
}

fn depth(value: &Option<Value>) -> Option<&Raster<f32>> {
    value.as_ref().and_then(Value::metres)
}

fn size_of(value: &Value) -> Option<(u32, u32)> {
    match value {
        Value::Weight(weight) => Some(weight.share.dimensions()),
        other => other.metres().map(Raster::dimensions),
    }
}

/// What maps hold: a row a frame and map.
#[derive(Default)]
struct Table {
    frames: Vec<Option<String>>,
    maps: Vec<Option<String>>,
    pixels: Vec<Option<u64>>,
    numbers: [Vec<Option<f64>>; 3],
}

impl Table {
    fn push(&mut self, frame: &str, map: &str, values: impl Iterator<Item = f32>) {
        let mut all: Vec<f32> = values.filter(|value| value.is_finite()).collect();
        all.sort_by(f32::total_cmp);
        let at = |place: usize| all.get(place).map(|value| f64::from(*value));
        let last = all.len().saturating_sub(1);
        let median = at(last / 2).zip(at(all.len() / 2)).map(|(one, two)| 0.5 * (one + two));
        self.frames.push(Some(frame.to_owned()));
        self.maps.push(Some(map.to_owned()));
        self.pixels.push(Some(all.len() as u64));
        for (column, value) in self.numbers.iter_mut().zip([at(0), median, at(last)]) {
            column.push(value);
        }
    }

    fn csv(self) -> Vec<u8> {
        let mut columns = vec![
            GridColumn::key("frame", self.frames),
            GridColumn::key("map", self.maps),
            GridColumn::of("pixels", GridCells::Count(self.pixels)),
        ];
        for (name, values) in ["least", "median", "greatest"].into_iter().zip(self.numbers) {
            let best = vec![false; values.len()];
            columns.push(GridColumn::of(name, GridCells::Number { decimals: 3, values, best }));
        }
        Grid { columns, ..Grid::default() }.sheet().csv()
    }
}
