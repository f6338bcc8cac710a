//! A bag's file in rosbag2's SQLite storage: tables `topics` and `messages`. It is opened read-only and without locks,
//! and does not wait for other programs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use depthloom_graphs::{Fault, regular_file};
use depthloom_mcap::{COPY_AGAIN, name_of};
use depthloom_threads::locked;
use rusqlite::config::DbConfig;
use rusqlite::{Connection, MAIN_DB, OpenFlags};

use super::message::{Channel, Message, Place, Warning};
use crate::MOST_BYTES;

/// How every SQLite file begins.
pub(crate) const MAGIC: &[u8; 16] = b"SQLite format 3\0";

const MOST_TOPICS: i64 = 100_000;
const MOST_MESSAGES: i64 = 400_000_000 / size_of::<Message>() as i64;

/// The most unused connections that are kept: a bag may have many files.
const MOST_IDLE: usize = 4;

pub(crate) struct SqliteFile {
    path: PathBuf,
    /// Of threads that read and of those that have read.
    connections: Mutex<Vec<Connection>>,
    topics: BTreeMap<u32, (i64, Channel)>,
    warning: Option<Warning>,
}

impl SqliteFile {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        // A pipe or a device is not a database.
        drop(
            regular_file::open(path)
                .map_err(|error| Fault::new(format!("failed to open {}", path.display())).because(error))?,
        );
        let mut file = Self {
            path: path.to_owned(),
            connections: Mutex::default(),
            topics: BTreeMap::new(),
            warning: unwritten(path),
        };
        let connection = file.connection()?;
        let tables = file.tables(&connection)?;
        let is_plain =
            |table: &str| tables.get(table).is_some_and(|sql| sql.to_ascii_uppercase().starts_with("CREATE TABLE"));
        if !is_plain("topics") || !is_plain("messages") {
            let names = tables.keys().take(8).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
            let has = if names.is_empty() { "no tables".to_owned() } else { format!("the tables {names}") };
            let what = format!("{} is an SQLite database with {has}, and no bag", path.display());
            return Err(
                Fault::new(what).remedy("a bag of rosbag2's sqlite3 storage has the tables `topics` and `messages`")
            );
        }
        file.topics = file.topics_of(&connection)?;
        file.give_back(connection);
        Ok(file)
    }

    pub(crate) fn channels(&self) -> impl Iterator<Item = (u32, &Channel)> {
        self.topics.iter().map(|(number, (_, channel))| (*number, channel))
    }

    pub(crate) const fn warning(&self) -> Option<&Warning> {
        self.warning.as_ref()
    }

    #[expect(clippy::needless_pass_by_value, reason = "errors are mapped by it")]
    fn fault(&self, what: &str, error: rusqlite::Error) -> Fault {
        Fault::new(format!("{}: {what}", self.path.display())).because(error.to_string()).remedy(COPY_AGAIN)
    }

    fn connection(&self) -> Result<Connection, Fault> {
        if let Some(connection) = locked(&self.connections).pop() {
            return Ok(connection);
        }
        let failed = |error| self.fault("failed to open the database", error);
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(uri(&self.path)?, flags).map_err(failed)?;
        // Code in the schema of an untrusted file is never run.
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true).map_err(failed)?;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false).map_err(failed)?;
        Ok(connection)
    }

    fn give_back(&self, connection: Connection) {
        let mut connections = locked(&self.connections);
        if connections.len() < MOST_IDLE {
            connections.push(connection);
        }
    }

    fn tables(&self, connection: &Connection) -> Result<BTreeMap<String, String>, Fault> {
        let read = || {
            let mut query =
                connection.prepare("SELECT name, sql FROM sqlite_master WHERE type = 'table' LIMIT 1000")?;
            let rows =
                query.query_map([], |row| Ok((row.get(0)?, row.get::<_, Option<String>>(1)?.unwrap_or_default())))?;
            rows.collect::<rusqlite::Result<_>>()
        };
        read().map_err(|error| self.fault("failed to read its schema", error))
    }

    fn topics_of(&self, connection: &Connection) -> Result<BTreeMap<u32, (i64, Channel)>, Fault> {
        let read = || {
            let mut query =
                connection.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id LIMIT ?1")?;
            let rows = query.query_map([MOST_TOPICS], |row| {
                Ok((row.get(0)?, Channel { topic: row.get(1)?, message_type: row.get(2)?, encoding: row.get(3)? }))
            })?;
            (0..).zip(rows).map(|(number, row)| Ok((number, row?))).collect::<rusqlite::Result<_>>()
        };
        read().map_err(|error| self.fault("failed to read its topics", error))
    }

    /// The messages of some topics, in the order of the file, each with the topic's place among them. What they hold is
    /// not touched.
    pub(crate) fn messages(
        &self,
        file: usize,
        channels: &[u32],
        give: &mut dyn FnMut(usize, Message),
    ) -> Result<(), Fault> {
        let ids: Vec<i64> = channels.iter().map(|number| self.topics[number].0).collect();
        let connection = self.connection()?;
        let mut read = || {
            let mut query =
                connection.prepare("SELECT rowid, topic_id, timestamp FROM messages ORDER BY rowid LIMIT ?1")?;
            let mut rows = query.query([MOST_MESSAGES])?;
            while let Some(row) = rows.next()? {
                let topic: i64 = row.get(1)?;
                if let Some(which) = ids.iter().position(|id| *id == topic) {
                    let log_ns = u64::try_from(row.get::<_, i64>(2)?).unwrap_or(0);
                    give(which, Message { file, log_ns, place: Place::Row(row.get(0)?) });
                }
            }
            Ok(())
        };
        read().map_err(|error| self.fault("failed to list its messages", error))?;
        self.give_back(connection);
        Ok(())
    }

    /// The first `most` bytes of a message.
    fn bytes(&self, connection: &Connection, row: i64, most: u64) -> Result<Vec<u8>, Fault> {
        let failed = |error| self.fault(&format!("failed to read message {row}"), error);
        let blob = connection.blob_open(MAIN_DB, "messages", "data", row, true).map_err(failed)?;
        let length = (blob.len() as u64).min(most);
        if length > MOST_BYTES {
            let (long, most) = (length.div_ceil(1 << 20), MOST_BYTES >> 20);
            return Err(Fault::new(format!(
                "{}: message {row} has {long} MiB, more than the {most} MiB that one may",
                self.path.display()
            )));
        }
        let mut bytes = vec![0; usize::try_from(length).expect("no more than the limit")];
        blob.read_at_exact(&mut bytes, 0).map_err(failed)?;
        Ok(bytes)
    }

    fn row(place: Place) -> i64 {
        match place {
            Place::Row(row) => row,
            Place::Bytes { .. } | Place::Chunk { .. } => unreachable!("bytes and chunks are MCAP's"),
        }
    }

    pub(crate) fn read(&self, place: Place) -> Result<Vec<u8>, Fault> {
        let connection = self.connection()?;
        let bytes = self.bytes(&connection, Self::row(place), u64::MAX)?;
        self.give_back(connection);
        Ok(bytes)
    }

    /// The first bytes of messages: SQLite reads the first page of each.
    pub(crate) fn heads(&self, places: &[Place], most: usize) -> Result<Vec<Vec<u8>>, Fault> {
        let connection = self.connection()?;
        let heads = places
            .iter()
            .map(|place| self.bytes(&connection, Self::row(*place), most as u64))
            .collect::<Result<_, _>>()?;
        self.give_back(connection);
        Ok(heads)
    }
}

