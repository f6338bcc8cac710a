//! A table as JSON for `report.html`.

use serde_json::{Value as Json, json};

use super::Table;
use crate::tables::best::Mark;

impl Table {
    /// The table as JSON for the page of a report.
    pub(crate) fn page(&self) -> Json {
        let columns = self.layout(false);
        let headings = columns.iter().map(|column| json!({ "name": column.heading(), "text": column.is_text }));
        let row = |row: usize| columns.iter().map(|column| column.cells[row].text.as_str()).collect::<Vec<_>>();
        let best = |row: usize| {
            (0..columns.len()).filter(|&column| columns[column].cells[row].mark == Mark::Best).collect::<Vec<_>>()
        };
        json!({
            "about": self.about,
            "notes": self.notes,
            "columns": headings.collect::<Vec<_>>(),
            "rows": (0..self.lines()).map(row).collect::<Vec<_>>(),
            "best": (0..self.lines()).map(best).collect::<Vec<_>>(),
        })
    }
}
