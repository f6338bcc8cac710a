//! The JSON Schema of an experiment file, from the registered kinds, for completion and validation in editors.
//!
//! It is more lenient than [`load`](super::load()): a file that extends another may leave out anything, and any scalar
//! may be a `${NAME}`.

use serde_json::{Map, Value as Json, json};

use super::{score, spec};
use crate::contracts::{Port, Rate};
use crate::registry::{KindInfo, NodeKind, Registry, SourceEntry};

/// `node/output`, `source/output`, `stage.node/output`.
const REFERENCE: &str = r"^([^./\s]+\.)?[^./\s]+/[^/\s]+$";
const NAME: &str = r"^[^\s./+]+$";
const PATH: &str = r"^[^.]+(\.[^.]+)+$";

/// The schema, draft 2020-12.
pub fn schema(registry: &Registry) -> Json {
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "depthloom experiment",
        "description": "What to run: sources, stages, variants, scores.",
        "type": "object",
        "additionalProperties": false,
        "anyOf": [{ "required": ["extends"] }, { "required": ["experiment", "sources", "stages"] }],
        "properties": {
            "experiment": { "type": ["string", "number"], "description": "The experiment's name." },
            "description": { "type": "string", "description": "What it is for, in a sentence or two." },
            "extends": { "type": "string", "description": "Another experiment to start from; maps merge by key. Relative to this file." },
            "sources": {
                "type": "object",
                "description": "Where frames come from, by name.",
                "propertyNames": { "pattern": NAME },
                "additionalProperties": { "$ref": "#/$defs/source" },
            },
            "stages": {
                "type": "object",
                "description": "Graphs of nodes, each on one source, run one after the other.",
                "propertyNames": { "pattern": NAME },
                "additionalProperties": { "$ref": "#/$defs/stage" },
            },
            "variants": {
                "type": ["object", "null"],
                "description": "The same experiment with something changed; what a variant leaves alone is shared. In a file that extends another, `null` drops one of its variants.",
                "propertyNames": { "pattern": NAME },
                "additionalProperties": { "$ref": "#/$defs/changes" },
            },
            "matrix": {
                "description": "Every combination of these values, as variants; a list of matrices is one after the other.",
                "anyOf": [{ "$ref": "#/$defs/matrix" }, { "type": "array", "items": { "$ref": "#/$defs/matrix" } }, { "type": "null" }],
            },
            "only": {
                "description": "Of the variants those that are so called, `*` for any run of characters; what `--variant` says.",
                "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" }, "minItems": 1 }, { "type": "null" }],
            },
            "labels": labels(),
            "record": {
                "description": "Which outputs are recorded [default: all].",
                "anyOf": [
                    { "$ref": "#/$defs/patterns" },
                    {
                        "type": "object",
                        "additionalProperties": false,
                        "properties": {
                            "preset": { "enum": ["lean"], "description": "`lean` records inputs, disparities, metrics, numbers and trained networks; `topics` then adds to these, or leaves out with `!`. Without it, everything, or `topics`." },
                            "topics": { "$ref": "#/$defs/patterns" },
                            "every": or_variable(json!({ "type": "integer", "minimum": 1, "description": "Record the first frame that a stage runs and every Nth after it, in running order. Metrics of all frames are recorded." })),
                            "view": or_variable(json!({ "type": "boolean", "description": "Also store small pictures of disparities, depths and weights, for viewers of MCAP files (default: true)." })),
                            "points": { "$ref": "#/$defs/patterns", "description": "Also keep points of these depths, coloured by the source's first image, of every fourth pixel and row, for looking at." },
                        },
                    },
                ],
            },
        },
        "$defs": {
            "source": source(registry),
            "stage": stage(registry),
            "node": instance(registry.nodes().map(NodeKind::info).collect(), "node"),
            "changes": {
                "type": ["object", "null"],
                "description": "Paths and values: `stage.node.with.x`, `stage.node.kind`, `stage.node.inputs.port`, `sources.name.with.x`.",
                "propertyNames": { "pattern": PATH },
            },
            "matrix": matrix(),
            "range": {
                "type": "object",
                "additionalProperties": false,
                "required": ["from", "to"],
                "properties": range(),
                "description": "Numbers between two ends, both among them; whole ones where the parameter is one.",
            },
            "choice": {
                "type": "object",
                "description": "Paths and axes of the matrix, each with a value.",
            },
            "patterns": {
                "type": "array",
                "items": { "type": "string" },
                "description": "`stage.node/port`, `node`, `/stage/node/port`; `*` for anything, `!` in front to leave out.",
            },
            "reference": { "type": "string", "pattern": REFERENCE, "description": "`node/output`, `source/output` or `stage.node/output`." },
        },
    })
}

