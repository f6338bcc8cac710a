//! The formulas of the catalogue, as the docs of a kind show them.

use depthloom_scores::Family;

pub(super) fn with_formulas(before: &str, family: Family, behind: &str) -> String {
    let mut text = format!("{before}\n\n| score | unit | what it is | source |\n|---|---|---|---|\n");
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
Every row says its zone, how many pixels counted, how many true pixels the zone has and how many of these were valid (`density`). The whole image \
always comes first, as the zone without a name. `zones:` adds bands of true distance, of rows and of columns; each optional input that is wired adds two more: `image` \
the zones `edges` and `textureless`, `occluded` the zones `visible` and `occluded` (KITTI: `noc` against `occ` truth), `obj_map` the zones `background` and \
`foreground` (KITTI 2015: D1-bg and D1-fg are `d1` there). Zones may overlap.\n\n\
A data set's value is the unweighted mean over its frames, or with `mean: pixels` the value over all pixels of all frames; `median_error` has none, and is refused there.\n\n";
