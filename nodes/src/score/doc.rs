//! The formulas of the catalogue, as the docs of a kind show them.

use depthloom_scores::Family;

pub(super) fn with_formulas(before: &str, family: Family, behind: &str) -> String {
    let mut text = format!("{before}\n\n| metric | unit | definition | source |\n|---|---|---|---|\n");
    for metric in family.metrics() {
        let (name, unit, source) = (metric.name, metric.unit, metric.source);
        let unit = if unit.is_empty() { "-" } else { unit };
        // A bar would end the cell.
        let formula = metric.formula.replace('|', "\\|");
        text.push_str(&format!("| `{name}` | {unit} | {formula} | {source} |\n"));
    }
    text.push('\n');
    text.push_str(behind);
    text
}

pub(super) const ZONES: &str = "\
Each row states its zone, the number of pixels counted, the number of pixels with ground truth in the zone, and the \
share of these that are valid (`density`). The whole image is always the first zone and has no name. `zones:` adds \
bands of ground-truth distance, of rows and of columns. Each connected optional input adds two zones. `image` adds \
`edges` and `textureless`. `occluded` adds `visible` and `occluded` (KITTI: `noc` and `occ` ground truth). `obj_map` \
adds `background` and `foreground` (KITTI 2015: their `d1` is D1-bg and D1-fg). Zones may overlap.\n\n\
The value for a data set is the unweighted mean over frames, or with `mean: pixels` the value over all pixels of all \
frames. `median_error` is not defined over all pixels and is refused there.\n\n";
