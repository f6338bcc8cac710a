//! Checks a value against the part of JSON Schema that parameter types use.

use serde_json::{Map, Value as Json};

use super::with_schema::has_type;
use crate::contracts::FrameSelection;
use crate::language::text::names;
use crate::language::text::tree::has_leading_zero;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Violation {
    pub(crate) path: Vec<String>,
    /// Whether the key at the end of the path is wrong, not its value.
    pub(crate) at_key: bool,
    pub(crate) what: String,
    pub(crate) label: String,
    pub(crate) help: Option<String>,
}

/// Ignores `$ref` and keywords that parameters do not use: the type itself decides.
pub(crate) fn violations(value: &Json, schema: &Json) -> Vec<Violation> {
    let mut found = Vec::new();
    check(value, schema, &mut Vec::new(), &mut found);
    found
}

fn check(value: &Json, schema: &Json, path: &mut Vec<String>, found: &mut Vec<Violation>) {
    let Json::Object(schema) = schema else { return };
    if let Some(alternatives) = schema.get("anyOf").or_else(|| schema.get("oneOf")).and_then(Json::as_array) {
        alternatives_of(value, alternatives, path, found);
    }
    for part in schema.get("allOf").and_then(Json::as_array).into_iter().flatten() {
        check(value, part, path, found);
    }
    if let Some(allowed) = schema.get("enum").and_then(Json::as_array)
        && !allowed.contains(value)
    {
        found.push(not_among(value, allowed, path));
        return;
    }
    if let Some(only) = schema.get("const")
        && only != value
    {
        found.push(not_among(value, std::slice::from_ref(only), path));
        return;
    }
    if let Some(types) = schema.get("type") {
        let types: Vec<&str> = match types {
            Json::String(one) => vec![one],
            Json::Array(several) => several.iter().filter_map(Json::as_str).collect(),
            _ => Vec::new(),
        };
        if !types.iter().any(|name| is_of_type(value, name)) {
            found.push(wrong_type(value, &types, path));
            return;
        }
    }
    match value {
        Json::Number(_) => number(value, schema, path, found),
        Json::Array(items) => list(items, schema, path, found),
        Json::Object(map) => object(map, schema, path, found),
        Json::String(text) => {
            if let Some(least) = schema.get("minLength").and_then(Json::as_u64)
                && (text.chars().count() as u64) < least
            {
                found.push(violation(path, format!("{} must not be empty", subject(path)), "empty", None));
            }
        }
        Json::Null | Json::Bool(_) => {}
    }
}

fn violation(path: &[String], what: String, label: &str, help: Option<String>) -> Violation {
    Violation { path: path.to_vec(), at_key: false, what, label: label.to_owned(), help }
}

fn subject(path: &[String]) -> String {
    let named = path.iter().rposition(|part| part.parse::<usize>().is_err());
    match named {
        Some(at) if at + 1 == path.len() => format!("`{}`", path[at]),
        Some(at) => format!("each of `{}`", path[at]),
        None => "the value".to_owned(),
    }
}

fn is_of_type(value: &Json, name: &str) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => true,
    }
}

fn type_name(name: &str) -> &str {
    match name {
        "null" => "nothing",
        "boolean" => "`true` or `false`",
        "integer" => "a whole number",
        "number" => "a number",
        "string" => "text",
        "array" => "a list",
        "object" => "a map",
        other => other,
    }
}

fn describe(value: &Json) -> String {
    match value {
        Json::Null => "`null`".to_owned(),
        Json::Bool(value) => format!("`{value}`"),
        Json::Number(value) => format!("`{value}`"),
        Json::String(value) if is_infinite(value) || has_leading_zero(value) => format!("`{value}`"),
        Json::String(value) if value.len() <= 40 => format!("the text `{value}`"),
        Json::String(_) => "text".to_owned(),
        Json::Array(_) => "a list".to_owned(),
        Json::Object(_) => "a map".to_owned(),
    }
}

