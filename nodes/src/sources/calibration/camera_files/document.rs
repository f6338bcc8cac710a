//! A text of named numbers, whatever its syntax: YAML, OpenCV's dialect of it, OpenCV's XML, JSON.

use std::path::Path;

use depthloom_graphs::Fault;
use serde_json::{Map, Value as Json};

use crate::sources::calibration::camera_files::camera::FORMS;

/// Bytes.
const MOST_BYTES: usize = 1 << 20;
const DEEPEST: usize = 16;

pub(super) struct Document<'a> {
    path: &'a Path,
    root: Map<String, Json>,
}

impl<'a> Document<'a> {
    pub(super) fn parse(path: &'a Path, bytes: &[u8]) -> Result<Self, Fault> {
        let fault = |what: String| Fault::new(format!("{}: {what}", path.display())).remedy(FORMS);
        if bytes.len() > MOST_BYTES {
            let (size, most) = (bytes.len() >> 10, MOST_BYTES >> 10);
            return Err(fault(format!("the file has {size} KiB, and a calibration at most {most}")));
        }
        let text = std::str::from_utf8(bytes).map_err(|_| fault("the file is not text".to_owned()))?;
        let text = text.trim_start_matches('\u{feff}');
        let root = match text.trim_start().chars().next() {
            Some('<') => xml(text),
            Some('{') if !text.starts_with('%') => serde_json::from_str(text).map_err(|error| error.to_string()),
            _ => yaml(text),
        };
        match root.map_err(fault)? {
            Json::Object(root) => Ok(Self { path, root }),
            Json::Null => Err(fault("the file is empty".to_owned())),
            _ => Err(fault("the file holds no names with values".to_owned())),
        }
    }

    pub(super) const fn path(&self) -> &Path {
        self.path
    }

    pub(super) fn fault(&self, what: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{}: {what}", self.path.display()))
    }

    /// The first of these names that exists, with its value.
    pub(super) fn get<'n>(&self, names: &[&'n str]) -> Option<(&'n str, &Json)> {
        names.iter().find_map(|name| Some((*name, self.root.get(*name)?)))
    }

    pub(super) fn has(&self, names: &[&str]) -> bool {
        self.get(names).is_some()
    }

    /// The first of these names that exists: a list, nested lists, or a matrix with `data`.
    pub(super) fn list(&self, names: &[&str]) -> Result<Option<Vec<f64>>, Fault> {
        let Some((name, value)) = self.get(names) else { return Ok(None) };
        self.numbers(name, value).map(Some)
    }

    pub(super) fn matrix<const N: usize>(&self, names: &[&str]) -> Result<Option<[f64; N]>, Fault> {
        let Some((name, value)) = self.get(names) else { return Ok(None) };
        self.array(name, value).map(Some)
    }

    pub(super) fn array<const N: usize>(&self, name: &str, value: &Json) -> Result<[f64; N], Fault> {
        let numbers = self.numbers(name, value)?;
        let count = numbers.len();
        numbers
            .try_into()
            .map_err(|_| self.fault(format!("`{name}` holds {count} numbers, expected {N}")).remedy(FORMS))
    }

    pub(super) fn numbers(&self, name: &str, value: &Json) -> Result<Vec<f64>, Fault> {
        let wrong = |what: String| self.fault(format!("`{name}` {what}")).remedy(FORMS);
        let value = match value {
            Json::Object(map) => map
                .get("data")
                .ok_or_else(|| wrong("is neither a list of numbers nor a matrix with `data`".to_owned()))?,
            other => other,
        };
        let mut numbers = Vec::new();
        flatten(value, &mut numbers)
            .map_err(|found| wrong(format!("holds `{found}`, which is not a finite number")))?;
        Ok(numbers)
    }

    pub(super) fn text(&self, names: &[&str]) -> Option<&str> {
        self.get(names)?.1.as_str()
    }

    pub(super) fn size(&self, width: &[&str], height: &[&str]) -> Result<Option<(u32, u32)>, Fault> {
        let one = |names: &[&str]| Ok::<_, Fault>(self.matrix::<1>(names)?.map(|[number]| number));
        let (Some(width), Some(height)) = (one(width)?, one(height)?) else { return Ok(None) };
        self.size_of([width, height]).map(Some)
    }

    pub(super) fn size_of(&self, [width, height]: [f64; 2]) -> Result<(u32, u32), Fault> {
        let is_one = |number: f64| number.fract() == 0.0 && (1.0..=1e6).contains(&number);
        match is_one(width) && is_one(height) {
            true => Ok((width as u32, height as u32)),
            false => Err(self.fault(format!("{width}x{height} is not the size of an image")).remedy(FORMS)),
        }
    }

    pub(super) fn within(&self, name: &str) -> Option<Self> {
        let root = self.root.get(name)?.as_object()?.clone();
        Some(Self { path: self.path, root })
    }
}

