//! Frames as in the paper (Martins et al. 2018, figures 4 and 5), side by side: the image, the estimates with one
//! colour scale, the confidence, the difference of the errors of two estimates, the ground truth.

use std::borrow::Cow;
use std::collections::BTreeMap;

use depthloom_figures::{
    Anchor, Axis, BLACK, Bar, DIVERGING, Item, Panel, SEQUENTIAL, Sheet, as_scored, coloured, reduced,
};
use depthloom_graphs::plan::{FrameIndex, RunId, VariantId};
use depthloom_graphs::values::Raster;
use depthloom_graphs::{Value, ValueType};
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_scores::quantile::quantile;
use depthloom_scores::{Align, Settings};

use super::{Figure, FigureRequest, FigureRun};
use crate::error::{AnalysisError, listed};
use crate::estimates::{Estimate, estimates};
use crate::tables::{self, Cells, Column, Format};

/// The default and the maximum number of frames.
const SHOWN: usize = 5;
const MOST: usize = 40;
/// The nearest distance of the colour scale, metres.
const NEAR_M: f64 = 2.0;
/// The share of error differences within the colour scale.
const SCALE_SHARE: f64 = 0.95;

/// A row of the figure: the topics of its maps.
enum Row {
    Image(usize),
    Depth(usize),
    Confidence(usize),
    /// The error of the first minus that of the second.
    Difference([usize; 2]),
}

/// The displayed maps of a stage run; the first topic is the ground truth.
struct PanelMaps {
    run: RunId,
    topics: Vec<String>,
    rows: Vec<(String, Row)>,
    settings: Settings,
    variant: Option<String>,
    /// The settings of estimates that are aligned before they are scored, by topic.
    aligned: BTreeMap<usize, Settings>,
}

type Maps = Vec<Option<Value>>;

pub(super) fn panels(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let shown = PanelMaps::new(run.recording, request)?;
    let mut reader = run.recording.reader(shown.run, &shown.topics)?;
    let mut frames: Vec<(&str, Maps)> = Vec::new();
    for position in positions(run.recording, shown.run, request)? {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        let id = run.recording.frames(shown.run).get(position.0).map_or("", |frame| &frame.id);
        frames.push((id, shown.as_scored(reader.read(position)?)));
    }
    shown.figure(&frames, request)
}

