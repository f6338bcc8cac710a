//! Parameters that follow others unless they have their own value.

use serde_json::Value as Json;

use crate::registry::ParamError;

#[derive(Debug, PartialEq)]
pub(crate) struct Following {
    pub(crate) name: String,
    pub(crate) is_auto: bool,
    pub(super) follows: Vec<(String, Json)>,
    /// Its value if it followed them.
    pub(super) auto: Json,
}

const FOLLOWS: &str = "follows";
const AUTO: &str = "auto";

pub(super) fn parameters(
    schema: &Json,
    given: &Json,
    resolved: &Json,
    resolve: &dyn Fn(&Json) -> Result<Json, ParamError>,
) -> Vec<Following> {
    let properties = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    let all: Vec<(&String, &Vec<Json>)> =
        properties.filter_map(|(name, schema)| Some((name, schema.get(FOLLOWS)?.as_array()?))).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let mut all_auto = given.clone();
    all.iter().for_each(|(name, _)| all_auto[name.as_str()] = AUTO.into());
    let Ok(followed) = resolve(&all_auto) else { return Vec::new() };
    let value = |name: &Json| {
        let name = name.as_str()?;
        Some((name.to_owned(), resolved.get(name)?.clone()))
    };
    let following = |(name, follows): (&String, &Vec<Json>)| Following {
        name: name.clone(),
        is_auto: given.get(name).is_none_or(|given| given == AUTO),
        follows: follows.iter().filter_map(value).collect(),
        auto: followed[name.as_str()].clone(),
    };
    all.into_iter().map(following).collect()
}

/// Explains an invalid value that follows other parameters.
pub(super) fn cause(schema: &Json, given: &Json, path: &[String]) -> Option<String> {
    let [name] = path else { return None };
    let follows = schema.get("properties")?.get(name)?.get(FOLLOWS)?.as_array()?;
    let follows: Vec<String> = follows.iter().filter_map(|name| Some(format!("`{}`", name.as_str()?))).collect();
    let is_auto = given.get(name).is_none_or(|given| given == AUTO);
    is_auto.then(|| {
        format!(
            "`{name}` is `auto`: it follows {}; give it a value of its own, or leave the others to it",
            follows.join(", ")
        )
    })
}

/// Explains a parameter that does not fit others which are `auto`.
pub(super) fn others(
    schema: &Json,
    given: &Json,
    path: &[String],
    what: &str,
    resolve: &dyn Fn(&Json) -> Result<Json, ParamError>,
) -> Option<String> {
    let [name] = path else { return None };
    let mut rest = given.clone();
    rest.as_object_mut()?.shift_remove(name)?;
    let rest = resolve(&rest).ok()?;
    let properties = schema.get("properties")?.as_object()?;
    let is_named = |other: &str| what.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == other);
    let others = properties.iter().filter_map(|(other, schema)| {
        let follows = schema.get(FOLLOWS)?.as_array()?;
        let is_auto = other != name && given.get(other).is_none_or(|given| given == AUTO);
        (is_auto && is_named(other)).then_some(())?;
        let follows = follows.iter().filter_map(Json::as_str).map(|name| match rest.get(name) {
            Some(value) => format!("`{name}` {value}"),
            None => format!("`{name}`"),
        });
        let follows: Vec<String> = follows.collect();
        Some(format!("`{other}` is `auto`, {} at {}", rest.get(other)?, follows.join(", ")))
    });
    let others: Vec<String> = others.collect();
    (!others.is_empty()).then(|| format!("{}; give it a value of its own, too", others.join(", ")))
}
