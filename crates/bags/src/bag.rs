//! A bag: one file or several, of either storage.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::{Fault, regular_file};
use depthloom_mcap::{PositionedFile, begins_as_mcap, name_of};
use depthloom_threads::{Budget, core_count};

use crate::MOST_BYTES;
use crate::metadata;
use crate::storage::ChunkCache;
use crate::storage::mcap_file::McapFile;
use crate::storage::message::{Channel, Message, Place, Warning};
use crate::storage::sqlite_file::{MAGIC as SQLITE, SqliteFile};

/// How a zstd frame begins. No CDR or protobuf message begins so.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

const WANTED: &str = "path is the folder of a ROS 2 bag (with metadata.yaml), or one file of it (.mcap, .db3); ROS 1's .bag is converted by `rosbags-convert` (PyPI, rosbags)";

/// A topic of a bag.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Its name: `/stereo/left/image_rect`.
    pub name: String,
    /// Its messages' type: `sensor_msgs/msg/Image`, `foxglove.RawImage`.
    pub message_type: String,
    /// How they are written: `cdr`, `protobuf`, `json`.
    pub encoding: String,
    /// File, and channel in it.
    channels: Vec<(usize, u32)>,
}

enum Storage {
    Mcap(Box<McapFile>),
    Sqlite(SqliteFile),
}

/// A ROS 2 bag, or another MCAP file. Any number of threads may read it at once.
pub struct Bag {
    path: PathBuf,
    files: Vec<Storage>,
    topics: Vec<Topic>,
    warnings: Vec<String>,
    losses: Vec<String>,
}

impl Bag {
    /// Opens the folder of a bag, or a file of one. Where the files have an index, it alone is read.
    pub fn open(path: &Path) -> Result<Self, Fault> {
        let mut bag = Self {
            path: path.to_owned(),
            files: Vec::new(),
            topics: Vec::new(),
            warnings: Vec::new(),
            losses: Vec::new(),
        };
        let cache = Arc::new(ChunkCache::default());
        for file in bag.files_of(path)? {
            let storage = open(&file, bag.files.len(), &cache)?;
            bag.take(storage);
        }
        if bag.topics.is_empty() {
            let why = bag.losses.first().or(bag.warnings.first());
            let why = why.map_or("was its recorder stopped at once?", String::as_str);
            return Err(Fault::new(format!("{} holds no topic", path.display())).remedy(why.to_owned()));
        }
        bag.topics.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(bag)
    }

    /// The folder or file that was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topics by name. One whose messages are of two types is there twice.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Warnings about the bag that are not failures.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Warnings that messages were lost: the bag is truncated, or not all of it was written.
    #[must_use]
    pub fn losses(&self) -> &[String] {
        &self.losses
    }

    /// The topic of a name.
    pub fn topic(&self, name: &str) -> Result<&Topic, Fault> {
        self.topics.iter().find(|topic| topic.name == name).ok_or_else(|| {
            let fault = Fault::new(format!("{} has no topic {name}", self.path.display()));
            let names = self.topics.iter().map(|topic| topic.name.as_str());
            match depthloom_graphs::language::nearest(name, names) {
                Some(near) => fault.remedy(format!("did you mean {near}?")),
                None => fault.remedy(self.there_are(|_| true)),
            }
        })
    }

    /// The topics that there are of some kind, in words.
    #[must_use]
    pub fn there_are(&self, wanted: impl Fn(&Topic) -> bool) -> String {
        const MOST: usize = 24;
        let topics: Vec<String> = self
            .topics
            .iter()
            .filter(|topic| wanted(topic))
            .map(|topic| format!("{} ({})", topic.name, topic.message_type))
            .collect();
        match topics.len() {
            0 => "there are no such topics".to_owned(),
            count if count > MOST => format!("there are {}, and {} more", topics[..MOST].join(", "), count - MOST),
            _ => format!("there are {}", topics.join(", ")),
        }
    }