impl PanelMaps {
    fn new(recording: &Recording, request: &FigureRequest) -> Result<Self, AnalysisError> {
        let (plan, all) = (recording.plan(), estimates(recording.plan())?);
        let has_maps = |estimate: &Estimate| estimate.compared().is_some();
        let selected: Vec<&Estimate> =
            all.iter().filter(|estimate| has_maps(estimate) && request.selects(estimate)).collect();
        // The figure shows one variant: by default the first.
        let own_variant = selected.iter().find(|estimate| estimate.row_key.variant.is_some());
        let Some(first) = own_variant.or(selected.first()) else {
            let has_scores = all.iter().any(|estimate| estimate.score_topic.is_some());
            if has_scores && all.iter().all(|estimate| estimate.settings.is_none()) {
                let what = "`panels` shows depths, but this run scores only disparities";
                let help = "add a node `depth/from-disparity` and score its depth";
                return Err(AnalysisError::request(what.to_owned(), help.to_owned()));
            }
            let labels = listed(all.iter().map(|estimate| estimate.label.as_str()));
            let what = "no selected estimate has recorded maps of its depth and its ground truth".to_owned();
            return Err(AnalysisError::request(
                what,
                format!("available estimates: {labels}; `record:` selects the recorded outputs"),
            ));
        };
        let (run, variant) = (first.run, first.row_key.variant.clone());
        let mut estimates = selected.clone();
        let is_shown = |own: &Option<String>| own.is_none() || *own == variant;
        estimates.retain(|estimate| estimate.run == run && is_shown(&estimate.row_key.variant));
        // The order of the paper: stereo, mono, others, fused.
        estimates.sort_by_key(|estimate| match estimate.name.as_str() {
            name if name.starts_with("stereo") => 0,
            name if name.starts_with("mono") => 1,
            name if name.starts_with("fus") => 3,
            _ => 2,
        });
        let (truth, settings) = (first.truth_topic.clone().unwrap_or_default(), first.settings.unwrap_or_default());
        let (topics, aligned) = (vec![truth], BTreeMap::new());
        let mut shown = Self { run, topics, rows: Vec::new(), settings, variant, aligned };
        if let Some(image) = image(plan, run) {
            let row = Row::Image(shown.topic(&image));
            shown.rows.push(("image".to_owned(), row));
        }
        let mut depths: Vec<(&str, usize)> = Vec::new();
        for estimate in estimates {
            let topic = shown.topic(estimate.estimate_topic.as_deref().unwrap_or_default());
            let aligned = estimate.settings.filter(|settings| settings.align != Align::None);
            let title = &estimate.name_title;
            let name = if aligned.is_some() { format!("{title}, aligned") } else { title.clone() };
            shown.aligned.extend(aligned.map(|settings| (topic, settings)));
            depths.push((&estimate.name, topic));
            shown.rows.push((name, Row::Depth(topic)));
        }
        if let Some(confidence) = confidence(plan, run, shown.variant.as_deref()) {
            let row = Row::Confidence(shown.topic(&confidence));
            shown.rows.push(("confidence".to_owned(), row));
        }
        let family = |family: &str| depths.iter().find(|(name, _)| name.starts_with(family)).map(|(_, topic)| *topic);
        let two = family("mono").zip(family("stereo"));
        if let Some((one, other)) = two.or_else(|| Some((depths.first()?.1, depths.get(1)?.1))) {
            shown.rows.push(("difference".to_owned(), Row::Difference([one, other])));
        }
        shown.rows.push(("ground truth".to_owned(), Row::Depth(0)));
        Ok(shown)
    }

    fn topic(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }

    /// The maps of a frame, with estimates aligned as for scoring.
    fn as_scored(&self, mut maps: Maps) -> Maps {
        let Some(truth) = maps[0].clone() else { return maps };
        for (topic, settings) in &self.aligned {
            let aligned = maps[*topic].as_ref().and_then(|estimate| as_scored(estimate, &truth, settings));
            maps[*topic] = aligned.or_else(|| maps[*topic].take());
        }
        maps
    }

    fn figure(&self, frames: &[(&str, Maps)], request: &FigureRequest) -> Result<Figure, AnalysisError> {
        if request.size.height_mm.is_some() {
            let what = "`panels` does not support `--height`: the height follows from the frames".to_owned();
            return Err(AnalysisError::request(what, "omit `--height`".to_owned()));
        }
        let size = |value: &Value| match value {
            Value::Weight(weight) => Some(weight.share.dimensions()),
            other => other.metres().map(Raster::dimensions),
        };
        let Some((wide, high)) = frames.iter().find_map(|(_, maps)| maps.iter().flatten().find_map(size)) else {
            return Err(AnalysisError::request(
                "the selected frames have no maps".to_owned(),
                "choose other frames with `--frames`".to_owned(),
            ));
        };
        // At most the resolution of the maps, and of the figure.
        let per_cell = request.size.width_mm / 25.4 * request.dpi / frames.len() as f64;
        let pixels = per_cell.round().clamp(1.0, f64::from(wide)) as u32;
        let (mut panels, mut bars, mut table) = (Vec::new(), Vec::<Bar>::new(), Table::default());
        for (name, row) in &self.rows {
            let bar = self.bar(row, frames);
            for (frame, maps) in frames {
                let title = if panels.len() < frames.len() { *frame } else { "" };
                let mut panel = Panel::new(title, Axis::bare(""), Axis::bare(name.as_str()));
                panel.aspect = Some(f64::from(high) / f64::from(wide));
                let picture = match (self.map(row, maps), &bar, row) {
                    (Some(map), Some(bar), _) => {
                        table.push(frame, name, &map);
                        Some(coloured(&map, pixels, bar))
                    }
                    (_, _, Row::Image(topic)) => match &maps[*topic] {
                        Some(Value::Image(image)) => Some(reduced(image, pixels)),
                        _ => None,
                    },
                    _ => None,
                };
                panel.items.push(match picture {
                    Some(picture) => Item::Picture(picture),
                    None => Item::Words((0.5, 0.5), 0.0, "none".to_owned(), Anchor::Middle, BLACK),
                });
                panels.push(panel);
            }
            bars.extend(bar.filter(|bar| bars.iter().all(|known| known.axis.label != bar.axis.label)));
        }
        let variant = self.variant.as_ref().map(|variant| format!(" of {variant}")).unwrap_or_default();
        let ids = frames.iter().map(|(id, _)| *id).collect::<Vec<_>>().join(", ");
        let names = self.rows.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
        let about = format!("Frames {ids}{variant}, top to bottom: {names}; white: invalid");
        request.figure(Sheet { columns: frames.len(), panels, bars, ..Sheet::default() }, about, table.csv())
    }

