//! What a node observes of a frame besides the values at its inputs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize};

use super::{Fault, Frame};
use crate::key::Key;
use crate::regular_file;

/// What a node observes of a frame besides its inputs: id, index and time, and the content of files that it opens
/// itself. It is part of the cache keys of the node's values on that frame.
///
/// An ordered node always observes id, index and time; a pure node only if its signature has an observation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Observation {
    /// Paths of files; `{frame}` stands for the frame's id and `{index}` for its index.
    pub files: Vec<PathBuf>,
    /// Files by the id of their frame, beside those.
    pub by_id: BTreeMap<String, PathBuf>,
}

const FRAME: &str = "{frame}";
const INDEX: &str = "{index}";

impl Observation {
    /// Whether a path differs from frame to frame.
    ///
    /// # Errors
    /// The unknown placeholder, as a lower-case fragment.
    pub fn is_per_frame(path: &Path) -> Result<bool, String> {
        let text = path.to_string_lossy();
        let plain = text.replace(FRAME, "").replace(INDEX, "");
        match plain.split_once('{').and_then(|(_, rest)| rest.split_once('}')) {
            Some((name, _)) => Err(format!("`{{{name}}}` is not a placeholder: use `{FRAME}` (id) or `{INDEX}`")),
            None => Ok(plain.len() != text.len()),
        }
    }

    /// The files of a frame.
    pub fn files_of<'a>(&'a self, frame: &'a Frame) -> impl Iterator<Item = PathBuf> + 'a {
        // Both placeholders in one pass: an id may itself contain `{index}`.
        let fill = move |path: &PathBuf| {
            let text = path.to_string_lossy();
            let parts = text.split(FRAME).map(|part| part.replace(INDEX, &frame.index.to_string()));
            PathBuf::from(parts.collect::<Vec<_>>().join(&*frame.id))
        };
        self.files.iter().map(fill).chain(self.by_id.get(&*frame.id).cloned())
    }

    /// A hash of the frame's files, missing ones included; `None` if there are no files to read.
    ///
    /// # Errors
    /// The file that cannot be read.
    pub fn content(&self, frame: &Frame) -> Result<Option<Key>, Fault> {
        if self.files.is_empty() && self.by_id.is_empty() {
            return Ok(None);
        }
        let files: Vec<PathBuf> = self.files_of(frame).collect();
        let mut key = Key::build("files of a frame").number(files.len() as u64);
        for path in files {
            key = match regular_file::open(&path).and_then(Key::of_reader) {
                Ok(content) => key.number(1).key(&content),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => key.number(0),
                Err(error) => {
                    return Err(Fault::new(format!("failed to read {}", path.display())).because(error));
                }
            };
        }
        Ok(Some(key.finish()))
    }
}

/// One or several paths with the placeholders of an [`Observation`], relative to the folder of the YAML file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct FramePaths(pub Vec<PathBuf>);

impl<'de> Deserialize<'de> for FramePaths {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "expected a path or a list of paths")]
        enum Written {
            One(PathBuf),
            Several(Vec<PathBuf>),
        }
        Ok(match Written::deserialize(deserializer)? {
            Written::One(path) => Self(vec![path]),
            Written::Several(paths) => Self(paths),
        })
    }
}

inline_schema!(FramePaths, { "anyOf": [
    { "type": "string", "format": "path" },
    { "type": "array", "items": { "type": "string", "format": "path" } }
] });

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::Observation;
    use crate::contracts::Frame;

    #[test]
    fn placeholders_stand_for_the_id_and_the_index_of_a_frame() {
        let by_id = [("b".to_owned(), PathBuf::from("b.npy"))].into();
        let files = vec![PathBuf::from("p/{frame}_{index}.npy"), PathBuf::from("all.txt")];
        let observation = Observation { files, by_id };
        let of_b: Vec<_> = observation.files_of(&Frame::at_10_hz("b", 1)).collect();
        assert_eq!(of_b, ["p/b_1.npy", "all.txt", "b.npy"].map(PathBuf::from));
        let files: Vec<_> = observation.files_of(&Frame::at_10_hz("a{index}", 7)).collect();
        assert_eq!(files, [PathBuf::from("p/a{index}_7.npy"), PathBuf::from("all.txt")]);
        assert_eq!(Observation::is_per_frame(Path::new("p/{frame}.npy")), Ok(true));
        assert_eq!(Observation::is_per_frame(Path::new("p/all.npy")), Ok(false));
        assert!(Observation::is_per_frame(Path::new("p/{id}.npy")).is_err_and(|what| what.contains("`{id}`")));
    }

    #[test]
    fn the_hash_of_files_follows_their_content_and_whether_they_exist() {
        let folder = tempfile::tempdir().expect("a folder");
        let observation = Observation { files: vec![folder.path().join("{frame}.npy")], ..Observation::default() };
        let content = |id: &str| observation.content(&Frame::at_10_hz(id, 0)).expect("it can be read");
        let missing = content("a");
        std::fs::write(folder.path().join("a.npy"), "1").expect("it is written");
        let first = content("a");
        std::fs::write(folder.path().join("a.npy"), "2").expect("it is written");
        assert!(missing.is_some() && missing != first && first != content("a"));
        assert_eq!(missing, content("b"), "the id enters keys by itself");
        std::fs::create_dir(folder.path().join("c.npy")).expect("it is made");
        let fault = observation.content(&Frame::at_10_hz("c", 0)).expect_err("it is a folder");
        assert!(fault.to_string().contains("c.npy"), "{fault}");
        assert_eq!(Observation::default().content(&Frame::at_10_hz("a", 0)).expect("nothing is read"), None);
    }
}