    /// The messages of topics, a list each, by the time of recording; those of one time in the order of the files.
    pub fn messages(&self, topics: &[&Topic]) -> Result<Vec<Vec<Message>>, Fault> {
        let mut messages = vec![Vec::new(); topics.len()];
        for (number, file) in self.files.iter().enumerate() {
            let mut indices = Vec::new();
            let mut channels = Vec::new();
            for (which, topic) in topics.iter().enumerate() {
                for (_, channel) in topic.channels.iter().filter(|(file, _)| *file == number) {
                    indices.push(which);
                    channels.push(*channel);
                }
            }
            if channels.is_empty() {
                continue;
            }
            let mut give = |which: usize, message: Message| messages[indices[which]].push(message);
            match file {
                Storage::Mcap(file) => file.messages(number, &channels, &mut give)?,
                Storage::Sqlite(file) => file.messages(number, &channels, &mut give)?,
            }
        }
        // Stable: two workers of a recorder may write one time in either order.
        messages.iter_mut().for_each(|messages| messages.sort_by_key(|message| message.log_ns));
        Ok(messages)
    }

    /// A message's bytes, unpacked where messages were compressed one by one.
    pub fn read(&self, message: &Message) -> Result<Arc<[u8]>, Fault> {
        let bytes = match &self.files[message.file] {
            Storage::Mcap(file) => file.read(message.place)?,
            Storage::Sqlite(file) => file.read(message.place)?,
        };
        if bytes.starts_with(&ZSTD) { self.unpacked(&bytes).map(Into::into) } else { Ok(bytes.into()) }
    }

    /// The first bytes of messages, at most `most` each; `None` where messages were compressed one by one: see
    /// [`Bag::read`].
    pub fn heads(&self, messages: &[Message], most: usize) -> Result<Vec<Option<Vec<u8>>>, Fault> {
        let budget = Budget::new(core_count());
        let _own = budget.permit();
        let mut heads = vec![None; messages.len()];
        for (number, file) in self.files.iter().enumerate() {
            let in_file: Vec<usize> = (0..messages.len()).filter(|at| messages[*at].file == number).collect();
            let places: Vec<Place> = in_file.iter().map(|at| messages[*at].place).collect();
            let read = match file {
                Storage::Mcap(file) => file.heads(&places, most, &budget)?,
                Storage::Sqlite(file) => file.heads(&places, most)?,
            };
            for (at, head) in in_file.into_iter().zip(read) {
                heads[at] = Some(head).filter(|head| !head.starts_with(&ZSTD));
            }
        }
        Ok(heads)
    }

    fn unpacked(&self, packed: &[u8]) -> Result<Vec<u8>, Fault> {
        let failed =
            |error| Fault::new(format!("{}: a message cannot be decompressed", self.path.display())).because(error);
        let mut bytes = Vec::new();
        let reader = zstd::stream::read::Decoder::new(packed).map_err(failed)?;
        reader.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
        match bytes.len() as u64 > MOST_BYTES {
            true => Err(Fault::new(format!(
                "{}: a message decompresses to more than the {} MiB that one may have",
                self.path.display(),
                MOST_BYTES >> 20
            ))),
            false => Ok(bytes),
        }
    }

    fn take(&mut self, storage: Storage) {
        let number = self.files.len();
        let channels: Vec<(u32, Channel)> = match &storage {
            Storage::Mcap(file) => file.channels().iter().map(|(id, of)| (u32::from(*id), of.clone())).collect(),
            Storage::Sqlite(file) => file.channels().map(|(id, of)| (id, of.clone())).collect(),
        };
        let warning = match &storage {
            Storage::Mcap(file) => file.warning(),
            Storage::Sqlite(file) => file.warning(),
        };
        if let Some(Warning { text, is_loss }) = warning {
            let list = if *is_loss { &mut self.losses } else { &mut self.warnings };
            list.push(text.clone());
        }
        for (id, Channel { topic: name, message_type, encoding }) in channels {
            let is_same = |topic: &&mut Topic| {
                (&topic.name, &topic.message_type, &topic.encoding) == (&name, &message_type, &encoding)
            };
            match self.topics.iter_mut().find(is_same) {
                Some(topic) => topic.channels.push((number, id)),
                None => self.topics.push(Topic { name, message_type, encoding, channels: vec![(number, id)] }),
            }
        }
        self.files.push(storage);
    }