    /// The colour scale of a row; `None` for the image.
    fn bar(&self, row: &Row, frames: &[(&str, Maps)]) -> Option<Bar> {
        let name = |topic: usize| {
            let row = self.rows.iter().find(|(_, row)| matches!(row, Row::Depth(own) if *own == topic));
            row.map_or("", |(name, _)| name.trim_end_matches(", aligned"))
        };
        let axis = match row {
            Row::Image(_) => return None,
            Row::Depth(_) => Axis::log(NEAR_M, self.settings.max_m, "depth, m"),
            Row::Confidence(_) => Axis::new(0.0, 1.0, "confidence: 0 mono, 1 stereo"),
            Row::Difference([one, other]) => {
                let most = frames.iter().filter_map(|(_, maps)| largest(&*self.map(row, maps)?)).fold(0.1, f64::max);
                Axis::new(-most, most, format!("error, {} − {}, m", name(*one), name(*other)))
            }
        };
        Some(Bar { ramp: if matches!(row, Row::Depth(_)) { SEQUENTIAL } else { DIVERGING }, axis })
    }

    /// The numbers of a row on a frame.
    fn map<'m>(&self, row: &Row, maps: &'m Maps) -> Option<Cow<'m, Raster<f32>>> {
        let depth = |topic: usize| maps[topic].as_ref().and_then(Value::metres);
        match row {
            Row::Image(_) => None,
            Row::Depth(topic) => depth(*topic).map(Cow::Borrowed),
            Row::Confidence(topic) => match &maps[*topic] {
                Some(Value::Weight(weight)) => Some(Cow::Borrowed(&weight.share)),
                _ => None,
            },
            Row::Difference([one, other]) => {
                let (truth, one, other) = (depth(0)?, depth(*one)?, depth(*other)?);
                if one.dimensions() != truth.dimensions() || other.dimensions() != truth.dimensions() {
                    return None;
                }
                let (least, most) = (self.settings.min_m as f32, self.settings.max_m as f32);
                let error = |estimate: f32, truth: f32| (estimate.clamp(least, most) - truth).abs();
                let values = truth.as_raw().iter().zip(one.as_raw().iter().zip(other.as_raw()));
                let values = values.map(|(truth, (one, other))| match *truth > least && *truth < most {
                    true => error(*one, *truth) - error(*other, *truth),
                    false => f32::NAN,
                });
                Raster::from_raw(truth.width(), truth.height(), values.collect()).map(Cow::Owned)
            }
        }
    }
}

