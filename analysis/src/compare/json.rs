//! A comparison for programs.

use serde_json::{Value as Json, json};

use super::answer::Comparison;
use super::limit::Measure;

impl Comparison {
    /// For programs: `about`, `method`, `verdicts`, `parameters` by side, `rows` with the columns of its CSV form, `limits`, `notes`.
    #[must_use]
    pub fn json(&self) -> Json {
        let method = &self.method;
        let [better, worse, unclear] = self.verdicts();
        json!({
            "about": self.grid.about,
            "method": {
                "interval": method.interval,
                "confidence": method.confidence,
                "resamples": method.resamples,
                "seed": method.seed,
                "test": "wilcoxon",
                "correction": "holm",
                "tests": method.tests,
            },
            "verdicts": { "better": better, "worse": worse, "unclear": unclear },
            "parameters": self.parameters.iter().map(|(side, changed)| json!({
                "side": side,
                "differences": changed.iter().map(super::parameters::Changed::json).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "rows": self.grid.sheet().rows(),
            "limits": self.judged.iter().map(|judged| json!({
                "limit": judged.limit,
                // The density has no row.
                "row": matches!(judged.measure, Measure::Metric(_)).then_some(judged.contrast),
                "change": judged.change,
                "is_percent": judged.is_relative,
                "exceeded": judged.is_exceeded,
            })).collect::<Vec<_>>(),
            "notes": self.grid.notes,
        })
    }
}