fn flatten(value: &Json, into: &mut Vec<f64>) -> Result<(), String> {
    let mut push = |text: &str, number: Option<f64>| match number.filter(|number| number.is_finite()) {
        Some(number) => {
            into.push(number);
            Ok(())
        }
        None => Err(text.chars().take(40).collect()),
    };
    match value {
        Json::Number(number) => push(&number.to_string(), number.as_f64()),
        // XML, and what YAML takes for text.
        Json::String(text) => text.split_whitespace().try_for_each(|word| push(word, word.parse().ok())),
        Json::Array(items) => items.iter().try_for_each(|item| flatten(item, into)),
        other => push(&other.to_string(), None),
    }
}

/// OpenCV writes `%YAML:1.0` for `%YAML 1.0`, and tags its matrices.
fn yaml(text: &str) -> Result<Json, String> {
    let text = match text.strip_prefix("%YAML") {
        Some(rest) => rest.split_once('\n').map_or("", |(_, rest)| rest),
        None => text,
    };
    // Tags repeat what the values show. Lines are kept, so that line numbers in errors are right, except for the
    // first.
    let text =
        ["!!opencv-nd-matrix", "!!opencv-matrix"].iter().fold(text.to_owned(), |text, tag| text.replace(tag, ""));
    let options = serde_saphyr::options! {
        budget: serde_saphyr::budget! {
            max_events: 400_000,
            max_nodes: 200_000,
            max_depth: DEEPEST,
            flow_nesting_limit: DEEPEST,
            max_aliases: 1000,
            max_anchors: 1000,
            max_documents: 1,
        },
        alias_limits: serde_saphyr::alias_limits! {
            max_total_replayed_events: 100_000,
            max_replay_stack_depth: 16,
        },
        non_finite_float_policy: serde_saphyr::NonFiniteFloatPolicy::AsString,
        with_snippet: false,
    };
    serde_saphyr::from_str_with_options::<Json>(&text, options).map_err(|error| error.to_string())
}