pub(crate) fn is_infinite(text: &str) -> bool {
    matches!(text.trim_start_matches(['+', '-']).to_ascii_lowercase().as_str(), ".inf" | ".nan")
}

fn wrong_type(value: &Json, types: &[&str], path: &[String]) -> Violation {
    let mut wanted: Vec<&str> = types.iter().filter(|name| **name != "null").map(|name| type_name(name)).collect();
    wanted.dedup();
    let wants_number = types.iter().any(|t| matches!(*t, "integer" | "number"));
    let help = match value {
        Json::String(text) if wants_number && is_infinite(text) => Some("numbers are finite".to_owned()),
        Json::String(text) if wants_number && has_leading_zero(text) => {
            let bare = text.trim_start_matches('+').trim_start_matches('0');
            Some(format!("write it without the zero in front: `{}`", if bare.is_empty() { "0" } else { bare }))
        }
        Json::Number(number) if wants_number && number.as_f64().is_some_and(|n| n.fract() == 0.0 && n.abs() < 1e15) => {
            number.as_f64().map(|n| format!("write it without point and exponent: `{n:.0}`"))
        }
        Json::String(text) if wants_number && text.parse::<f64>().is_ok() => {
            Some(format!("remove the quotes: `{text}`"))
        }
        Json::String(text) if types.contains(&"boolean") && is_yaml_1_1_bool(text) => {
            Some("YAML 1.2 knows `true` and `false` only".to_owned())
        }
        Json::Null => Some("`null` is not a value; for its default, leave the parameter out".to_owned()),
        Json::Number(_) | Json::Bool(_) if types.contains(&"string") => {
            Some("put it in quotes if text is meant".to_owned())
        }
        _ => None,
    };
    let wanted = match wanted.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => wanted.concat(),
    };
    violation(
        path,
        format!("{} must be {wanted}, not {}", subject(path), describe(value)),
        &format!("not {wanted}"),
        help,
    )
}

pub(crate) fn is_yaml_1_1_bool(text: &str) -> bool {
    matches!(text.to_ascii_lowercase().as_str(), "yes" | "no" | "on" | "off" | "y" | "n" | "true" | "false")
}