/// The range of a map's absolute values, without the few largest.
fn largest(map: &Raster<f32>) -> Option<f64> {
    let mut sizes: Vec<f32> = map.as_raw().iter().map(|number| number.abs()).filter(|size| size.is_finite()).collect();
    let at = (SCALE_SHARE * sizes.len().checked_sub(1)? as f64) as usize;
    Some(f64::from(*sizes.select_nth_unstable_by(at, f32::total_cmp).1))
}

/// The displayed frames: by default some of those with recorded maps.
fn positions(recording: &Recording, run: RunId, request: &FigureRequest) -> Result<Vec<FrameIndex>, AnalysisError> {
    let frames = recording.frames(run);
    let Some(choice) = &request.frames else {
        let with_maps: Vec<FrameIndex> =
            FrameIndex::all(frames.len()).step_by(recording.plan().every.max(1) as usize).collect();
        let count = with_maps.len().min(SHOWN);
        return Ok((0..count).map(|at| with_maps[at * with_maps.len() / count]).collect());
    };
    let positions = choice.positions(&frames.iter().collect::<Vec<_>>())?;
    if positions.len() > MOST {
        let what = format!("{} frames are selected, but the maximum is {MOST}", positions.len());
        return Err(AnalysisError::request(what, "select fewer frames with `--frames`".to_owned()));
    }
    Ok(positions.into_iter().map(FrameIndex).collect())
}

/// The topic of the source's image: the left image, or the first one.
fn image(plan: &RecordedPlan, run: RunId) -> Option<String> {
    let outputs = &plan.runs[run].source.outputs;
    let images = || outputs.iter().filter(|output| output.recorded && output.value_type() == Some(ValueType::Image));
    images().find(|output| output.port == "left").or_else(|| images().next()).map(|output| output.topic.clone())
}

/// The topic of the variant's confidence, or of the one that all variants share.
fn confidence(plan: &RecordedPlan, run: RunId, variant: Option<&str>) -> Option<String> {
    let place = variant.and_then(|name| plan.variants.iter().position(|known| known == name)).map(VariantId);
    let own = plan.runs[run].nodes.iter().filter(|node| place.is_none_or(|place| node.variants.contains(&place)));
    let weights = own.flat_map(|node| &node.outputs).filter(|output| output.recorded && !output.once);
    weights.into_iter().find(|output| output.value_type() == Some(ValueType::Weight)).map(|output| output.topic.clone())
}

/// The data of maps: one row per frame and map.
#[derive(Default)]
struct Table {
    keys: [Vec<Option<String>>; 2],
    pixels: Vec<Option<u64>>,
    numbers: [Vec<Option<f64>>; 3],
}

impl Table {
    fn push(&mut self, frame: &str, name: &str, map: &Raster<f32>) {
        let mut all: Vec<f32> = map.as_raw().iter().copied().filter(|value| value.is_finite()).collect();
        all.sort_by(f32::total_cmp);
        let at = |place: usize| all.get(place).map(|value| f64::from(*value));
        let last = all.len().saturating_sub(1);
        let median = (!all.is_empty()).then(|| quantile(&all, 0.5));
        self.keys.iter_mut().zip([frame, name]).for_each(|(column, key)| column.push(Some(key.to_owned())));
        self.pixels.push(Some(all.len() as u64));
        self.numbers.iter_mut().zip([at(0), median, at(last)]).for_each(|(column, number)| column.push(number));
    }

    fn csv(self) -> Vec<u8> {
        let keys =
            ["frame", "map"].into_iter().zip(self.keys).map(|(name, cells)| Column::new(name, Cells::Text(cells)));
        let numbers = ["least", "median", "greatest"].into_iter().zip(self.numbers);
        let numbers = numbers.map(|(name, values)| Column::new(name, Cells::Number(values, Format::Decimals(3))));
        let pixels = Column::new("pixels", Cells::Count(self.pixels));
        tables::Table::new(keys.chain([pixels]).chain(numbers).collect()).csv()
    }
}
