//! Scores of one estimate on one frame.

use crate::pixels::ScoredPixels;
use crate::row::{PixelSet, ScoreRow};
use crate::settings::Settings;
use crate::sums::Block;

/// The scores of an estimate against the truth, one row a pixel set, in the order of `sets`.
///
/// Both maps are row-major metres, `width * height` pixels. An estimate has no answer where it is NaN or infinite; the truth is
/// unknown where it is NaN. A row in which no pixel counts has no scores. The formulas are those of the
/// [catalogue](crate::DEPTH) and [`Settings`].
///
/// # Panics
/// If a map has another number of pixels.
#[must_use]
pub fn score(
    estimate_m: &[f32],
    truth_m: &[f32],
    width: usize,
    height: usize,
    sets: &[PixelSet],
    settings: &Settings,
) -> Vec<ScoreRow> {
    score_pixels(estimate_m, &ScoredPixels::new(truth_m, width, height, settings), sets, settings)
}

/// As [`score`], on pixels found before: for several estimates of one frame. One pass serves all pixel sets.
///
/// # Panics
/// If the estimate has another number of pixels than the truth had.
#[must_use]
pub fn score_pixels(
    estimate_m: &[f32],
    pixels: &ScoredPixels,
    sets: &[PixelSet],
    settings: &Settings,
) -> Vec<ScoreRow> {
    let (mut answered, mut missing) = (Block::new(), Block::new());
    let count_missing = sets.contains(&PixelSet::All);
    pixels.visit(
        estimate_m,
        settings,
        |t, y| answered.push(t, y),
        |t| {
            if count_missing {
                missing.push(t, settings.missing_m);
            }
        },
    );
    let answered = answered.finish();
    let mut all = answered;
    all.merge(&missing.finish());
    let row = |&set: &PixelSet| {
        let of_set = if set == PixelSet::Answered { &answered } else { &all };
        let row = ScoreRow { truth: pixels.len() as u64, answered: answered.pixels(), ..ScoreRow::new(set, "") };
        of_set.row(row, settings)
    };
    sets.iter().map(row).collect()
}
