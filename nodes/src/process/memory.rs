//! Large rows cross to a process in files in memory (`memfd`) instead of pipes, which copy each byte twice.
//!
//! The files have no name, a fixed size, and seals against shrinking. They are written and read here, never mapped: a
//! process that writes while one is read causes a wrong value, nothing worse. `nodes/examples/process_call.rs` measures
//! it.

use std::fs::File;
use std::hash::{BuildHasher, RandomState};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::fd::AsRawFd;

use depthloom_codecs::arrow::{Batch, Encoded, Schema, StreamReader};

use super::protocol::Place;

/// Rows from this size on are stored in shared memory, bytes: the capacity of a pipe.
const LARGE: u64 = 64 << 10;
const MOST: u64 = 1 << 30;
/// File sizes are multiples of this.
const STEP: u64 = 1 << 20;
/// Largest number of files for calls; a process may hold all except one.
const FILES: usize = 4;

struct Memory {
    file: File,
    number: i64,
    size: u64,
}

impl Memory {
    #[cfg(target_os = "linux")]
    fn new(number: i64, size: u64) -> io::Result<Self> {
        use rustix::fs::{FallocateFlags, MemfdFlags, SealFlags, fallocate, fcntl_add_seals, memfd_create};
        let file = memfd_create("depthloom-process", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)?;
        fallocate(&file, FallocateFlags::empty(), 0, size)?;
        fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        Ok(Self { file: file.into(), number, size })
    }

    #[cfg(not(target_os = "linux"))]
    fn new(_: i64, _: u64) -> io::Result<Self> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Where a process on the same system opens it.
    fn path(&self) -> String {
        format!("/proc/{}/fd/{}", std::process::id(), self.file.as_raw_fd())
    }

    fn place(&self, bytes: u64) -> Place {
        Place { file: self.number, path: self.path(), size: self.size as i64, bytes: bytes as i64 }
    }
}

pub(super) struct Shared {
    /// A word by which a process proves that it opened this very file; removed after its first reply.
    probe: Option<(Memory, String)>,
    is_agreed: bool,
    /// Whether the process still holds the call in the file.
    calls: Vec<(Memory, bool)>,
    answers: Option<Memory>,
    /// Bytes of the largest reply that did not fit.
    wanted: u64,
    last: i64,
    /// Largest file size that the system allows.
    most: u64,
}

impl Shared {
    pub(super) fn new() -> Self {
        let most = limit().min(MOST);
        let word = format!(
            "{:032x}",
            u128::from(RandomState::new().hash_one(0)) << 64 | u128::from(RandomState::new().hash_one(1))
        );
        let probe = (most >= STEP).then(|| Memory::new(0, word.len() as u64));
        let probe = probe.and_then(Result::ok).filter(|of| (&of.file).write_all(word.as_bytes()).is_ok());
        let probe = probe.map(|file| (file, word));
        Self { probe, is_agreed: false, calls: Vec::new(), answers: None, wanted: 0, last: 0, most }
    }

    pub(super) fn offer(&self) -> Option<String> {
        self.probe.as_ref().map(|(file, _)| file.path())
    }

    /// Another word means that the process opened another file under this path, as in a container with its own process
    /// numbers: then all rows cross the pipe.
    pub(super) fn finish_handshake(&mut self, found: Option<&str>) {
        let probe = self.probe.take();
        self.is_agreed = probe.zip(found).is_some_and(|((_, word), found)| word == found);
    }

    /// `None`: the call crosses the pipe.
    pub(super) fn store_call(&mut self, call: &Encoded<'_>) -> Option<Place> {
        let bytes = call.bytes() as u64;
        if !self.is_agreed || !(LARGE..=self.most).contains(&bytes) {
            return None;
        }
        let is_free = |(memory, is_held): &(Memory, bool)| !is_held && memory.size >= bytes;
        let at = match self.calls.iter().position(is_free) {
            Some(at) => at,
            None => {
                // Files that are too small are dropped; files in use are not touched.
                self.calls.retain(|(_, is_held)| *is_held);
                if self.calls.len() >= FILES {
                    return None;
                }
                let memory = self.make(bytes)?;
                self.calls.push((memory, false));
                self.calls.len() - 1
            }
        };
        let (memory, _) = &self.calls[at];
        let mut file = &memory.file;
        file.seek(SeekFrom::Start(0)).and_then(|_| call.write(&mut file)).ok()?;
        Some(memory.place(bytes))
    }

    pub(super) fn reply_place(&mut self) -> Option<Place> {
        if self.is_agreed && self.wanted > self.answers.as_ref().map_or(0, |memory| memory.size) {
            self.answers = None;
            self.answers = self.make(self.wanted);
            if self.answers.is_none() {
                self.wanted = 0;
            }
        }
        self.answers.as_ref().map(|memory| memory.place(0))
    }

    fn make(&mut self, bytes: u64) -> Option<Memory> {
        let size = bytes.checked_next_multiple_of(STEP).filter(|size| *size <= self.most)?;
        self.last += 1;
        Memory::new(self.last, size).ok()
    }

