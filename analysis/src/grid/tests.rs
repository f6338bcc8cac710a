use serde_json::{Value as Json, json};

use super::*;

/// Two axes, a score and a share; the second row is best.
fn grid() -> Grid {
    let text = |cells: [&str; 3]| cells.map(|cell| (!cell.is_empty()).then(|| cell.to_owned())).to_vec();
    let score =
        GridCells::Number { decimals: 3, values: vec![Some(0.125), Some(0.1), None], best: vec![false, true, false] };
    Grid {
        about: "all true pixels, preset paper, mean over 6 frames; 3 rows by abs_rel".to_owned(),
        label: "street_1-variants".to_owned(),
        caption: None,
        columns: vec![
            GridColumn { only_in_files: true, ..GridColumn::key("estimator", text(["a/x", "b/x", "c/x"])) },
            GridColumn { once: true, ..GridColumn::levels("block", text(["3", "3", "9"]), |_| true) },
            GridColumn::key("mode", text(["hh", "sgbm & more", ""])),
            GridColumn { more_is_better: Some(false), ..GridColumn::of("abs_rel", score) },
            GridColumn {
                more_is_better: Some(true),
                ..GridColumn::of("density", GridCells::Share(vec![Some(0.5), Some(1.0), None]))
            },
            GridColumn::of("frames", GridCells::Count(vec![Some(6), Some(6), Some(5)])),
        ],
        gaps: vec![2],
        starts: vec![0, 2],
        notes: vec!["one row failed".to_owned()],
    }
}

#[test]
fn as_text_it_is_aligned_and_says_one_thing_once() {
    let expected = "\
all true pixels, preset paper, mean over 6 frames; 3 rows by abs_rel; * best

block  mode         abs_rel ↓   density ↑  frames
3      hh               0.125      50.0 %       6
       sgbm & more      0.100*    100.0 %       6

9      -                    -           -       5
note: one row failed
";
    assert_eq!(grid().terminal(110), expected);
}

#[test]
fn what_is_too_wide_stands_in_blocks_that_each_say_what_a_row_is() {
    let text = grid().terminal(34);
    let heads: Vec<&str> = text.lines().filter(|line| line.starts_with("block")).collect();
    assert_eq!(heads, ["block  mode         abs_rel ↓", "block  mode         density ↑", "block  mode         frames"]);
    // Nor is a column left out that is wider than all room there is.
    assert_eq!(grid().terminal(5).lines().filter(|line| line.starts_with("block")).count(), 3);
}

#[test]
fn in_markdown_the_best_is_bold() {
    let expected = "\
| block | mode | abs_rel ↓ | density ↑ | frames |
|---|---|---:|---:|---:|
| 3 | hh | 0.125 | 50.0 % | 6 |
|  | sgbm & more | **0.100** | 100.0 % | 6 |
| 9 | - | - | - | 5 |

All true pixels, preset paper, mean over 6 frames; 3 rows by abs_rel. Best in bold.

One row failed.
";
    assert_eq!(grid().markdown(), expected);
}

#[test]
fn in_latex_it_has_its_own_size_a_caption_and_a_label() {
    let expected = "\
% \\usepackage{booktabs}
\\begin{table}[t]
\\centering
\\caption{All true pixels, preset paper, mean over 6 frames; 3 rows by abs\\_rel. Best in bold. One row failed.}
\\label{tab:street-1-variants}
\\footnotesize
\\setlength{\\tabcolsep}{4pt}
\\begin{tabular}{@{}llrrr@{}}
\\toprule
block & mode & abs\\_rel $\\downarrow$ & density $\\uparrow$ & frames \\\\
\\midrule
3 & hh & 0.125 & 50.0 \\% & 6 \\\\
 & sgbm \\& more & \\textbf{0.100} & 100.0 \\% & 6 \\\\
\\addlinespace
9 & -- & -- & -- & 5 \\\\
\\bottomrule
\\end{tabular}
\\end{table}
";
    let latex = grid().latex();
    assert_eq!(latex, expected);
    assert!(!latex.contains("resizebox"));
}

#[test]
fn in_latex_a_score_is_called_as_published_and_a_minus_is_no_hyphen() {
    let d1 = Metric::named("d1").unwrap();
    let values = |values: [f64; 2]| GridCells::Number {
        decimals: 2,
        values: values.map(Some).to_vec(),
        best: vec![true, false],
    };
    let levels = ["-63", "a-b"].map(|level| Some(level.to_owned())).to_vec();
    let columns = vec![
        GridColumn::levels("min", levels, |row| row == 0),
        GridColumn::score(d1, values([0.5, 0.25])),
        GridColumn::of("difference", values([-0.125, 0.125])),
    ];
    let latex = Grid { columns, ..Grid::default() }.latex();
    for part in [
        "min & D1 $\\downarrow$ & difference \\\\",
        "$-$63 & \\textbf{0.50} & \\textbf{$-$0.12} \\\\",
        "a-b & 0.25 & 0.12",
    ] {
        assert!(latex.contains(part), "{part}: {latex}");
    }
}

#[test]
fn files_have_all_columns_and_all_digits() {
    let csv = String::from_utf8(grid().sheet().csv()).unwrap();
    let expected =
        "estimator,block,mode,abs_rel,density,frames\na/x,3,hh,0.125,0.5,6\nb/x,3,sgbm & more,0.1,1.0,6\nc/x,9,,,,5\n";
    assert_eq!(csv, expected);
    let rows = |grid: &Grid| serde_json::to_value(grid.sheet().rows()).unwrap();
    let json = rows(&grid());
    assert_eq!(json[1]["abs_rel"], 0.1);
    assert_eq!(json[2]["mode"], Json::Null);
    assert_eq!(json[0]["block"], 3);
    let mixed =
        GridColumn::levels("level", vec![Some("0.50".to_owned()), Some("1.5x".to_owned()), None], |row| row == 0);
    let mixed = Grid { columns: vec![mixed], ..Grid::default() };
    assert_eq!(rows(&mixed), json!([{ "level": 0.5 }, { "level": "1.5x" }, { "level": null }]));
    assert_eq!(String::from_utf8(mixed.sheet().csv()).unwrap(), "level\n0.50\n1.5x\n\n");
}

#[test]
fn a_long_name_is_cut_in_its_middle_in_text_alone() {
    let mut grid = grid();
    let long = "p1=200+p2=800+block=3+uniqueness=0+mode=hh+filled";
    grid.columns[2] = GridColumn::key("mode", vec![Some(long.to_owned()), None, None]);
    let text = grid.terminal(110);
    assert!(text.contains("p1=200+p2=800+block…ess=0+mode=hh+filled"), "{text}");
    assert!(grid.markdown().contains(long));
    // But not where its middle is what tells it from another.
    let other = long.replace("block=3", "block=5");
    grid.columns[2] = GridColumn::key("mode", vec![Some(long.to_owned()), Some(other.clone()), None]);
    let text = grid.terminal(110);
    assert!(text.contains(long) && text.contains(&other), "{text}");
}
