//! Ports that a node declares in YAML, among its parameters.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Contract, Port, Rate, Signature};
use crate::values::ValueType;

/// The ports of a node: `{ inputs: { left: image, model: { type: model, rate: once } }, outputs: { depth: depth } }`.
///
/// By name, so that the order in which they are written decides nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DeclaredPorts {
    /// Input ports, by name.
    pub inputs: BTreeMap<String, DeclaredPort>,
    /// Output ports, by name.
    pub outputs: BTreeMap<String, DeclaredPort>,
}

/// A port: its value type (`depth`), or `{ type: depth, rate: once, optional: true }`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeclaredPort {
    /// What it carries.
    pub value_type: ValueType,
    /// How often.
    pub rate: Rate,
    /// An input that may stay unwired, or an output that may be absent on a frame.
    pub optional: bool,
}

/// The most ports per side: their names are never freed.
const MOST: usize = 64;
/// The longest name of a port, bytes.
const LONGEST: usize = 64;

impl DeclaredPorts {
    /// Checks that a node of this contract can have these ports.
    ///
    /// # Errors
    /// A lower-case fragment that names the port.
    pub fn check(&self, contract: Contract) -> Result<(), String> {
        for (side, ports) in [("input", &self.inputs), ("output", &self.outputs)] {
            if ports.len() > MOST {
                return Err(format!("{} {side}s are declared, at most {MOST} can be", ports.len()));
            }
            for (name, port) in ports {
                check_name(name).map_err(|what| format!("{side} `{name}`: {what}"))?;
                let is_fine = match (contract, port.rate) {
                    (Contract::Ordered, _) | (Contract::Once, Rate::Once) => true,
                    (Contract::Pure, rate) => rate == Rate::Frame || side == "input",
                    (Contract::Once, Rate::Frame) => false,
                };
                if !is_fine {
                    let (contract, rate) = (contract.name(), port.rate.name());
                    return Err(format!("{side} `{name}`: a {contract} node has no {side} of `rate: {rate}`"));
                }
            }
        }
        Ok(())
    }

    /// The signature of a node of this contract with these ports.
    pub fn signature(&self, contract: Contract) -> Signature {
        Signature { contract, inputs: ports(&self.inputs), outputs: ports(&self.outputs), observes: None }
    }
}

fn ports(declared: &BTreeMap<String, DeclaredPort>) -> Vec<Port> {
    let port = |(name, port): (&String, &DeclaredPort)| {
        let DeclaredPort { value_type, rate, optional } = *port;
        Port { name: Port::intern(name), value_type, rate, optional, repeats: None, doc: "" }
    };
    declared.iter().map(port).collect()
}

/// Checks that a text can be a port's name in references (`node/port`), topics and columns.
///
/// # Errors
/// A lower-case fragment: how names are written.
pub fn check_name(name: &str) -> Result<(), &'static str> {
    let mut bytes = name.bytes();
    let begins = bytes.next().is_some_and(|first| first.is_ascii_lowercase() || first == b'_');
    if begins
        && bytes.all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_')
        && name.len() <= LONGEST
    {
        return Ok(());
    }
    Err("the name of a port is a lower-case letter, then letters, digits and `_`, at most 64 of them")
}

impl DeclaredPort {
    /// A port that carries one value per frame.
    pub const fn frame(value_type: ValueType) -> Self {
        Self { value_type, rate: Rate::Frame, optional: false }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Whole {
    #[serde(rename = "type")]
    value_type: String,
    #[serde(default)]
    rate: Rate,
    #[serde(default)]
    optional: bool,
}

// In the short form where possible, so that both forms are equal in plans and keys.
impl Serialize for DeclaredPort {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if *self == Self::frame(self.value_type) {
            return serializer.serialize_str(self.value_type.name());
        }
        let Self { value_type, rate, optional } = *self;
        Whole { value_type: value_type.name().to_owned(), rate, optional }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for DeclaredPort {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "neither a type nor `{ type: TYPE, rate: frame, optional: false }`")]
        enum Written {
            Type(String),
            Whole(Whole),
        }
        let whole = match Written::deserialize(deserializer)? {
            Written::Type(value_type) => Whole { value_type, rate: Rate::Frame, optional: false },
            Written::Whole(whole) => whole,
        };
        let value_type = ValueType::from_name(&whole.value_type)
            .ok_or_else(|| serde::de::Error::custom(format!("there is no value type `{}`", whole.value_type)))?;
        Ok(Self { value_type, rate: whole.rate, optional: whole.optional })
    }
}

inline_schema!(DeclaredPort, { "anyOf": [
    { "type": "string", "enum": types(), "description": "The value type, one value per frame." },
    {
        "type": "object",
        "properties": {
            "type": { "enum": types(), "description": "The value type." },
            "rate": { "enum": ["frame", "once"], "default": "frame", "description": "One value per frame, or one for the stage." },
            "optional": { "type": "boolean", "default": false, "description": "An input that may stay unwired; an output that may be absent on a frame." },
        },
        "required": ["type"],
        "additionalProperties": false,
    },
] });

fn types() -> Vec<&'static str> {
    ValueType::ALL.into_iter().map(ValueType::name).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{DeclaredPort, DeclaredPorts, check_name};
    use crate::ValueType;
    use crate::contracts::{Contract, Rate};

    #[test]
    fn a_port_is_written_as_its_type_or_whole_and_is_the_same_either_way() {
        let short: DeclaredPort = serde_json::from_value(json!("depth")).expect("a type");
        let whole: DeclaredPort = serde_json::from_value(json!({ "type": "depth" })).expect("a map");
        assert_eq!(short, whole);
        assert_eq!(serde_json::to_value(whole).expect("written"), json!("depth"));
        let once = json!({ "type": "model", "rate": "once", "optional": true });
        let read: DeclaredPort = serde_json::from_value(once.clone()).expect("a map");
        assert_eq!(read, DeclaredPort { value_type: ValueType::Model, rate: Rate::Once, optional: true });
        assert_eq!(serde_json::to_value(read).expect("written"), once);
        for wrong in [json!("dept"), json!(3), json!({ "type": "depth", "ratte": "once" }), json!({})] {
            assert!(serde_json::from_value::<DeclaredPort>(wrong.clone()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn ports_fit_the_contract_and_have_names_that_references_can_write() {
        let ports = |json| serde_json::from_value::<DeclaredPorts>(json).expect("ports");
        let collects = ports(
            json!({ "inputs": { "depth": "depth" }, "outputs": { "model": { "type": "model", "rate": "once" } } }),
        );
        assert_eq!(collects.check(Contract::Ordered), Ok(()));
        let expected = "output `model`: a pure node has no output of `rate: once`".to_owned();
        assert_eq!(collects.check(Contract::Pure), Err(expected));
        assert!(collects.check(Contract::Once).is_err());
        for name in ["left", "_x1", "a"] {
            assert_eq!(check_name(name), Ok(()), "{name}");
        }
        for name in ["", "a/b", "a.b", "Left", "1x", "a b", "ü", &"x".repeat(65)] {
            assert!(check_name(name).is_err(), "{name}");
        }
    }
}
