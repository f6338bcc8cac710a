use std::io::Cursor;

use depthloom_graphs::Key;
use polars::prelude::{
    Column as PolarsColumn, CompatLevel, DataFrame, DataType, ParallelStrategy, ParquetReader, SchemaExt as _,
    SerReader as _,
};
use polars_parquet::write::schema_to_metadata_key;
use serde_json::{Value as Json, json};

use super::best::Mark;
use super::*;

/// Two axes, a score and a share; the second row is best, the first second best.
fn table() -> Table {
    let text = |cells: [&str; 3]| cells.map(|cell| (!cell.is_empty()).then(|| cell.to_owned()));
    let rows = Rows(&[(Some(0.125), Some(0.5), 6_u64), (Some(0.1), Some(1.0), 6), (None, None, 5)]);
    Table {
        about: "all pixels with ground truth, preset martins2018, mean over 6 frames; 3 rows by abs_rel".to_owned(),
        label: "street_1-variants".to_owned(),
        gaps: vec![2],
        starts: vec![0, 2],
        notes: vec!["one row failed".to_owned()],
        ..Table::new(vec![
            Column::new("estimate", Cells::Text(text(["a/x", "b/x", "c/x"]).to_vec())).in_files(),
            Column::levels("block", text(["3", "3", "9"]), |_| true).once(),
            Column::new("mode", Cells::Text(text(["hh", "sgbm & more", ""]).to_vec())).key(),
            rows.number("abs_rel", |row| row.0).better(false).marked(vec![Mark::Second, Mark::Best, Mark::None]),
            rows.share("density", |row| row.1).better(true),
            rows.count("frames", |row| row.2),
        ])
    }
}

#[test]
fn text_is_aligned_and_repeats_no_shared_values() {
    let expected = "\
all pixels with ground truth, preset martins2018, mean over 6 frames; 3 rows by abs_rel; * best

block  mode         abs_rel ↓   density ↑  frames
3      hh               0.125      50.0 %       6
       sgbm & more      0.100*    100.0 %       6

9      -                    -           -       5
note: one row failed
";
    assert_eq!(table().terminal(110), expected);
}

#[test]
fn columns_stay_aligned_with_letters_of_two_columns() {
    let texts = ["融合した深度", "stereo", "e\u{301}tage"].map(|text| Some(text.to_owned()));
    let rows = Rows(&[(0.1, 1), (0.2, 2), (0.3, 3)]);
    let columns = vec![
        Column::new("estimate", Cells::Text(texts.to_vec())).key(),
        rows.number("abs_rel", |row| row.0),
        rows.count("frames", |row| row.1),
    ];
    let text = Table::new(columns).terminal(110);
    let expected = "\
estimate      abs_rel  frames
融合した深度    0.100       1
stereo          0.200       2
e\u{301}tage           0.300       3
";
    assert!(text.ends_with(expected), "{text}");
    // A long text keeps 40 columns, not 40 letters.
    let long = Column::new("estimate", Cells::Text(vec![Some("深".repeat(30)), Some("度".repeat(30))]));
    let text = Table::new(vec![long]).terminal(110);
    assert!(text.contains(&format!("\n{}…{}\n", "深".repeat(9), "深".repeat(10))), "{text}");
}

#[test]
fn wide_tables_are_split_into_blocks_with_key_columns() {
    let text = table().terminal(34);
    let heads: Vec<&str> = text.lines().filter(|line| line.starts_with("block")).collect();
    assert_eq!(heads, ["block  mode         abs_rel ↓", "block  mode         density ↑", "block  mode         frames"]);
    // A column wider than the available width is not omitted.
    assert_eq!(table().terminal(5).lines().filter(|line| line.starts_with("block")).count(), 3);
}

#[test]
fn the_best_value_is_bold_in_markdown() {
    let expected = "\
| block | mode | abs_rel ↓ | density ↑ | frames |
|---|---|---:|---:|---:|
| 3 | hh | 0.125 | 50.0 % | 6 |
|  | sgbm & more | **0.100** | 100.0 % | 6 |
| 9 | - | - | - | 5 |

All pixels with ground truth, preset martins2018, mean over 6 frames; 3 rows by abs_rel. Best in bold.

One row failed.
";
    assert_eq!(table().markdown(), expected);
}

