//! The folder of a plan's shards.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use depthloom_graphs::Key;
use depthloom_recording::{Condition, Recording};
use depthloom_runs::run_folder::PathState;
use depthloom_runs::{RECORDING, SHARDS};

use crate::shard::Fraction;
use crate::submission::JOBS;

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
    /// What is wrong with it.
    pub damage: String,
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

    /// Whether there is a shard of `run --shard`, or a submission.
    #[must_use]
    pub fn has_shards(&self) -> bool {
        let names = std::fs::read_dir(&self.path).into_iter().flatten().flatten().map(|entry| entry.file_name());
        names.into_iter().any(|name| name == JOBS || name.to_str().is_some_and(|name| parsed(name).is_some()))
    }

    /// The shards that are missing or damaged of the split, by `run --shard`, of which the most are there. Empty if a
    /// split is complete, or if there are no shards. With `bytes`, every byte of their recordings is checked.
    #[must_use]
    pub fn missing(&self, bytes: bool) -> Vec<MissingShard> {
        let mut splits: BTreeMap<(String, usize), BTreeSet<usize>> = BTreeMap::new();
        for entry in std::fs::read_dir(&self.path).into_iter().flatten().flatten() {
            let name = entry.file_name();
            if let Some((split, part)) = name.to_str().and_then(parsed)
                && entry.file_type().is_ok_and(|file_type| file_type.is_dir())
            {
                splits.entry((split, part.count())).or_default().insert(part.number());
            }
        }
        let mut best: Option<Vec<MissingShard>> = None;
        for ((split, count), _) in splits {
            let missing = |number: usize| {
                let name = format!("{split}-{number}-of-{count}");
                let damage = damage(&self.shard(&name), bytes)?;
                Some(MissingShard { name, part: Fraction::new(number, count)?, damage })
            };
            let missing: Vec<MissingShard> = (1..=count).filter_map(missing).collect();
            let share =
                |missing: &[MissingShard]| missing.first().map_or(0, |first| 1000 * missing.len() / first.part.count());
            if best.as_ref().is_none_or(|best| share(&missing) < share(best)) {
                best = Some(missing);
            }
        }
        best.unwrap_or_default()
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

/// `frames-2-of-4`: the name of the split, and which block. Shards of submissions have other names.
fn parsed(name: &str) -> Option<(String, Fraction)> {
    let (rest, count) = name.rsplit_once("-of-")?;
    let (split, number) = rest.rsplit_once('-')?;
    let is_split = ["frames", "variants"].contains(&split);
    is_split.then_some((split.to_owned(), Fraction::new(number.parse().ok()?, count.parse().ok()?)?))
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
        for name in
            ["jobs.json", "1-frames-2-of-4", "frames-2-of-4.partial", "frames-5-of-4", "learn.train", "frames-of-4"]
        {
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
