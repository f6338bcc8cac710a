//! Bins of numbers: their edges, and the bin of each number.

use super::percentiles::OUTSIDE;
use crate::error::AnalysisError;

/// The maximum number of bins.
const MOST: usize = 20_000;

/// The definition of bins.
#[derive(Clone, Debug, PartialEq)]
pub enum Bins {
    /// Bins of this width, at its integer multiples.
    Width(f64),
    /// This number of bins of equal width, from the smallest to the largest value.
    Linear(u32),
    /// This number of bins of equal ratio, from the smallest to the largest value.
    Log(u32),
    /// This number of bins with equal counts of samples, as far as ties allow.
    Quantile(u32),
    /// Between these edges, ascending.
    Edges(Vec<f64>),
}

impl Bins {
    /// Parses `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`. `linear`, `log` and `quantile`
    /// without a number use these defaults.
    ///
    /// # Errors
    /// If the text does not define bins.
    pub fn parse(text: &str) -> Result<Self, String> {
        // Default numbers of bins.
        let text = match text {
            "linear" => "linear:20",
            "log" => "log:20",
            "quantile" => "quantile:10",
            other => other,
        };
        let forms = "use `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`";
        let (form, value) = text.split_once(':').ok_or_else(|| format!("`{text}` does not define bins: {forms}"))?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let count = || match value.trim().parse::<u32>() {
            Ok(count) if count > 0 && count as usize <= MOST => Ok(count),
            _ => Err(format!("`{value}` is not a number of bins from 1 to {MOST}")),
        };
        match form {
            "width" => match number(value).filter(|width| *width > 0.0) {
                Some(width) => Ok(Self::Width(width)),
                None => Err(format!("`{value}` is not a width: use a number above 0")),
            },
            "linear" => Ok(Self::Linear(count()?)),
            "log" => Ok(Self::Log(count()?)),
            "quantile" => Ok(Self::Quantile(count()?)),
            "edges" => {
                let edges: Option<Vec<f64>> = value.split(',').map(number).collect();
                let edges = edges
                    .ok_or_else(|| format!("`{value}` is not a list of edges: use numbers separated by commas"))?;
                if edges.len() < 2 || edges.len() > MOST || edges.windows(2).any(|pair| pair[0] >= pair[1]) {
                    return Err(format!("`{value}` is not a list of edges: use two or more ascending numbers"));
                }
                Ok(Self::Edges(edges))
            }
            _ => Err(format!("`{form}` is not a kind of bins: {forms}")),
        }
    }

    /// The edges for values from `least` to `most`; `None` for quantiles.
    pub(crate) fn edges(&self, least: f64, most: f64) -> Result<Option<Edges>, AnalysisError> {
        let spread = |count: u32, edge_at: &dyn Fn(f64) -> f64| {
            (0..=count).map(|edge| edge_at(f64::from(edge) / f64::from(count))).collect::<Vec<f64>>()
        };
        let too_many = |count: f64| {
            let what = format!("there would be {count:.0} bins, but the maximum is {MOST}");
            AnalysisError::request(what, "use wider bins".to_owned())
        };
        let (edges, closed) = match *self {
            Self::Width(width) => {
                let (first, last) = ((least / width).floor(), (most / width).floor() + 1.0);
                if last - first > MOST as f64 {
                    return Err(too_many(last - first));
                }
                let count = (last - first) as u32;
                ((0..=count).map(|edge| (first + f64::from(edge)) * width).collect(), false)
            }
            Self::Linear(count) => (spread(count, &|share| least + (most - least) * share), true),
            Self::Log(count) => {
                if least <= 0.0 {
                    let what = format!("logarithmic bins cannot start at {least}");
                    return Err(AnalysisError::request(what, "use `linear:` or `edges:`".to_owned()));
                }
                (spread(count, &|share| if share == 1.0 { most } else { least * (most / least).powf(share) }), true)
            }
            Self::Quantile(_) => return Ok(None),
            Self::Edges(ref edges) => (edges.clone(), true),
        };
        Ok(Some(Edges::new(edges, closed)))
    }
}

/// Edges of bins. A bin includes its lower edge and excludes its upper edge.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Edges {
    edges: Vec<f64>,
    /// Whether the last bin includes its upper edge, as in NumPy's `histogram`.
    closed: bool,
}

