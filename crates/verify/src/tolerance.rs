//! Tolerances of the comparison of numbers.

use std::collections::BTreeMap;

use depthloom_graphs::ValueType;

/// A `--tolerance`: for one value type, or for all value types with numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    value_type: Option<ValueType>,
    most: f64,
}

/// The largest difference of equal numbers, by value type; without one, numbers must be equal bit for bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances(BTreeMap<ValueType, f64>);

/// The types with numbers whose difference has a meaning.
const NUMERIC_TYPES: [ValueType; 10] = [
    ValueType::Image,
    ValueType::Disparity,
    ValueType::TrueDisparity,
    ValueType::Depth,
    ValueType::RelativeInverseDepth,
    ValueType::Weight,
    ValueType::Calibration,
    ValueType::Scores,
    ValueType::Curve,
    ValueType::Number,
];

impl Tolerance {
    /// Reads `0.001` or `depth=0.001`.
    ///
    /// # Errors
    /// A lower-case fragment that states what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (name, number) = text.split_once('=').map_or((None, text), |(name, number)| (Some(name.trim()), number));
        let of_type = |name: &str| {
            let found = NUMERIC_TYPES.into_iter().find(|value_type| value_type.name() == name);
            found.ok_or_else(|| match ValueType::from_name(name) {
                Some(exact) => format!("values of type {exact} are compared exactly"),
                None => format!("`{name}` is not one of {}", NUMERIC_TYPES.map(ValueType::name).join(", ")),
            })
        };
        let most = number.trim().parse::<f64>().ok().filter(|most| most.is_finite() && *most >= 0.0);
        let most = most.ok_or_else(|| format!("`{}` is not a number of at least 0", number.trim()))?;
        Ok(Self { value_type: name.map(of_type).transpose()?, most })
    }
}

impl Tolerances {
    /// Combines tolerances: that of a type takes precedence over that of all types.
    pub fn new(given: &[Tolerance]) -> Self {
        let (of_all, of_one): (Vec<Tolerance>, Vec<Tolerance>) =
            given.iter().copied().partition(|tolerance| tolerance.value_type.is_none());
        let of_all = of_all.into_iter().flat_map(|all| NUMERIC_TYPES.map(|value_type| (value_type, all.most)));
        let of_one = of_one.into_iter().filter_map(|one| Some((one.value_type?, one.most)));
        Self(of_all.chain(of_one).collect())
    }

    /// The largest difference of equal numbers of a type.
    pub fn of_type(&self, value_type: ValueType) -> f64 {
        self.0.get(&value_type).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::ValueType;

    use super::{Tolerance, Tolerances};

    #[test]
    fn the_tolerance_of_a_type_takes_precedence() {
        let given = ["depth=0.5", "0.25"].map(|text| Tolerance::parse(text).unwrap());
        let tolerances = Tolerances::new(&given);
        let types = [ValueType::Depth, ValueType::Weight, ValueType::Mask, ValueType::Model];
        assert_eq!(types.map(|value_type| tolerances.of_type(value_type)), [0.5, 0.25, 0.0, 0.0]);
    }

    #[test]
    fn what_is_no_tolerance_is_told() {
        for (text, what) in [
            ("depht=1", "`depht` is not one of image, disparity,"),
            ("mask=1", "values of type mask are compared exactly"),
            ("depth=-1", "`-1` is not a number of at least 0"),
            ("depth=", "`` is not a number of at least 0"),
            ("inf", "`inf` is not a number of at least 0"),
        ] {
            assert!(Tolerance::parse(text).unwrap_err().starts_with(what), "{text}");
        }
    }
}