/// What a recorder that was killed has not yet written into the database: what only it can, for that means to write.
fn unwritten(path: &Path) -> Option<Warning> {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let log = PathBuf::from(log);
    let is_there = std::fs::metadata(&log).is_ok_and(|log| log.len() > 0);
    is_there.then(|| {
        let name = name_of(path);
        let text = format!(
            "{name}-wal holds messages that were not written into the database, and are not read: `sqlite3 {name} 'PRAGMA wal_checkpoint(TRUNCATE)'` \
             writes them"
        );
        Warning { text, is_loss: true }
    })
}

/// The file as SQLite's URI: read-only and immutable, so that SQLite looks for no other file.
fn uri(path: &Path) -> Result<String, Fault> {
    let name = |path: &Path| path.to_str().map(str::to_owned);
    let absolute = std::path::absolute(path).ok().and_then(|path| name(&path));
    let absolute =
        absolute.ok_or_else(|| Fault::new(format!("{}: its name is not UTF-8", path.display())).remedy("rename it"))?;
    let mut uri = String::from("file://");
    if !absolute.starts_with('/') {
        uri.push('/');
    }
    for byte in absolute.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'_' | b'-' | b':' => uri.push(char::from(byte)),
            b'\\' if cfg!(windows) => uri.push('/'),
            _ => uri.push_str(&format!("%{byte:02x}")),
        }
    }
    uri.push_str("?immutable=1");
    Ok(uri)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn a_path_is_a_uri_whatever_it_is_called() {
        let uri = super::uri(Path::new("/data/my bag?#%.db3")).unwrap();
        assert_eq!(uri, "file:///data/my%20bag%3f%23%25.db3?immutable=1");
    }
}