#[test]
fn latex_tables_have_a_fixed_size_a_caption_and_a_label() {
    let expected = "\
% \\usepackage{booktabs}
\\begin{table}[t]
\\centering
\\caption{All pixels with ground truth, preset martins2018, mean over 6 frames; 3 rows by abs\\_rel. Best in bold, second best underlined. One row failed.}
\\label{tab:street-1-variants}
\\footnotesize
\\setlength{\\tabcolsep}{4pt}
\\begin{tabular}{@{}llrrr@{}}
\\toprule
block & mode & abs\\_rel $\\downarrow$ & density $\\uparrow$ & frames \\\\
\\midrule
3 & hh & \\underline{0.125} & 50.0 \\% & 6 \\\\
 & sgbm \\& more & \\textbf{0.100} & 100.0 \\% & 6 \\\\
\\addlinespace
9 & -- & -- & -- & 5 \\\\
\\bottomrule
\\end{tabular}
\\end{table}
";
    let latex = table().latex();
    assert_eq!(latex, expected);
    assert!(!latex.contains("resizebox"));
}

#[test]
fn latex_tables_use_published_names_and_minus_signs() {
    let d1 = Metric::named("d1").unwrap();
    let rows = Rows(&[(0.5, -0.125), (0.25, 0.125)]);
    let columns = vec![
        Column::levels("min", ["-63", "a-b"].map(|level| Some(level.to_owned())), |row| row == 0),
        rows.metric(d1, |row| Some(row.0)).decimals(2).marked(vec![Mark::Best, Mark::None]),
        rows.number("difference", |row| row.1).decimals(2).marked(vec![Mark::Best, Mark::None]),
        rows.text("interval", |row| format!("[{:+.2}, {:+.2}]", row.1 - 0.5, row.1 + 0.5)).in_text().joins(),
    ];
    let latex = Table::new(columns).latex();
    for part in [
        "min & D1 $\\downarrow$ & difference \\\\",
        "$-$63 & \\textbf{0.50} & \\textbf{$-$0.12} [$-$0.62, +0.38] \\\\",
        "a-b & 0.25 & 0.12 [$-$0.38, +0.62]",
    ] {
        assert!(latex.contains(part), "{part}: {latex}");
    }
}

#[test]
fn files_have_all_columns_and_all_digits() {
    let csv = String::from_utf8(table().csv()).unwrap();
    let expected =
        "estimate,block,mode,abs_rel,density,frames\na/x,3,hh,0.125,0.5,6\nb/x,3,sgbm & more,0.1,1.0,6\nc/x,9,,,,5\n";
    assert_eq!(csv, expected);
    let rows = |table: &Table| serde_json::to_value(table.json_rows()).unwrap();
    let json = rows(&table());
    assert_eq!(json[1]["abs_rel"], 0.1);
    assert_eq!(json[2]["mode"], Json::Null);
    assert_eq!(json[0]["block"], 3);
    let mixed = Column::levels("level", vec![Some("0.50".to_owned()), Some("1.5x".to_owned()), None], |row| row == 0);
    let mixed = Table::new(vec![mixed]);
    assert_eq!(rows(&mixed), json!([{ "level": 0.5 }, { "level": "1.5x" }, { "level": null }]));
    assert_eq!(String::from_utf8(mixed.csv()).unwrap(), "level\n0.50\n1.5x\n\n");
}

#[test]
fn long_names_are_shortened_only_in_text() {
    let mut table = table();
    let mode = |cells: [Option<String>; 3]| Column::new("mode", Cells::Text(cells.to_vec())).key();
    let long = "p1=200+p2=800+block=3+uniqueness=0+mode=hh+filled";
    table.columns[2] = mode([Some(long.to_owned()), None, None]);
    let text = table.terminal(110);
    assert!(text.contains("p1=200+p2=800+block…ess=0+mode=hh+filled"), "{text}");
    assert!(table.markdown().contains(long));
    // Not shortened if two names differ only in the middle.
    let other = long.replace("block=3", "block=5");
    table.columns[2] = mode([Some(long.to_owned()), Some(other.clone()), None]);
    let text = table.terminal(110);
    assert!(text.contains(long) && text.contains(&other), "{text}");
}

