//! The folder of a plan's shards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::Key;
use depthloom_recording::{Condition, Recording};
use depthloom_runs::run_folder::PathState;
use depthloom_runs::{RECORDING, SHARDS};

use crate::shard::Fraction;

/// The folder of a plan's shards: `<runs>/<experiment>/shards/<plan>`. Each shard is a folder in it, as that of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShardFolder {
    path: PathBuf,
}

/// A shard that is not complete, among others that are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingShard {
    /// The name of its folder.
    pub name: String,
    /// Which block.
    pub part: Fraction,
    /// What is wrong with it; `None` if it is not there.
    pub damage: Option<String>,
}

impl ShardFolder {
    /// The folder for a plan.
    #[must_use]
    pub fn new(runs: &Path, experiment: &str, plan: &Key) -> Self {
        let plan: String = plan.to_string().chars().take(12).collect();
        Self { path: runs.join(experiment).join(SHARDS).join(plan) }
    }

    /// A folder that has another name, as that of a copied folder of runs.
    #[must_use]
    pub fn at(path: &Path) -> Self {
        Self { path: path.to_owned() }
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of a shard.
    #[must_use]
    pub fn shard(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Shards that are not complete although others of the same split are. With `bytes`, every byte of their recordings
    /// is checked.
    #[must_use]
    pub fn missing(&self, bytes: bool) -> Vec<MissingShard> {
        let entries = std::fs::read_dir(&self.path).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        // By the name of the split, `frames` or `1-frames`, and the number of its shards.
        let mut splits: BTreeMap<(String, usize), Vec<bool>> = BTreeMap::new();
        for name in names {
            let is_complete = !name.ends_with(depthloom_durable::PARTIAL);
            let name = name.strip_suffix(depthloom_durable::PARTIAL).map_or(&*name, |name| name.trim_end_matches('.'));
            if let Some((split, part)) = parsed(name) {
                let found = splits.entry((split, part.count())).or_insert_with(|| vec![false; part.count()]);
                found[part.number() - 1] |= is_complete;
            }
        }
        let mut missing = Vec::new();
        for ((split, count), found) in splits {
            for (index, is_there) in found.into_iter().enumerate() {
                let Some(part) = Fraction::new(index + 1, count) else { continue };
                let name = format!("{split}-{}-of-{count}", part.number());
                let damage = if is_there { damage(&self.shard(&name), bytes) } else { None };
                if !is_there || damage.is_some() {
                    missing.push(MissingShard { name, part, damage });
                }
            }
        }
        missing
    }
}

/// What is wrong with a finished shard; `None` if it is complete. With `bytes`, every byte of its recording is checked.
#[must_use]
pub fn damage(shard: &Path, bytes: bool) -> Option<String> {
    if PathState::at(shard).is_ok_and(|state| state == PathState::Nothing) {
        return Some("it is not there".to_owned());
    }
    match Recording::open(shard.join(RECORDING)) {
        Err(error) => Some(error.to_string()),
        Ok(recording) => match recording.condition() {
            Condition::Complete if bytes => recording.check_committed().err().map(|error| error.to_string()),
            Condition::Complete => None,
            _ => Some("its recording is not complete".to_owned()),
        },
    }
}

/// `1-frames-2-of-4`: the name of the split, and which block.
fn parsed(name: &str) -> Option<(String, Fraction)> {
    let (rest, count) = name.rsplit_once("-of-")?;
    let (split, number) = rest.rsplit_once('-')?;
    Some((split.to_owned(), Fraction::new(number.parse().ok()?, count.parse().ok()?)?))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use depthloom_graphs::Key;

    use super::{ShardFolder, parsed};
    use crate::shard::Fraction;

    #[test]
    fn shards_are_recognised_by_their_names() {
        let part = Fraction::new(2, 4).unwrap();
        assert_eq!(parsed("frames-2-of-4"), Some(("frames".to_owned(), part)));
        assert_eq!(parsed("1-frames-2-of-4"), Some(("1-frames".to_owned(), part)));
        for name in ["jobs.json", "frames-5-of-4", "learn.train", "frames-of-4"] {
            assert_eq!(parsed(name), None, "{name}");
        }
    }

    #[test]
    fn the_folder_is_named_by_the_plan() {
        let key = Key::of_content(b"a plan");
        let folder = ShardFolder::new(Path::new("runs"), "table1", &key);
        assert!(folder.path().starts_with("runs/table1/shards"));
        assert!(key.to_string().starts_with(folder.path().file_name().unwrap().to_str().unwrap()));
        assert!(folder.missing(true).is_empty());
    }
}