/// The labels of estimates, variants and axes.
fn labels() -> Json {
    let text = json!({ "type": ["string", "number", "boolean", "null"] });
    let texts = |of: &str| {
        json!({
            "type": ["object", "null"],
            "description": format!("The text that is shown for {of}, by name; listed ones come first, in this order."),
            "additionalProperties": text,
        })
    };
    let axis = json!({
        "type": "object",
        "additionalProperties": false,
        "properties": {
            "label": { "type": ["string", "null"], "description": "The text that is shown for the axis." },
            "values": texts("values of the axis"),
        },
    });
    json!({
        "type": ["object", "null"],
        "description": "What tables, figures and the page show instead of names; results do not depend on it.",
        "additionalProperties": false,
        "properties": {
            "estimates": texts("estimates"),
            "variants": texts("variants"),
            "axes": {
                "type": ["object", "null"],
                "description": "The text that is shown for axes of the matrix, by name, or a map of `label` and `values`.",
                "additionalProperties": { "anyOf": [text, axis] },
            },
        },
    })
}

fn range() -> Json {
    json!({
        "from": { "type": "number", "description": "The least." },
        "to": { "type": "number", "description": "The greatest." },
        "steps": { "type": "integer", "minimum": 2, "description": "How many; with a `sample` it may be left out: any between the ends." },
        "log": { "type": "boolean", "description": "Equal ratios instead of equal distances: 2, 4, 8, 16." },
    })
}

/// An object with the entries of another.
fn extended(mut base: Json, more: Json) -> Json {
    if let (Json::Object(base), Json::Object(more)) = (&mut base, more) {
        base.extend(more);
    }
    base
}

fn matrix() -> Json {
    let values = json!({ "type": "array", "minItems": 1 });
    let path = json!({ "type": "string", "pattern": PATH });
    let axis = extended(
        range(),
        json!({
            "paths": {
                "description": "The paths that take the value, all of them the same.",
                "anyOf": [path, { "type": "array", "minItems": 1, "items": path }],
            },
            "values": {
                "description": "A list, a range, or a map from names to changes (with `paths`, to values).",
                "anyOf": [values, { "$ref": "#/$defs/range" }, { "type": "object", "minProperties": 1 }],
            },
            "when": {
                "type": "object",
                "minProperties": 1,
                "description": "Where the axis is there: paths or axes above it, each with its value or a list of such.",
            },
        }),
    );
    json!({
        "type": "object",
        "properties": {
            "include": { "type": "array", "items": { "$ref": "#/$defs/choice" }, "description": "Further combinations." },
            "exclude": { "type": "array", "items": { "$ref": "#/$defs/choice" }, "description": "Combinations left out." },
            "sample": {
                "type": "object",
                "additionalProperties": false,
                "required": ["count"],
                "description": "Some of all combinations, drawn.",
                "properties": {
                    "method": { "enum": ["latin-hypercube", "random"], "default": "latin-hypercube" },
                    "count": { "type": "integer", "minimum": 1, "description": "How many." },
                    "seed": { "type": "integer", "minimum": 0, "default": 1, "description": "Another seed draws others." },
                },
            },
        },
        "additionalProperties": {
            "description": "An axis: a path, or a name with `paths` or `values` that say what it changes.",
            "anyOf": [
                values,
                { "type": "object", "additionalProperties": false, "properties": axis },
                { "type": "null" },
            ],
        },
    })
}

fn source(registry: &Registry) -> Json {
    let mut source = instance(registry.sources().map(SourceEntry::info).collect(), "source");
    let join = json!({
        "type": "array",
        "minItems": 1,
        "items": { "$ref": "#/$defs/source" },
        "description": "Several sources, one after the other.",
    });
    source["properties"]["concat"] = join;
    source
}

fn instance(kinds: Vec<KindInfo<'_>>, what: &str) -> Json {
    let names: Vec<&str> = kinds.iter().map(|kind| kind.kind).collect();
    let summaries: Vec<&str> = kinds.iter().map(|kind| kind.summary).collect();
    let is_node = what == "node";
    let mut properties = json!({
        "kind": {
            "enum": names,
            // Understood by VS Code and the YAML language server, ignored by others.
            "markdownEnumDescriptions": summaries,
            "description": format!("What {what} it is; `depthloom nodes` lists all."),
        },
        "with": { "type": ["object", "null"], "description": "Parameters." },
    });
    if is_node {
        properties["inputs"] = json!({ "type": "object", "description": "Where each input's value comes from." });
    }
    let conditions: Vec<Json> = kinds
        .into_iter()
        .map(|kind| {
            let mut then = Map::new();
            then.insert("with".to_owned(), parameters(kind.schema));
            if is_node && !kind.own_inputs {
                then.insert("inputs".to_owned(), inputs_of(kind.inputs));
            }
            json!({
                "if": { "properties": { "kind": { "const": kind.kind } }, "required": ["kind"] },
                "then": { "properties": then },
            })
        })
        .collect();
    // `null` removes an inherited one.
    json!({ "type": ["object", "null"], "additionalProperties": false, "properties": properties, "allOf": conditions })
}

