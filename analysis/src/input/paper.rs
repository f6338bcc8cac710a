//! Table I of the paper, for comparison.

use depthloom_recording::RecordedRun;
use depthloom_scores::PixelSet;

use crate::estimates::Estimate;

/// The numbers and their citation.
const TABLE_1: &str = include_str!("paper_table1.csv");

/// The eight published scores of an estimate with this name, variant and pixel set; `None` if nothing was published.
///
/// An estimate of an experiment without variants is compared with the full method of the paper.
#[must_use]
pub fn paper_scores(estimate: &Estimate, set: PixelSet) -> Option<[f64; 8]> {
    let variant = match (estimate.row_key.variant.as_deref(), estimate.name.as_str()) {
        (_, "stereo") => "",
        (Some(variant), _) => variant,
        (None, _) => "full",
    };
    let row_key = [variant, estimate.name.as_str(), set.name()];
    rows().find(|(key, _)| *key == row_key).map(|(_, scores)| scores)
}

/// Whether all frames of a run are KITTI's, as the paper's are. Names of variants do not show that.
pub(crate) fn is_of_kitti(run: &RecordedRun) -> bool {
    let parts = &run.source.parts;
    !parts.is_empty() && parts.iter().all(|part| part.kind.starts_with("kitti/"))
}

fn rows() -> impl Iterator<Item = ([&'static str; 3], [f64; 8])> {
    let lines = TABLE_1.lines().filter(|line| !line.starts_with('#')).skip(1);
    lines.map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let score = |i: usize| cells[3 + i].parse().expect("the embedded table holds numbers");
        ([cells[0], cells[1], cells[2]], std::array::from_fn(score))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(variant: Option<&str>, name: &str) -> Estimate {
        Estimate::of_depths(name, variant, name, &[PixelSet::All])
    }

    #[test]
    fn the_embedded_table_equals_the_shared_one() {
        let Some(shared) = depthloom_test_needs::shared("the_embedded_table_equals_the_shared_one") else { return };
        let csv = std::fs::read_to_string(shared.join("paper/table1.csv")).unwrap();
        let mut compared = 0;
        for line in csv.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let set = if cells[2] == "non_occluded" { PixelSet::Valid } else { PixelSet::All };
            let variant = (cells[0] != "stereo").then_some(cells[0]);
            let ours = paper_scores(&estimate(variant, cells[1]), set).unwrap();
            let theirs: Vec<f64> = cells[3..].iter().map(|cell| cell.parse().unwrap()).collect();
            assert_eq!(ours.to_vec(), theirs, "{line}");
            compared += 1;
        }
        assert_eq!(compared, rows().count());
    }

    #[test]
    fn an_experiment_without_variants_is_compared_with_the_full_method() {
        let fused = paper_scores(&estimate(None, "fused"), PixelSet::All);
        assert_eq!(fused, paper_scores(&estimate(Some("full"), "fused"), PixelSet::All));
        assert!(fused.is_some());
        assert_eq!(paper_scores(&estimate(Some("mean"), "fused"), PixelSet::All), None);
        assert_eq!(paper_scores(&estimate(None, "mono"), PixelSet::Valid), None);
    }
}