fn not_among(value: &Json, allowed: &[Json], path: &[String]) -> Violation {
    let names: Vec<String> =
        allowed.iter().map(|v| v.as_str().map_or_else(|| v.to_string(), ToOwned::to_owned)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let help = match value {
        Json::String(text) => match (names::renamed(text, &names), names::new_name(text, &names), path.last()) {
            (Some(renamed), Some(new), Some(key)) if key.parse::<usize>().is_err() => {
                Some(format!("{renamed}: write `{key}: {new}`"))
            }
            _ => names::suggestion(text, "it takes", &names),
        },
        _ => Some(format!("it takes: {}", names::listed(&names))),
    };
    violation(path, format!("{} cannot be {}", subject(path), describe(value)), "not one of its values", help)
}

fn alternatives_of(value: &Json, alternatives: &[Json], path: &mut Vec<String>, found: &mut Vec<Violation>) {
    let mut tried: Vec<(&Json, Vec<Violation>)> = Vec::with_capacity(alternatives.len());
    for alternative in alternatives {
        let mut own = Vec::new();
        check(value, alternative, path, &mut own);
        if own.is_empty() {
            return;
        }
        tried.push((alternative, own));
    }
    tried.retain(|(alternative, _)| !has_type(alternative, "null"));
    // Words of an enumeration, or words next to other types of values.
    let constants: Vec<Json> = tried.iter().flat_map(|(alternative, _)| constants(alternative)).collect();
    let words_alone = tried.iter().all(|(alternative, _)| !self::constants(alternative).is_empty());
    let is_word = |text: &str| names::nearest(text, constants.iter().filter_map(Json::as_str)).is_some();
    let is_number = |alternative: &Json| has_type(alternative, "integer") || has_type(alternative, "number");
    let beside_numbers = !words_alone && tried.iter().any(|(alternative, _)| is_number(alternative));
    let is_list = |alternative: &Json| has_type(alternative, "array");
    let beside_lists = value.is_array() && tried.iter().any(|(alternative, _)| is_list(alternative));
    let is_map = |alternative: &Json| has_type(alternative, "object");
    if value.is_object() && tried.iter().any(|(alternative, _)| is_map(alternative)) {
        tried.retain(|(alternative, _)| is_map(alternative));
    }
    if beside_numbers && !value.as_str().is_some_and(is_word) {
        tried.retain(|(alternative, _)| self::constants(alternative).is_empty());
    } else if beside_lists {
        tried.retain(|(alternative, _)| is_list(alternative));
    } else if !constants.is_empty() && !value.is_object() {
        let mut wrong = not_among(value, &constants, path);
        let lists = tried.iter().filter(|(alternative, _)| is_list(alternative));
        let items: Vec<Json> = lists.filter_map(|(list, _)| list.get("items")).flat_map(self::constants).collect();
        let item_names: Vec<&str> = items.iter().filter_map(Json::as_str).collect();
        if let Some(new) = value.as_str().and_then(|text| names::new_name(text, &item_names)) {
            let renamed = value.as_str().and_then(|text| names::renamed(text, &item_names)).unwrap_or_default();
            wrong.help = Some(format!("{renamed}: write the list `[{new}]`"));
        } else if let Some(text) = value.as_str().filter(|text| !is_word(text))
            && let Some(item) = names::nearest(text, item_names.iter().copied())
        {
            wrong.help = Some(format!("did you mean the list `[{item}]`?"));
        }
        found.push(wrong);
        return;
    }
    // The alternative with the deepest error is the most likely one.
    let depth = |own: &[Violation]| own.iter().map(|v| v.path.len() + usize::from(v.at_key)).min().unwrap_or(0);
    let deepest = tried.iter().map(|(_, own)| depth(own)).max().unwrap_or(0);
    let mut nearest: Vec<_> = tried.into_iter().filter(|(_, own)| depth(own) == deepest).collect();
    if nearest.len() == 1 || deepest > path.len() {
        nearest.sort_by_key(|(_, own)| own.len());
        found.extend(nearest.swap_remove(0).1);
        return;
    }
    let types: Vec<&str> = nearest.iter().filter_map(|(a, _)| a.get("type").and_then(Json::as_str)).collect();
    let mut wrong = wrong_type(value, &types, path);
    if nearest.iter().any(|(alternative, _)| alternative.get("format").and_then(Json::as_str) == Some("frames")) {
        wrong.help = Some(format!("frames are {}", FrameSelection::FORMS));
    }
    found.push(wrong);
}

fn constants(schema: &Json) -> Vec<Json> {
    match (schema.get("const"), schema.get("enum").and_then(Json::as_array)) {
        (Some(only), _) => vec![only.clone()],
        (None, Some(several)) => several.clone(),
        (None, None) => Vec::new(),
    }
}

fn number(value: &Json, schema: &Map<String, Json>, path: &[String], found: &mut Vec<Violation>) {
    let Some(number) = value.as_f64() else { return };
    let limit = |key: &str| schema.get(key).and_then(Json::as_f64);
    let bound = |key: &str| schema.get(key).map(ToString::to_string).unwrap_or_default();
    let nearest = |candidates: [f64; 2]| {
        let fits = |n: &f64| {
            limit("minimum").is_none_or(|least| *n >= least) && limit("maximum").is_none_or(|most| *n <= most)
        };
        let near: Vec<String> = candidates.into_iter().filter(fits).map(|n| format!("`{n}`")).collect();
        (!near.is_empty()).then(|| format!("the nearest: {}", near.join(" and ")))
    };
    // One bound is in the message already.
    let range = range_text(schema).filter(|range| range.contains([',']) || range.contains(" to "));
    let mut out = |what: String| {
        found.push(violation(path, what, "out of its range", range.clone().map(|range| format!("it takes {range}"))));
    };
    if limit("minimum").is_some_and(|least| number < least) {
        out(format!("{} must be at least {}, not {value}", subject(path), bound("minimum")));
    } else if limit("exclusiveMinimum").is_some_and(|least| number <= least) {
        out(format!("{} must be above {}, not {value}", subject(path), bound("exclusiveMinimum")));
    } else if limit("maximum").is_some_and(|most| number > most) {
        out(format!("{} must be at most {}, not {value}", subject(path), bound("maximum")));
    } else if limit("exclusiveMaximum").is_some_and(|most| number >= most) {
        out(format!("{} must be below {}, not {value}", subject(path), bound("exclusiveMaximum")));
    } else if let Some(what) = outside_single_precision(number, schema) {
        out(format!("{} must be {what}, not {number:e}", subject(path)));
    } else if let Some(step) = limit("multipleOf").filter(|step| *step > 0.0) {
        let ratio = number / step;
        if (ratio - ratio.round()).abs() > 1e-9 * ratio.abs().max(1.0) {
            let what = format!("{} must be a multiple of {}, not {value}", subject(path), bound("multipleOf"));
            let help = nearest([ratio.floor() * step, ratio.ceil() * step]);
            found.push(violation(path, what, "not a multiple", help));
        }
    } else if schema.get("not").is_some_and(is_even) && value.as_i64().is_some_and(|number| number % 2 == 0) {
        let what = format!("{} must be odd, not {value}", subject(path));
        found.push(violation(path, what, "even", nearest([number - 1.0, number + 1.0])));
    }
}

/// What a single-precision number must be, if this one would become infinite or zero.
fn outside_single_precision(number: f64, schema: &Map<String, Json>) -> Option<String> {
    if schema.get("format").and_then(Json::as_str) != Some("float") {
        return None;
    }
    let single = number as f32;
    if single.is_infinite() {
        return Some(format!("between {:e} and {:e}", f32::MIN, f32::MAX));
    }
    (single == 0.0 && number != 0.0).then(|| format!("0 or at least {:e} in magnitude", f32::MIN_POSITIVE))
}

pub(crate) fn is_odd(schema: &Json) -> bool {
    schema.get("not").is_some_and(is_even)
}

fn is_even(schema: &Json) -> bool {
    schema.get("multipleOf").and_then(Json::as_u64) == Some(2)
}

pub(crate) fn range_text(schema: &Map<String, Json>) -> Option<String> {
    let text = |key: &str| schema.get(key).filter(|bound| bound.is_number()).map(ToString::to_string);
    let bound = |key: &str, word: &str| text(key).map(|number| format!("{word} {number}"));
    let range = match (text("minimum"), text("maximum")) {
        (Some(least), Some(most)) => Some(format!("{least} to {most}")),
        _ => {
            let above = bound("minimum", "at least").or_else(|| bound("exclusiveMinimum", "above"));
            let below = bound("maximum", "at most").or_else(|| bound("exclusiveMaximum", "below"));
            let bounds: Vec<String> = above.into_iter().chain(below).collect();
            (!bounds.is_empty()).then(|| bounds.join(", "))
        }
    };
    match (range, text("multipleOf")) {
        (Some(range), None) if schema.get("not").is_some_and(is_even) => Some(format!("{range}, odd")),
        (range, None) => range,
        (Some(range), Some(step)) => Some(format!("{range}, multiples of {step}")),
        (None, Some(step)) => Some(format!("multiples of {step}")),
    }
}

fn list(items: &[Json], schema: &Map<String, Json>, path: &mut Vec<String>, found: &mut Vec<Violation>) {
    let count = |key: &str| schema.get(key).and_then(Json::as_u64);
    let length = items.len() as u64;
    if let Some(least) = count("minItems").filter(|least| length < *least) {
        let what = format!("{} must have at least {least} items, not {length}", subject(path));
        found.push(violation(path, what, "too few", None));
    } else if let Some(most) = count("maxItems").filter(|most| length > *most) {
        let what = format!("{} must have at most {most} items, not {length}", subject(path));
        found.push(violation(path, what, "too many", None));
    }
    let prefix = schema.get("prefixItems").and_then(Json::as_array);
    for (i, item) in items.iter().enumerate() {
        let item_schema = prefix.and_then(|prefix| prefix.get(i)).or_else(|| schema.get("items"));
        let Some(item_schema) = item_schema else { continue };
        path.push(i.to_string());
        check(item, item_schema, path, found);
        path.pop();
    }
}

fn object(map: &Map<String, Json>, schema: &Map<String, Json>, path: &mut Vec<String>, found: &mut Vec<Violation>) {
    let properties = schema.get("properties").and_then(Json::as_object);
    let others = schema.get("additionalProperties");
    for (key, value) in map {
        path.push(key.clone());
        match (properties.and_then(|properties| properties.get(key)), others) {
            (Some(schema), _) => check(value, schema, path, found),
            (None, Some(schema @ Json::Object(_))) => check(value, schema, path, found),
            (None, Some(Json::Bool(true))) => {}
            // An unknown parameter is an error even if the type allows unknown fields.
            (None, closed) if properties.is_some() || closed.is_some() => {
                let known: Vec<&str> = properties.into_iter().flat_map(Map::keys).map(String::as_str).collect();
                let help = match (names::renamed(key, &known), names::new_name(key, &known)) {
                    (Some(renamed), Some(new)) if !value.is_object() && !value.is_array() => Some(format!(
                        "{renamed}: write `{new}: {}`",
                        value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned)
                    )),
                    _ => names::suggestion(key, "parameters", &known),
                };
                let what = format!("unknown parameter `{key}`");
                found.push(Violation { at_key: true, ..violation(path, what, "no such parameter", help) });
            }
            (None, _) => {}
        }
        path.pop();
    }
    for key in schema.get("required").and_then(Json::as_array).into_iter().flatten().filter_map(Json::as_str) {
        if !map.contains_key(key) {
            let what = format!("the parameter `{key}` is missing");
            let doc = properties.and_then(|p| p.get(key)).and_then(|p| p.get("description")).and_then(Json::as_str);
            let help = doc.map(|doc| format!("`{key}`: {}", doc.replace('\n', " ")));
            found.push(violation(path, what, &format!("needs `{key}`"), help));
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::violations;

    fn whats(value: &serde_json::Value, schema: &serde_json::Value) -> Vec<String> {
        violations(value, schema).into_iter().map(|v| v.what).collect()
    }

    #[test]
    fn all_violations_are_found_at_once() {
        let schema = json!({ "type": "object", "properties": {
            "size": { "type": "integer", "minimum": 1, "maximum": 9 },
            "step": { "type": "integer", "multipleOf": 16 },
            "mode": { "type": "string", "enum": ["full", "mean"] },
            "cap": { "type": "number", "exclusiveMinimum": 0 },
        }, "required": ["mode"] });
        let value = json!({ "size": 11, "step": 60, "mode": "ful", "cap": 0, "cpa": 3 });
        let expected = [
            "`size` must be at most 9, not 11",
            "`step` must be a multiple of 16, not 60",
            "`mode` cannot be the text `ful`",
            "`cap` must be above 0, not 0",
            "unknown parameter `cpa`",
        ];
        assert_eq!(whats(&value, &schema), expected);
        assert_eq!(whats(&json!({}), &schema), ["the parameter `mode` is missing"]);
    }

    #[test]
    fn an_optional_value_complains_as_its_type_does() {
        let schema = json!({ "anyOf": [{ "type": "integer", "minimum": 0 }, { "type": "null" }] });
        assert!(whats(&json!(null), &schema).is_empty());
        assert_eq!(whats(&json!("x"), &schema), ["the value must be a whole number, not the text `x`"]);
        assert_eq!(whats(&json!(-1), &schema), ["the value must be at least 0, not -1"]);
    }

    #[test]
    fn numbers_that_single_precision_cannot_hold_are_refused() {
        let schema = json!({ "type": "number", "format": "float" });
        assert!(whats(&json!(3e38), &schema).is_empty() && whats(&json!(0), &schema).is_empty());
        assert_eq!(
            whats(&json!(1e39), &schema),
            ["the value must be between -3.4028235e38 and 3.4028235e38, not 1e39"]
        );
        assert_eq!(
            whats(&json!(1e-60), &schema),
            ["the value must be 0 or at least 1.1754944e-38 in magnitude, not 1e-60"]
        );
        let double = json!({ "type": "number", "format": "double" });
        assert!(whats(&json!(1e39), &double).is_empty() && whats(&json!(1e-60), &double).is_empty());
    }

    #[test]
    fn a_list_beside_a_word_is_looked_into() {
        let names = json!({ "type": "array", "minItems": 1, "items": { "enum": ["a1", "abs_rel"] } });
        let schema =
            json!({ "properties": { "metrics": { "anyOf": [{ "enum": ["all"] }, names, { "type": "null" }] } } });
        let found = |value: serde_json::Value| violations(&json!({ "metrics": value }), &schema);
        assert!(found(json!(["a1", "abs_rel"])).is_empty() && found(json!("all")).is_empty());
        let misspelt = found(json!(["a1", "abs_rle"]));
        assert_eq!(misspelt.len(), 1, "{misspelt:?}");
        assert_eq!(misspelt[0].what, "each of `metrics` cannot be the text `abs_rle`");
        assert_eq!(misspelt[0].path, ["metrics", "1"]);
        assert_eq!(misspelt[0].help.as_deref(), Some("did you mean `abs_rel`?"));
        assert_eq!(found(json!([]))[0].what, "`metrics` must have at least 1 items, not 0");
        assert_eq!(found(json!("abs_rel"))[0].help.as_deref(), Some("did you mean the list `[abs_rel]`?"));
        assert_eq!(found(json!("al"))[0].help.as_deref(), Some("did you mean `all`?"));
    }

    #[test]
    fn old_names_are_answered_with_the_new_ones() {
        let schema = json!({ "type": "object", "additionalProperties": false, "properties": {
            "preset": { "enum": ["kitti-depth", "martins2018"] },
            "sets": { "type": "array", "items": { "enum": ["all", "valid"] } },
            "ground_truth": { "type": "string" },
        } });
        let help = |value: serde_json::Value| violations(&value, &schema)[0].help.clone().unwrap_or_default();
        let renamed = "`paper` is called `martins2018` since version 0.2: write `preset: martins2018`";
        assert_eq!(help(json!({ "preset": "paper" })), renamed);
        assert_eq!(help(json!({ "sets": ["answered"] })), "`answered` is called `valid` since version 0.2");
        let renamed = "`truth` is called `ground_truth` since version 0.2: write `ground_truth: disp_occ`";
        assert_eq!(help(json!({ "truth": "disp_occ" })), renamed);
    }

    #[test]
    fn documented_enumerations_are_read_from_their_constants() {
        let schema = json!({ "oneOf": [{ "const": "sgbm" }, { "const": "hh" }, { "enum": ["bm"], "type": "string" }] });
        assert!(whats(&json!("bm"), &schema).is_empty());
        let found = violations(&json!("sgm"), &schema);
        assert_eq!(found[0].help.as_deref(), Some("did you mean `sgbm`?"));
    }
}
