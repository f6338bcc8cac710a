//! The numbers of explanation/beyond-table1.md.

use std::fmt::Write as _;

use super::book;
use super::numbers::difference;
use crate::support::{Row, number, read_csv};

/// Rows of the table; stereo and the monocular estimate are the baselines of all.
const ESTIMATES: [&str; 16] = [
    "stereo",
    "mono",
    "full",
    "no_weighting",
    "no_scaling",
    "average_scaling",
    "left_right_fill",
    "aligned_fill",
    "facil",
    "inverse_variance",
    "median",
    "upsampled",
    "mixture_unaligned",
    "mixture",
    "mixture_learned",
    "learned_fusion",
];
const VARIANTS: [&str; 2] = ["disparities_64", "disparities_128"];
/// Columns: metric, digits, whether it depends on a predicted standard deviation.
const METRICS: [(&str, usize, bool); 7] = [
    ("a1", 3, false),
    ("abs_rel", 3, false),
    ("sq_rel", 2, false),
    ("rmse", 2, false),
    ("rmse_log", 3, false),
    ("coverage", 2, true),
    ("ause", 2, true),
];

pub(super) fn table() -> String {
    let rows = read_csv(&book().join("numbers/beyond-table.csv"));
    let row = |variant: &str, estimate: &str| {
        let is_of = |row: &&Row| row["estimate"] == estimate && (estimate == "mono" || row["variant"] == variant);
        rows.iter().find(is_of).unwrap_or_else(|| panic!("no row of {variant}/{estimate}"))
    };
    let mut text = String::new();
    for variant in VARIANTS {
        let _ = writeln!(
            text,
            "\n| {} disparities | a1 ↑ | abs_rel ↓ | sq_rel ↓ | rmse ↓ | rmse_log ↓ | coverage | AUSE ↓ |\n|---|---|---|---|---|---|---|---|",
            variant.trim_start_matches("disparities_")
        );
        for estimate in ESTIMATES {
            let row = row(variant, estimate);
            let cell = |(metric, digits, optional): (&str, usize, bool)| -> String {
                let interval = || {
                    let (low, high) = (number(row, "abs_rel_low"), number(row, "abs_rel_high"));
                    if metric == "abs_rel" { format!(" ({low:.3} to {high:.3})") } else { String::new() }
                };
                if optional && row[metric].is_empty() {
                    return "-".to_owned();
                }
                format!("{:.digits$}{}", number(row, metric), interval())
            };
            let _ = writeln!(text, "| `{estimate}` | {} |", METRICS.map(cell).join(" | "));
        }
    }
    text.trim_start().to_owned()
}

pub(super) fn differences() -> String {
    let rows = read_csv(&book().join("numbers/beyond-compare.csv"));
    let mut text = "| disparities | fused by | metric | `no_scaling` | mean | difference | 95 % interval | frames better |\n|---|---|---|---|---|---|---|---|\n".to_owned();
    for (variant, estimate, (metric, digits, _)) in VARIANTS
        .into_iter()
        .flat_map(|variant| ["mixture", "mixture_learned", "learned_fusion"].map(|estimate| (variant, estimate)))
        .flat_map(|(variant, estimate)| [0, 1, 3].map(|at| (variant, estimate, METRICS[at])))
    {
        let is_of = |row: &&Row| row["variant"] == variant && row["estimate"] == estimate && row["score"] == metric;
        let row = rows.iter().find(is_of).unwrap_or_else(|| panic!("no {metric} of {variant}/{estimate}"));
        let disparities = variant.trim_start_matches("disparities_");
        let _ = writeln!(text, "| {disparities} | `{estimate}` | {metric} | {}", difference(row, digits));
    }
    text
}