impl Edges {
    /// Removes duplicate edges. A single edge becomes a bin of its value.
    pub(crate) fn new(mut edges: Vec<f64>, closed: bool) -> Self {
        edges.dedup();
        if let [only] = edges[..] {
            edges.push(only);
        }
        Self { edges, closed }
    }

    /// The number of bins.
    pub(crate) const fn len(&self) -> usize {
        self.edges.len() - 1
    }

    /// The lower and upper edge of a bin.
    pub(crate) fn range(&self, bin: usize) -> (f64, f64) {
        (self.edges[bin], self.edges[bin + 1])
    }

    /// The bin of each value; [`OUTSIDE`] for values beyond the edges and NaN.
    pub(crate) fn bins(&self, values: &[f32]) -> Vec<u32> {
        let last = self.len() - 1;
        let (first, end) = (self.edges[0], self.edges[last + 1]);
        // With equal widths the bin is computed directly, then corrected by a step or two for rounding.
        let width = (end - first) / self.len() as f64;
        let is_even = self.edges.windows(2).all(|pair| ((pair[1] - pair[0]) / width - 1.0).abs() < 1e-6);
        let bin = |value: &f32| {
            let value = f64::from(*value);
            if self.closed && value == end {
                return last as u32;
            }
            // Also true for NaN.
            if !(value >= first && value < end) {
                return OUTSIDE;
            }
            if !is_even {
                return (self.edges.partition_point(|edge| *edge <= value) - 1) as u32;
            }
            let mut bin = (((value - first) / width) as usize).min(last);
            while value < self.edges[bin] {
                bin -= 1;
            }
            while value >= self.edges[bin + 1] {
                bin += 1;
            }
            bin as u32
        };
        values.iter().map(bin).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edges(text: &str, least: f64, most: f64) -> Edges {
        Bins::parse(text).unwrap().edges(least, most).unwrap().unwrap()
    }

    #[test]
    fn bins_equal_numpy() {
        let log = edges("log:3", 0.1, 100.0);
        assert!((log.range(1).0 - 1.0).abs() < 1e-12 && log.range(2).1 == 100.0);
        assert_eq!(log.bins(&[0.1, 0.5, 2.0, 99.0, 100.0, 101.0]), [0, 0, 1, 2, 2, OUTSIDE]);
        // np.histogram([1, 2, 3, 4, 5], bins=4): the last bin includes its upper edge.
        assert_eq!(edges("linear:4", 1.0, 5.0).bins(&[1.0, 2.0, 3.0, 4.0, 5.0]), [0, 1, 2, 3, 3]);
        assert_eq!(
            edges("edges:0,5,20", 0.0, 0.0).bins(&[-0.1, 0.0, 4.9, 5.0, 20.0, f32::NAN]),
            [OUTSIDE, 0, 0, 1, 1, OUTSIDE]
        );
    }

    #[test]
    fn bins_of_a_width_start_at_its_multiples() {
        let metres = edges("width:1", 2.7, 5.0);
        assert_eq!((metres.len(), metres.range(0), metres.range(3)), (4, (2.0, 3.0), (5.0, 6.0)));
        assert_eq!(metres.bins(&[2.7, 3.0, 5.0]), [0, 1, 3]);
        let tenths = edges("width:0.1", 0.0, 1.0);
        for value in 0..=1000 {
            let value = value as f32 / 1000.0;
            let bin = tenths.bins(&[value])[0] as usize;
            let (from, to) = tenths.range(bin);
            assert!(from <= f64::from(value) && f64::from(value) < to, "{value} in {from}..{to}");
        }
    }

    #[test]
    fn a_single_value_has_a_bin() {
        let one = edges("linear:5", 3.0, 3.0);
        assert_eq!((one.len(), one.bins(&[3.0, 3.1])), (1, vec![0, OUTSIDE]));
    }

    #[test]
    fn invalid_bins_are_refused() {
        for (text, word) in [
            ("20", "does not define bins"),
            ("width:0", "not a width"),
            ("linear:0", "not a number of bins"),
            ("edges:1", "two or more"),
            ("edges:3,2", "ascending"),
            ("edges:1,x", "not a list of edges"),
            ("cubic:3", "not a kind of bins"),
            ("log:99999999", "not a number of bins"),
        ] {
            let error = Bins::parse(text).unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
        assert!(Bins::parse("log:5").unwrap().edges(0.0, 5.0).is_err());
        assert!(Bins::parse("width:0.0001").unwrap().edges(0.0, 80.0).is_err());
    }
}
