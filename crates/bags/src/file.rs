//! A bag's file, read by position from several threads at once.

use std::fs::File;
use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, regular_file};

/// What to do about a file that is not as it was written.
pub const COPY_AGAIN: &str =
    "copy the bag again, or see what `ros2 bag reindex` (of a folder) or `mcap recover` (of a file) makes of it";

/// A file open for reading.
pub struct PositionedFile {
    pub path: PathBuf,
    pub size: u64,
    file: File,
}

impl PositionedFile {
    pub fn open(path: &Path) -> Result<Self, Fault> {
        let failed = |error| Fault::new(format!("failed to open {}", path.display())).because(error);
        let file = regular_file::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        Ok(Self { path: path.to_owned(), size, file })
    }

    /// Its name, for what is recorded: where it lies differs between machines.
    pub fn name(&self) -> std::path::Display<'_> {
        name_of(&self.path)
    }

    /// Fills the buffer with the bytes at a position.
    pub fn read_exact(&self, buffer: &mut [u8], offset: u64) -> Result<(), Fault> {
        let read = regular_file::read_exact_at(&self.file, buffer, offset);
        read.map_err(|error| {
            Fault::new(format!("failed to read {} at byte {offset}", self.path.display())).because(error)
        })
    }

    /// The bytes of a range of at most `most`, which is held against the file before anything is allocated.
    pub fn range(&self, offset: u64, length: u64, most: u64) -> Result<Vec<u8>, Fault> {
        if offset.checked_add(length).is_none_or(|end| end > self.size) {
            let what = format!("{length} bytes are said to follow, and the file has {}", self.size);
            return Err(self.damaged(offset, what));
        }
        if length > most {
            let (long, most) = (length.div_ceil(1 << 20), most >> 20);
            return Err(self.damaged(
                offset,
                format!("{long} MiB are said to be one piece, more than the {most} MiB that are read of it"),
            ));
        }
        let mut bytes = vec![0; usize::try_from(length).expect("no more than the limit")];
        self.read_exact(&mut bytes, offset)?;
        Ok(bytes)
    }

    /// That what lies at a position is not what should be there.
    pub fn damaged(&self, offset: u64, what: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{} is damaged at byte {offset}: {what}", self.path.display())).remedy(COPY_AGAIN)
    }
}

/// The last part of a path.
pub fn name_of(path: &Path) -> std::path::Display<'_> {
    path.file_name().map_or_else(|| path.display(), |name| Path::new(name).display())
}