    /// The row that came through the pipe, or the one in shared memory that it refers to.
    pub(super) fn resolve(&mut self, schema: &Schema, batch: Batch) -> Result<Batch, String> {
        let numbers = batch.column(schema, "held").map_or(Ok(Vec::new()), |numbers| numbers.i64s())?;
        self.holds(&numbers)?;
        if batch.column(schema, "says").map(|says| says.text()).transpose()? != Some("shared") {
            let bytes = batch.bytes() as u64;
            if self.is_agreed && (LARGE..=self.most).contains(&bytes) {
                // A row has a little more than its values.
                self.wanted = self.wanted.max(bytes + LARGE);
            }
            return Ok(batch);
        }
        let number = |batch: &Batch, name: &str| batch.column(schema, name).map_or(Ok(0), |column| column.int());
        let row = self.answer(schema, number(&batch, "bytes")?)?;
        let (here, there) = (number(&batch, "number")?, number(&row, "number")?);
        if here != there {
            return Err(format!("it replies to call {here}, but the row in shared memory replies to call {there}"));
        }
        Ok(row)
    }

    fn holds(&mut self, numbers: &[i64]) -> Result<(), String> {
        let strange = numbers.iter().find(|number| self.calls.iter().all(|(memory, _)| memory.number != **number));
        if let Some(strange) = strange {
            return Err(format!("it holds file {strange} of shared memory, which holds no call"));
        }
        self.calls.iter_mut().for_each(|(memory, is_held)| *is_held = numbers.contains(&memory.number));
        Ok(())
    }

    fn answer(&self, schema: &Schema, bytes: i64) -> Result<Batch, String> {
        let Some(memory) = &self.answers else {
            return Err("its reply refers to shared memory, but it was given none".to_owned());
        };
        let Some(bytes) = u64::try_from(bytes).ok().filter(|bytes| *bytes <= memory.size) else {
            return Err(format!("it states a row of {bytes} bytes of shared memory, which has {}", memory.size));
        };
        let wrong = |what: &dyn std::fmt::Display| format!("the row in shared memory is not of the protocol: {what}");
        let mut file = &memory.file;
        file.seek(SeekFrom::Start(0)).map_err(|error| wrong(&error))?;
        let row = StreamReader::new(file.take(bytes)).batch(schema).map_err(|error| wrong(&error))?;
        row.ok_or_else(|| wrong(&"there is no row"))
    }
}

/// Bytes. A larger write would end this process with a signal.
fn limit() -> u64 {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let line = limits.lines().find_map(|line| line.strip_prefix("Max file size"));
    let soft = line.and_then(|line| line.split_whitespace().next());
    soft.map_or(0, |soft| if soft == "unlimited" { u64::MAX } else { soft.parse().unwrap_or(0) })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use depthloom_codecs::arrow::{Data, DataType, Field, Items, Offsets, Schema, encode};

    use super::{FILES, Shared};

    #[test]
    fn a_file_is_reused_after_the_last_reader_released_it() {
        let list = DataType::List(Offsets::Narrow, Box::new(Field::new("item", DataType::Int(8, false))));
        let schema = Schema { fields: vec![Field::new("data", list)], metadata: Vec::new() };
        let store = |shared: &mut Shared, bytes: usize| {
            let bytes = vec![7; bytes];
            let place = shared.store_call(&encode(&schema, vec![Data::List(Items::U8(&bytes))]));
            place.map(|place| {
                assert!(std::fs::metadata(&place.path).expect("it is there").len() == place.size as u64);
                place.file
            })
        };
        let mut shared = Shared::new();
        let word = std::fs::read_to_string(shared.offer().expect("a Linux has such files")).expect("a word");
        assert_eq!(store(&mut shared, 100_000), None, "nothing is agreed");
        shared.finish_handshake(Some(&word));
        assert_eq!(store(&mut shared, 1000), None, "it is small");
        assert_eq!((store(&mut shared, 100_000), store(&mut shared, 200_000)), (Some(1), Some(1)));
        assert_eq!(store(&mut shared, 2_000_000), Some(2), "it is too large for the first");
        shared.holds(&[2]).expect("a call is stored there");
        shared.holds(&[1]).expect_err("that file is gone");
        let others: Vec<i64> = (3..2 + FILES as i64).collect();
        for (at, file) in others.iter().enumerate() {
            assert_eq!(store(&mut shared, 100_000), Some(*file));
            let numbers: Vec<i64> = [2].into_iter().chain(others[..=at].iter().copied()).collect();
            shared.holds(&numbers).expect("calls are stored there");
        }
        assert_eq!(store(&mut shared, 100_000), None, "all are held");
        shared.holds(&[3]).expect("a call is stored there");
        assert_eq!(store(&mut shared, 1_500_000), Some(2));
        assert!(shared.reply_place().is_none(), "no large answer came");
    }

    #[test]
    fn without_the_right_word_in_shared_memory_all_rows_use_the_pipe() {
        let list = DataType::List(Offsets::Narrow, Box::new(Field::new("item", DataType::Int(8, false))));
        let schema = Schema { fields: vec![Field::new("data", list)], metadata: Vec::new() };
        let bytes = vec![7; 100_000];
        for found in [Some("f".repeat(32)), Some("not a word".to_owned()), Some(String::new()), None] {
            let mut shared = Shared::new();
            shared.finish_handshake(found.as_deref());
            assert!(shared.store_call(&encode(&schema, vec![Data::List(Items::U8(&bytes))])).is_none(), "{found:?}");
            assert!(shared.reply_place().is_none(), "{found:?}");
        }
    }
}
