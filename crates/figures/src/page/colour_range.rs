//! The range of the colour scale that all maps of one kind share.
//!
//! It depends on ground truth alone if there is ground truth, and otherwise on what most maps have in common. A wrong
//! map, or a few wrong pixels, do not change the colours of the others.

use super::maps::{CodeRange, Scale};

/// The kinds of maps with a shared scale. Measured and estimated disparities share one.
const KINDS: [&[&str]; 2] = [&["depth"], &["disparity", "ground-truth-disparity"]];
/// The share of frames at each end that does not count.
const FRAMES: f64 = 0.1;
/// The farthest depth beyond those of most maps, as a ratio, that gets a colour of its own.
const DEPTH_RATIO: f64 = 4.0;

/// The ranges of a map by frame.
pub(super) struct RangedMap<'a> {
    pub(super) value_type: &'a str,
    pub(super) is_truth: bool,
    /// The scale of its codes.
    pub(super) scale: Scale,
    /// One per frame with valid samples.
    pub(super) frames: &'a [CodeRange],
}

/// The colour scale of the maps of a value type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourRange {
    /// The name of the type.
    pub value_type: &'static str,
    /// The numbers at both ends.
    pub ends: [f64; 2],
}

/// The colour scales of all value types.
pub(super) fn colour_ranges(maps: &[RangedMap<'_>]) -> Vec<ColourRange> {
    let mut ranges = Vec::new();
    for types in KINDS {
        let own: Vec<&RangedMap<'_>> = maps.iter().filter(|map| types.contains(&map.value_type)).collect();
        let Some(scale) = own.first().map(|map| map.scale) else { continue };
        let truth: Vec<CodeRange> = own.iter().filter(|map| map.is_truth).flat_map(|map| map.frames).copied().collect();
        let range = of_frames(&truth).or_else(|| {
            let each: Vec<CodeRange> = own.iter().filter_map(|map| of_frames(map.frames)).collect();
            of_maps(&each, scale)
        });
        if let Some(CodeRange { low, high }) = range {
            let ends = [scale.number(low), scale.number(high)];
            ranges.extend(types.iter().map(|value_type| ColourRange { value_type, ends }));
        }
    }
    ranges
}

/// The range of most frames.
fn of_frames(frames: &[CodeRange]) -> Option<CodeRange> {
    let last = frames.len().checked_sub(1)?;
    let left_out = (FRAMES * last as f64) as usize;
    let low = sorted(frames, |range| range.low)[left_out];
    let high = sorted(frames, |range| range.high)[last - left_out];
    Some(CodeRange { low, high })
}

/// The range of all maps, but no farther from that of most maps than this is wide. Constant maps do not count if others
/// vary.
fn of_maps(maps: &[CodeRange], scale: Scale) -> Option<CodeRange> {
    let varying: Vec<CodeRange> = maps.iter().copied().filter(|range| range.low < range.high).collect();
    let maps = if varying.is_empty() { maps } else { &varying };
    let last = maps.len().checked_sub(1)?;
    let (lows, highs) = (sorted(maps, |range| range.low), sorted(maps, |range| range.high));
    let (low, high) = (lows[last / 2], highs[last / 2]);
    let room = match scale {
        Scale::Log { step, .. } => (libm::log(DEPTH_RATIO) / step) as u16,
        Scale::Linear { .. } => high - low,
    };
    Some(CodeRange { low: lows[0].max(low.saturating_sub(room)), high: highs[last].min(high.saturating_add(room)) })
}

fn sorted(ranges: &[CodeRange], end: impl Fn(&CodeRange) -> u16) -> Vec<u16> {
    let mut ends: Vec<u16> = ranges.iter().map(end).collect();
    ends.sort_unstable();
    ends
}

#[cfg(test)]
mod tests {
    use super::super::maps::FINE;
    use super::*;

    const DEPTH: &str = "depth";

    fn scale(value_type: &str) -> Scale {
        Scale::for_type(value_type, FINE).unwrap()
    }

    fn codes(value_type: &str, low: f64, high: f64) -> CodeRange {
        let scale = scale(value_type);
        CodeRange { low: scale.code(low), high: scale.code(high) }
    }

    fn ranges(maps: &[(&str, bool, &[CodeRange])]) -> Vec<ColourRange> {
        let map =
            |&(value_type, is_truth, frames)| RangedMap { value_type, is_truth, scale: scale(value_type), frames };
        colour_ranges(&maps.iter().map(map).collect::<Vec<_>>())
    }

    fn is_about([low, high]: [f64; 2], expected: [f64; 2]) -> bool {
        (low / expected[0] - 1.0).abs() < 0.01 && (high / expected[1] - 1.0).abs() < 0.01
    }

    #[test]
    fn ground_truth_alone_decides_where_there_is_ground_truth() {
        let truth = [codes(DEPTH, 5.0, 80.0), codes(DEPTH, 6.0, 60.0)];
        let bad = [codes(DEPTH, 1e6, 1e6); 2];
        let found = ranges(&[(DEPTH, true, &truth), (DEPTH, false, &bad), (DEPTH, false, &bad)]);
        assert!(found.len() == 1 && is_about(found[0].ends, [5.0, 80.0]), "{found:?}");
    }

    #[test]
    fn without_ground_truth_a_bad_map_changes_nothing() {
        let good = [codes(DEPTH, 4.0, 90.0)];
        for bad in [codes(DEPTH, 1e6, 1e6), codes(DEPTH, 0.002, 0.002), codes(DEPTH, 1e5, 1e6)] {
            let found = ranges(&[(DEPTH, false, &good), (DEPTH, false, &[bad])]);
            let [low, high] = found[0].ends;
            assert!(low > 3.9 && low < 4.1 && high > 89.0 && high < 365.0, "{found:?}");
        }
        let alone = ranges(&[(DEPTH, false, &[codes(DEPTH, 7.0, 7.0)])]);
        assert!(is_about(alone[0].ends, [7.0, 7.0]), "{alone:?}");
    }

    #[test]
    fn measured_and_estimated_disparities_share_a_scale() {
        let truth = [codes("ground-truth-disparity", 3.0, 90.0)];
        let estimate = [codes("disparity", 0.0, 900.0)];
        let found = ranges(&[("disparity", false, &estimate), ("ground-truth-disparity", true, &truth)]);
        let expected = |value_type| ColourRange { value_type, ends: [3.0, 90.0] };
        assert_eq!(found, ["disparity", "ground-truth-disparity"].map(expected));
        assert!(ranges(&[("weight", false, &[])]).is_empty());
        assert!(ranges(&[(DEPTH, true, &[]), (DEPTH, false, &[])]).is_empty());
    }

    #[test]
    fn a_few_frames_of_many_do_not_stretch_the_scale() {
        let mut frames = vec![codes(DEPTH, 5.0, 80.0); 40];
        frames[3] = codes(DEPTH, 0.01, 1e5);
        let found = ranges(&[(DEPTH, true, &frames)]);
        assert!(is_about(found[0].ends, [5.0, 80.0]), "{found:?}");
    }
}
