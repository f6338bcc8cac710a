//! What is generated from the registered kinds: the schema and the reference.

mod toys;

use depthloom_graphs::language::schema;
use depthloom_graphs::render::{kind_reference, kinds_index};
use serde_json::json;

#[test]
fn the_reference_of_kinds_is_read_from_their_types() {
    let registry = toys::registry();
    insta::assert_snapshot!("kinds", kinds_index(&registry));
    for kind in ["stereo/sgbm", "fusion/scale", "learn/ssl", "kitti/stereo2015"] {
        let text = kind_reference(&registry, kind).unwrap();
        insta::assert_snapshot!(kind.replace('/', "-"), text);
    }
    assert_eq!(kind_reference(&registry, "no/such"), None);
}

#[test]
fn fault_58_the_schema_takes_every_reference_that_the_language_takes() {
    let schema = schema(&toys::registry());
    let pattern = schema["$defs"]["reference"]["pattern"].as_str().unwrap();
    let pattern = regex_lite::Regex::new(pattern).unwrap();
    for reference in ["stereo/disparity", "source/left", "learn.train/model", "source/stereo.disparity"] {
        assert!(pattern.is_match(reference), "{reference}");
    }
    for text in ["stereo", "stereo/", "/disparity", "compare/stereo/disparity", "a.b.c/d", "stereo/dis parity"] {
        assert!(!pattern.is_match(text), "{text}");
    }
}

#[test]
fn the_schema_knows_every_kind_its_parameters_and_inputs() {
    let schema = schema(&toys::registry());
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let node = &schema["$defs"]["node"];
    let kinds = node["properties"]["kind"]["enum"].as_array().unwrap();
    assert!(kinds.contains(&json!("stereo/sgbm")) && !kinds.contains(&json!("synthetic/road")));
    let then = |kind: &str| {
        let conditions = node["allOf"].as_array().unwrap();
        let found = conditions.iter().find(|c| c["if"]["properties"]["kind"]["const"] == kind);
        found.unwrap()["then"]["properties"].clone()
    };
    let sgbm = then("stereo/sgbm");
    assert_eq!(sgbm["with"]["additionalProperties"], false);
    assert_eq!(sgbm["with"]["properties"]["disparities"]["anyOf"][0]["multipleOf"], 16);
    assert_eq!(sgbm["inputs"]["additionalProperties"], false);
    assert!(sgbm["inputs"]["properties"]["left"]["description"].as_str().unwrap().starts_with("image: "));
    // A type that tolerates unknown keys is closed all the same: the language does not.
    assert_eq!(then("confidence/edges")["with"]["additionalProperties"], false);
    // Only aggregate values come from files.
    let forms = |kind: &str, port: &str| then(kind)["inputs"]["properties"][port]["anyOf"].as_array().unwrap().len();
    assert_eq!((forms("mono/onnx", "model"), forms("mono/onnx", "image")), (2, 1));
    let score = &schema["$defs"]["stage"]["properties"]["score"]["properties"];
    assert!(score["preset"].is_object() && score["ground_truth"].is_object());
    insta::assert_snapshot!("schema", serde_json::to_string_pretty(&schema).unwrap());
}
