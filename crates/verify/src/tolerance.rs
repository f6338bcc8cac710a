//! How far numbers may be apart and still count as equal.

use std::collections::BTreeMap;

use depthloom_graphs::ValueType;

/// What `--tolerance` says: of one type of values, or of all whose values are numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    value_type: Option<ValueType>,
    most: f64,
}

/// By type of values, how far numbers may be apart; nothing where none is said: then they are equal bit for bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances(BTreeMap<ValueType, f64>);

/// Types whose numbers have a distance that means something.
const OF_NUMBERS: [ValueType; 8] = [
    ValueType::Image,
    ValueType::Disparity,
    ValueType::TrueDisparity,
    ValueType::Depth,
    ValueType::Weight,
    ValueType::Calibration,
    ValueType::Scores,
    ValueType::Curve,
];

impl Tolerance {
    /// Reads `0.001` or `depth=0.001`.
    ///
    /// # Errors
    /// A lower-case fragment saying what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (name, number) = text.split_once('=').map_or((None, text), |(name, number)| (Some(name.trim()), number));
        let of_type = |name: &str| {
            let found = OF_NUMBERS.into_iter().find(|value_type| value_type.name() == name);
            found.ok_or_else(|| match ValueType::from_name(name) {
                Some(exact) => format!("values of type {exact} are compared exactly"),
                None => format!("`{name}` is not one of {}", OF_NUMBERS.map(ValueType::name).join(", ")),
            })
        };
        let most = number.trim().parse::<f64>().ok().filter(|most| most.is_finite() && *most >= 0.0);
        let most = most.ok_or_else(|| format!("`{}` is not a number of at least 0", number.trim()))?;
        Ok(Self { value_type: name.map(of_type).transpose()?, most })
    }
}

impl Tolerances {
    /// All of them together: what is said of a type counts for it, whatever is said of all.
    pub fn of(said: &[Tolerance]) -> Self {
        let (of_all, of_one): (Vec<Tolerance>, Vec<Tolerance>) =
            said.iter().copied().partition(|tolerance| tolerance.value_type.is_none());
        let of_all = of_all.into_iter().flat_map(|all| OF_NUMBERS.map(|value_type| (value_type, all.most)));
        let of_one = of_one.into_iter().filter_map(|one| Some((one.value_type?, one.most)));
        Self(of_all.chain(of_one).collect())
    }

    /// How far numbers of a type may be apart.
    pub fn of_type(&self, value_type: ValueType) -> f64 {
        self.0.get(&value_type).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::ValueType;

    use super::{Tolerance, Tolerances};

    #[test]
    fn what_is_said_of_a_type_counts_before_what_is_said_of_all() {
        let said = ["depth=0.5", "0.25"].map(|text| Tolerance::parse(text).unwrap());
        let of = Tolerances::of(&said);
        let types = [ValueType::Depth, ValueType::Weight, ValueType::Mask, ValueType::Model];
        assert_eq!(types.map(|value_type| of.of_type(value_type)), [0.5, 0.25, 0.0, 0.0]);
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