/// The subset of XML that OpenCV writes: elements with elements or text.
fn xml(text: &str) -> Result<Json, String> {
    let mut stack: Vec<(String, Map<String, Json>, String)> = vec![(String::new(), Map::new(), String::new())];
    let mut rest = text;
    let line = |rest: &str| 1 + text[..text.len() - rest.len()].matches('\n').count();
    while let Some(at) = rest.find('<') {
        let (before, tag) = rest.split_at(at);
        if let Some((_, _, content)) = stack.last_mut() {
            content.push_str(before);
        }
        let (skip, end) = match () {
            () if tag.starts_with("<!--") => (true, "-->"),
            () if tag.starts_with("<?") => (true, "?>"),
            () => (tag.starts_with("<!"), ">"),
        };
        let length = tag.find(end).ok_or_else(|| format!("line {}: a tag is not closed", line(tag)))?;
        let inside = tag[1..length].trim();
        rest = &tag[length + end.len()..];
        if skip {
            continue;
        }
        if let Some(name) = inside.strip_prefix('/') {
            let (opened, children, content) = stack.pop().filter(|_| !stack.is_empty()).unwrap_or_default();
            if opened != name.trim() {
                return Err(format!("line {}: `</{}>` closes `<{opened}>`", line(tag), name.trim()));
            }
            let value = if children.is_empty() { Json::String(content) } else { Json::Object(children) };
            if let Some((_, parent, _)) = stack.last_mut() {
                parent.insert(opened, value);
            }
        } else if let Some(name) = inside.strip_suffix('/') {
            if let Some((_, parent, _)) = stack.last_mut() {
                parent.insert(name.trim().to_owned(), Json::Null);
            }
        } else {
            let name = inside.split_whitespace().next().unwrap_or_default().to_owned();
            if stack.len() > DEEPEST {
                return Err(format!("line {}: elements are nested deeper than {DEEPEST}", line(tag)));
            }
            stack.push((name, Map::new(), String::new()));
        }
    }
    let (_, root, _) = stack.swap_remove(0);
    if !stack.is_empty() {
        return Err("an element is not closed: the file is cut off".to_owned());
    }
    root.into_iter()
        .find(|(name, value)| name == "opencv_storage" && value.is_object())
        .map(|(_, value)| value)
        .ok_or_else(|| "it holds no element `opencv_storage`".to_owned())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::Document;

    fn parsed(text: &str) -> Result<Document<'static>, String> {
        Document::parse(Path::new("camera.yml"), text.as_bytes()).map_err(|fault| fault.to_string())
    }

    /// As `cv2.FileStorage` writes them.
    const YAML: &str = "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1., -2.5e+02, .5,\n       0. ]\nsize: [ 640, 480 ]\n";
    const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<!-- two -->\n<M1 type_id=\"opencv-matrix\">\n  <rows>2</rows>\n  <cols>2</cols>\n  \
        <dt>d</dt>\n  <data>\n    1. -2.5e+02 .5\n    0.</data></M1>\n<size>\n  640 480</size>\n</opencv_storage>\n";
    const JSON: &str = "{ \"M1\": { \"type_id\": \"opencv-matrix\", \"rows\": 2, \"cols\": 2, \"dt\": \"d\", \"data\": [ 1.0, -2.5e+02, 0.5, 0.0 ] }, \"size\": [ 640, 480 ] }";

    #[test]
    fn every_syntax_gives_the_same_calibration() {
        for text in [YAML, XML, JSON] {
            let document = parsed(text).unwrap();
            assert_eq!(document.matrix(&["K1", "M1"]).unwrap(), Some([1.0, -250.0, 0.5, 0.0]), "{text}");
            assert_eq!(document.list(&["size"]).unwrap(), Some(vec![640.0, 480.0]));
            assert_eq!(document.list(&["D1"]).unwrap(), None);
            assert!(
                document.matrix::<9>(&["M1"]).unwrap_err().to_string().contains("`M1` holds 4 numbers, expected 9")
            );
        }
    }

    #[test]
    fn errors_state_their_place() {
        let error = |text: &str| parsed(text).map(|_| ()).unwrap_err();
        assert!(error("").contains("the file is empty"));
        assert!(error("a: [1, 2").contains("camera.yml: "));
        assert!(error("- 1\n").contains("holds no names with values"));
        assert!(error(&XML[..200]).contains("cut off") || error(&XML[..200]).contains("not closed"));
        assert!(error("<a></b>").contains("line 1: `</b>` closes `<a>`"));
        assert!(error("</a>").contains("closes `<>`"));
        assert!(error("<html></html>").contains("no element `opencv_storage`"));
        assert!(error(&"<a>".repeat(1000)).contains("nested deeper"));
        assert!(error(&format!("a: {}", "[".repeat(1000))).contains("camera.yml: "));
        assert!(error("a: 1\na: 2\n").contains("camera.yml: "));
        let document = parsed("a: [1, .nan]\nb: [1, x]\nc: true\n").unwrap();
        for name in ["a", "b", "c"] {
            assert!(document.list(&[name]).unwrap_err().to_string().contains("which is not a finite number"), "{name}");
        }
    }
}
