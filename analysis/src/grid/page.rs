//! A table as `report.html` reads it.

use serde_json::{Value as Json, json};

use super::Grid;

pub(super) fn render(grid: &Grid) -> Json {
    let shown = grid.shown();
    let columns = shown.iter().map(|&column| {
        let column = &grid.columns[column];
        json!({ "name": column.heading("↑", "↓"), "text": column.is_text() })
    });
    let row = |row: usize| shown.iter().map(|&column| grid.text(row, column)).collect::<Vec<_>>();
    let best = |row: usize| {
        let is_best = |place: &usize| grid.columns[shown[*place]].cells.is_best(row);
        (0..shown.len()).filter(is_best).collect::<Vec<_>>()
    };
    json!({
        "about": grid.about,
        "notes": grid.notes,
        "columns": columns.collect::<Vec<_>>(),
        "rows": (0..grid.height()).map(row).collect::<Vec<_>>(),
        "best": (0..grid.height()).map(best).collect::<Vec<_>>(),
    })
}
