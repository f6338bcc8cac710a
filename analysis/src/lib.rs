//! Recordings to percentiles, tables and plots, with polars.
//!
//! Reports are computed [from a recording](report()), so that later questions need no second run. The plan of a
//! recording names the [estimates](Estimate). Their recorded [scores](FrameScore) give `scores.csv` and, averaged over
//! frames, the [table](Table). Their recorded maps give the [error against distance](DistanceBin) and its figure.
//! Learning curves of trained networks have their own figure and table.

mod ablation;
mod compare;
mod curves;
mod distance;
mod error;
mod estimates;
mod explain;
mod figures;
mod files;
mod input;
mod page;
mod query;
mod report;
mod samples;
mod scores;
mod statistics;
mod tables;
mod titles;

pub use ablation::{
    BestValue, BoardRun, Costs, Question, Ranking, Selection, TableRow, answer, best_value, leaderboard,
};
pub use compare::{
    CompareOptions, ComparedRun, Comparison, ComparisonOutput, DistanceComparison, DistanceComparisonOutput, Side,
    compare, compare_by_distance, names,
};
pub use curves::CurveEnd;
pub use depthloom_scores::{Mean, Metric, PixelSet};
pub use distance::{DistanceBin, PERCENTILES, RecordedSamples, SampleSink, Spread};
pub use error::AnalysisError;
pub use estimates::{Estimate, PredictedUncertainty};
pub use explain::{Explain, Fact, ScoredFrame, WorstFrame, explain};
pub use figures::{Figure, FigureKind, FigureRequest, FigureRun, Layout, Size, figure};
pub use input::condition::{DamagedPlace, RecordingCondition, StageFrames, recording_notes};
pub use input::frame_choice::{FrameChoice, frames_beyond};
pub use input::paper::paper_scores;
pub use input::rows::{TopicRows, curve_rows, topic_rows};
pub use input::timings::{Timing, TimingLatency, read_timings, timings_table, write_timings};
pub use page::{
    MOST_DETAILED, MOST_LAYERS, MOST_PICTURED, PAGE, PAGE_MARK, PageOptions, PageRuns, PageWritten, Surroundings,
    write_page,
};
pub use query::{Bins, By, FramesOfRun, Inquiry, Outlier, SampleSet, Unit, analyse, frames_of, samples_match};
pub use report::{Prepared, ReportOptions, Summary, report, report_with};
pub use samples::{SAMPLES, SamplesWritten, check_samples, write_samples};
pub use scores::FrameScore;
pub use statistics::{Grouping, Interval, IntervalMethod, Resampling};
pub use tables::{
    COMMON, KEY_COLUMNS, Level, RowKey, RowKeys, TABLE_FORMAT, TABLE_MARK, Table, TableOutput, Typesetting, plan_key,
    variant_of,
};

/// All metrics of all families, in the order of tables.
pub fn metrics() -> impl Iterator<Item = &'static Metric> {
    depthloom_scores::DEPTH.iter().chain(&depthloom_scores::DISPARITY)
}