    /// The files of a bag: those that its metadata names; without metadata, those in the folder, if they are of one
    /// bag.
    fn files_of(&mut self, path: &Path) -> Result<Vec<PathBuf>, Fault> {
        if path.file_name().is_some_and(|name| name == metadata::NAME)
            && let Some(folder) = path.parent()
        {
            return self.files_of(folder);
        }
        if !path.exists() {
            return Err(Fault::new(format!("there is no {}", path.display())).remedy(WANTED));
        }
        if !path.is_dir() {
            return Ok(vec![path.to_owned()]);
        }
        if let Some(files) = metadata::files(path)? {
            return Ok(files);
        }
        let failed = |error| Fault::new(format!("failed to list {}", path.display())).because(error);
        let mut files = Vec::new();
        for entry in std::fs::read_dir(path).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            if file.extension().is_some_and(|ending| ending == "mcap" || ending == "db3") && file.is_file() {
                files.push(file);
            }
        }
        files.sort_by_key(|file| split_of(file));
        let bags: std::collections::BTreeSet<String> = files.iter().map(|file| split_of(file).0).collect();
        match (files.as_slice(), bags.len()) {
            ([], _) => Err(Fault::new(format!("{} holds no bag", path.display())).remedy(WANTED)),
            (files, 1) => {
                let count = files.len();
                let read = match count {
                    1 => "the one file that it holds is read".to_owned(),
                    _ => format!("the {count} files that it holds are read"),
                };
                self.warnings.push(format!("{} has no metadata.yaml: {read}", name_of(path)));
                Ok(files.to_vec())
            }
            (files, count) => {
                let names: Vec<String> = files.iter().take(8).map(|file| file.display().to_string()).collect();
                let what = format!("{} has no metadata.yaml, and files of {count} bags", path.display());
                Err(Fault::new(what).remedy(format!("name one of them: {}", names.join(", "))))
            }
        }
    }
}

/// The name of the bag that a file is a part of, and which part: `drive_3.mcap` is part 3 of `drive`.
fn split_of(file: &Path) -> (String, u64) {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    match stem.rsplit_once('_').and_then(|(name, part)| Some((name.to_owned(), part.parse().ok()?))) {
        Some(split) => split,
        None => (stem, 0),
    }
}

/// Opens a file by its first bytes, not its name.
fn open(path: &Path, number: usize, cache: &Arc<ChunkCache>) -> Result<Storage, Fault> {
    let file = PositionedFile::open(path)?;
    let head = file.range(0, file.size.min(16), 16)?;
    let no_bag = |what: &str| Fault::new(format!("{} {what}", path.display())).remedy(WANTED);
    match head.as_slice() {
        _ if begins_as_mcap(&file)? => Ok(Storage::Mcap(Box::new(McapFile::open(file, number, Arc::clone(cache))?))),
        head if head == SQLITE => Ok(Storage::Sqlite(SqliteFile::open(path)?)),
        head if head.starts_with(&ZSTD) => Err(metadata::packed(path)),
        head if head.starts_with(b"#ROSBAG V") => Err(no_bag("is a ROS 1 bag")
            .remedy("`rosbags-convert --src FILE.bag --dst FOLDER` (PyPI, rosbags) makes a ROS 2 bag of it")),
        [] => Err(no_bag("is empty")),
        head if regular_file::is_lfs_pointer(head) => {
            Err(Fault::new(format!("{} is a pointer of Git LFS, not the file itself", path.display()))
                .remedy(regular_file::LFS_REMEDY))
        }
        _ => Err(no_bag("is neither an MCAP file nor an SQLite database")),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn parts_of_a_bag_come_by_number() {
        let mut files = ["b/drive_10.mcap", "b/drive_9.mcap", "b/drive_0.mcap"].map(Path::new);
        files.sort_by_key(|file| super::split_of(file));
        assert_eq!(files, ["b/drive_0.mcap", "b/drive_9.mcap", "b/drive_10.mcap"].map(Path::new));
        assert_ne!(super::split_of(Path::new("a_0.db3")).0, super::split_of(Path::new("b_0.db3")).0);
    }
}