fn inputs_of(ports: &[Port]) -> Json {
    let entries = ports.iter().map(|port| {
        let rate = if port.rate == Rate::Once { ", once" } else { "" };
        let optional = if port.optional { ", optional" } else { "" };
        let description = format!("{}{rate}{optional}: {}", port.value_type, port.doc);
        let mut forms = vec![json!({ "$ref": "#/$defs/reference" })];
        if port.takes_file() {
            forms.push(json!({
                "type": "object",
                "additionalProperties": false,
                "required": ["file"],
                "properties": { "file": { "type": "string", "description": "Relative to this file." } },
            }));
        }
        if port.optional {
            forms.push(json!({ "type": "null" }));
        }
        (port.name.to_owned(), json!({ "description": description, "anyOf": forms }))
    });
    json!({ "type": "object", "additionalProperties": false, "properties": entries.collect::<Map<_, _>>() })
}

/// A parameter type's schema within this one: nothing required (a merged file may have it), variables allowed.
fn parameters(schema: &Json) -> Json {
    let mut new = schema.as_object().cloned().unwrap_or_default();
    for key in ["$schema", "title", "required"] {
        new.shift_remove(key);
    }
    if let Some(properties) = new.get_mut("properties").and_then(Json::as_object_mut) {
        for property in properties.values_mut() {
            *property = or_variable(property.take());
        }
        new.entry("additionalProperties").or_insert(Json::Bool(false));
    }
    new.insert("type".to_owned(), json!(["object", "null"]));
    Json::Object(new)
}

/// Allows `${NAME}` where the schema does not allow text anyway.
fn or_variable(schema: Json) -> Json {
    let Json::Object(mut inner) = schema else { return schema };
    if inner.get("type").and_then(Json::as_str) == Some("string") && inner.get("enum").is_none() {
        return Json::Object(inner);
    }
    let mut outer = Map::new();
    // Editors read these here.
    for key in ["description", "default"] {
        if let Some(value) = inner.shift_remove(key) {
            outer.insert(key.to_owned(), value);
        }
    }
    outer.insert("anyOf".to_owned(), json!([inner, { "type": "string", "pattern": r"\$\{" }]));
    Json::Object(outer)
}

const TRUTH: &str = "The ground truth: a depth, or of disparities a disparity.";

/// A parameter that differs between the kinds may have either form.
fn score_parameters(registry: &Registry) -> Map<String, Json> {
    let mut all: Map<String, Json> = Map::new();
    for kind in score::kinds(registry) {
        let schema = parameters(&kind.schema);
        let own = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
        for (name, form) in own {
            let known = all.get(name).filter(|known| *known != form).cloned();
            let form = match known {
                Some(known) => json!({ "anyOf": [known, form], "description": known.get("description") }),
                None => form.clone(),
            };
            all.insert(name.clone(), form);
        }
    }
    all
}

fn score_inputs(registry: &Registry) -> Vec<&Port> {
    let mut inputs: Vec<&Port> = Vec::new();
    for input in score::kinds(registry).flat_map(|kind| &kind.declaration.inputs).filter(|input| input.optional) {
        if spec::CLUES.contains(&input.name) && !inputs.iter().any(|known| known.name == input.name) {
            inputs.push(input);
        }
    }
    inputs
}

fn stage(registry: &Registry) -> Json {
    let mut score = score_parameters(registry);
    for input in score_inputs(registry) {
        let clue = json!({ "anyOf": [{ "$ref": "#/$defs/reference" }, { "type": "null" }], "description": input.doc });
        score.insert(input.name.to_owned(), clue);
    }
    score.insert("ground_truth".to_owned(), json!({ "$ref": "#/$defs/reference", "description": TRUTH }));
    let mut estimate = score.clone();
    estimate.insert("from".to_owned(), json!({ "$ref": "#/$defs/reference" }));
    score.insert(
        "estimates".to_owned(),
        json!({
            "type": "object",
            "description": "What is scored, by name.",
            "propertyNames": { "pattern": NAME },
            "additionalProperties": { "anyOf": [
                { "$ref": "#/$defs/reference" },
                { "type": "object", "additionalProperties": false, "required": ["from"], "properties": estimate },
                { "type": "null" },
            ] },
        }),
    );
    json!({
        "type": ["object", "null"],
        "additionalProperties": false,
        "properties": {
            "source": { "type": "string", "description": "Which of `sources` the frames come from." },
            "nodes": {
                "type": ["object", "null"],
                "description": "The nodes by name.",
                "properties": { "graph": { "type": "string", "description": "A file to take nodes from. Relative to this file." } },
                "additionalProperties": { "$ref": "#/$defs/node" },
            },
            "score": {
                "type": "object",
                "description": "What is compared with the truth, and how.",
                "additionalProperties": false,
                "properties": score,
            },
        },
    })
}