#[test]
fn cells_are_written_in_standard_csv() {
    let rows = [
        ("a/b", Some("a,b"), Some(5), Some(0.1 + 0.2)),
        ("two, three", None, None, Some(1.0)),
        ("\"q\"", None, None, Some(1e-7)),
        ("", None, None, Some(1e300)),
        ("ä", None, None, None),
        ("x", Some("full"), None, Some(f64::NAN)),
    ];
    let cells = Rows(&rows);
    let table = Table::new(vec![
        cells.text("name", |row| row.0),
        cells.text("variant", |row| row.1),
        Column::new("bin_m", Cells::Metres((0..6).collect())),
        cells.count("median", |row| row.2),
        cells.number("score", |row| row.3),
    ]);
    let expected = "name,variant,bin_m,median,score\na/b,\"a,b\",0,5,0.30000000000000004\n\"two, three\",,1,,1.0\n\
                    \"\"\"q\"\"\",,2,,1e-7\n\"\",,3,,1e+300\nä,,4,,\nx,full,5,,NaN\n";
    assert_eq!(String::from_utf8(table.csv()).unwrap(), expected);
    let row = json!({ "name": "", "variant": null, "bin_m": 3, "median": null, "score": 1e300 });
    let rows = serde_json::to_value(table.json_rows()).unwrap();
    assert_eq!(rows[3], row);
    assert!(rows[5]["score"].is_null(), "JSON has no NaN");
}

#[test]
fn parquet_files_contain_their_name_and_units() {
    let rows = Rows(&[("s", Some(0.5), None)]);
    let table = Table::new(vec![
        rows.text("stage", |row| row.0),
        rows.metric(Metric::named("rmse").unwrap(), |row| row.1),
        rows.share("density", |row| row.2).unit(DIMENSIONLESS),
    ]);
    let key = Key::of_content(b"a plan");
    let mut reader = ParquetReader::new(Cursor::new(table.parquet("scores", &key).unwrap()));
    let entries = reader.get_metadata().unwrap().key_value_metadata().clone().unwrap();
    let entry = |name: &str| entries.iter().find(|pair| pair.key == name).and_then(|pair| pair.value.clone()).unwrap();
    assert_eq!(
        ["format", "table", "run"].map(|name| entry(&format!("depthloom.{name}"))),
        ["2".to_owned(), "scores".to_owned(), key.to_string()]
    );
    assert_eq!(entry("depthloom.units"), r#"{"rmse":"m","density":"1"}"#);
    // Texts have a type that every reader of Parquet supports, not `string_view`.
    let table = DataFrame::new(0, vec![PolarsColumn::new_empty("stage".into(), &DataType::String)]).unwrap();
    let types = |level| table.schema().to_arrow(level).get_at_index(0).map(|(_, field)| field.dtype().clone());
    assert_eq!(format!("{:?}", types(CompatLevel::oldest()).unwrap()), "LargeUtf8");
    let schema = |level| {
        let mut schema = table.schema().to_arrow(level);
        for (name, number) in [("rmse", DataType::Float64), ("density", DataType::Float64)] {
            schema.insert(name.into(), number.to_arrow_field(name.into(), level));
        }
        schema_to_metadata_key(&schema).value.unwrap()
    };
    assert_eq!(entry("ARROW:schema"), schema(CompatLevel::oldest()));
    assert_ne!(entry("ARROW:schema"), schema(CompatLevel::newest()));
    assert_eq!(reader.read_parallel(ParallelStrategy::None).finish().unwrap().shape(), (1, 3));
}

#[test]
fn parts_give_the_same_table() {
    let numerals = ["1", "2", "0.5"].map(|numeral| Some(numeral.to_owned()));
    let part = |rows: std::ops::Range<usize>| {
        Table::new(vec![
            Column::levels("block", numerals[rows.clone()].to_vec(), |_| true),
            Column::new("count", Cells::Count(rows.map(|row| Some(row as u64)).collect())),
        ])
    };
    let key = Key::of_content(b"a plan");
    let read = |bytes: Vec<u8>| {
        let reader = ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None);
        reader.finish().unwrap()
    };
    let whole = read(part(0..3).parquet("table", &key).unwrap());
    // The first part alone would have integers.
    let parts = || [0..2, 2..3].into_iter().map(part);
    assert!(read(parquet_of_parts(parts, "table", &key).unwrap()).equals(&whole));
    let none = read(parquet_of_parts(|| std::iter::once(part(0..0)), "table", &key).unwrap());
    assert_eq!(none.shape(), (0, 2));
}

#[test]
fn all_columns_except_axes_have_reserved_names() {
    let axis = |name: &str| Column::levels(name, [Some("1".to_owned())], |_| true).axis();
    let table = |name: &str| Table::new(vec![axis("block"), Rows(&[1_u64]).count(name, |count| *count)]);
    let key = Key::of_content(b"a plan");
    for name in ["frames", "abs_rel", "rmse_high", "error_p5_m"] {
        table(name).parquet("table", &key).unwrap();
    }
    assert!(!cfg!(debug_assertions) || table("unheard").parquet("table", &key).is_err());
}
