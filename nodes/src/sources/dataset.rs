//! A data set on disk as a source: frames, each made of files that play a part. What the files say is the data set's own affair.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{Frame, InlineHost, Recognised, Survey};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::values::{Image, Raster};
use depthloom_graphs::{Context, Fault, Key, Outputs, Scratch, Source, SourceOutputs};

use serde_json::Value as Json;

use crate::sources::asked::Asked;
use crate::sources::files::{float_file, image_file};

/// The role of a file in a frame: `left`, `calibration`. It enters the frame's key.
pub(super) type Part = &'static str;

pub(super) const LEFT: Part = "left";
pub(super) const RIGHT: Part = "right";
pub(super) const CALIBRATION: Part = "calibration";
pub(super) const TRUTH: Part = "truth";

pub(super) trait Layout: Send + Sync + 'static {
    const KIND: (&'static str, u32);

    /// Parameters that decide values besides the files.
    fn meaning(&self) -> String {
        String::new()
    }

    fn key(&self, files: &Files) -> Key {
        files.key(Self::KIND, &self.meaning())
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;
}

#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub frame: Frame,
    pub files: Vec<(Part, PathBuf)>,
}

#[derive(Debug, Default)]
pub(super) struct Gathered {
    files: Vec<(Part, PathBuf)>,
    faults: Vec<Fault>,
}

impl Gathered {
    pub(super) fn take(&mut self, part: Part, file: Result<PathBuf, Fault>) {
        match file {
            Ok(path) => self.files.push((part, path)),
            Err(fault) => self.faults.push(fault),
        }
    }
}

#[derive(Debug, Default)]
pub(super) struct Listing {
    /// The frames that were asked for and have all their files.
    pub entries: Vec<Entry>,
    pub faults: Vec<Fault>,
    pub warnings: Vec<String>,
    /// Files without a partner: `run` leaves them out and warns, `data check` reports them.
    pub alone: Vec<String>,
    pub(crate) incomplete: Vec<Vec<(Part, PathBuf)>>,
    /// Faults beyond the first of their frame.
    pub(crate) also: usize,
}

impl Listing {
    pub(super) fn gather(&mut self, frame: Frame, of: Gathered) {
        if of.faults.is_empty() {
            self.entries.push(Entry { frame, files: of.files });
            return;
        }
        self.also += of.faults.len() - 1;
        self.faults.extend(of.faults);
        self.incomplete.push(of.files);
    }

    pub(super) fn push(&mut self, entry: Result<Entry, Fault>) {
        match entry {
            Ok(entry) => self.entries.push(entry),
            Err(fault) => self.faults.push(fault),
        }
    }

    pub(super) fn open<L: Layout>(mut self, layout: L) -> Result<Box<dyn Source>, Fault> {
        if self.faults.is_empty() {
            self.warnings.append(&mut self.alone);
            let source = Dataset::new(self, layout);
            source.check_calibration()?;
            return Ok(Box::new(source));
        }
        let more = self.faults.len() - 1 - self.also;
        Err(self.faults.swap_remove(0).map_what(|what| match more {
            0 => what,
            1 => format!("{what}; 1 more frame lacks files"),
            more => format!("{what}; {more} more frames lack files"),
        }))
    }
}

pub(super) fn survey<L: Layout>(listed: Result<(Listing, L), Fault>) -> Survey {
    match listed {
        Ok((mut listing, layout)) => {
            let mut faults = std::mem::take(&mut listing.faults);
            let alone = std::mem::take(&mut listing.alone).into_iter();
            faults.extend(alone.map(|what| Fault::new(what).remedy("add the missing file, or remove the other")));
            // What there is of a frame that lacks a file may be broken as well.
            faults.extend(listing.incomplete.iter().flat_map(|files| unreadable(files)));
            Survey { source: Some(Box::new(Dataset::new(listing, layout))), faults, facts: Vec::new() }
        }
        Err(fault) => Survey::failed(fault),
    }
}

fn unreadable(files: &[(Part, PathBuf)]) -> Vec<Fault> {
    let images = files.iter().filter(|(part, _)| matches!(*part, LEFT | RIGHT));
    let decoded = images.map(|(_, path)| image_file::read(path).and_then(|bytes| image_file::image(path, bytes)));
    decoded.filter_map(Result::err).collect()
}

pub(super) fn recognised(listed: Result<Listing, Fault>, what: &str, params: Json) -> Vec<Recognised> {
    let is_one = listed.is_ok_and(|listing| !listing.entries.is_empty() || !listing.faults.is_empty());
    is_one.then(|| Recognised::new(what, params)).into_iter().collect()
}

struct Dataset<L> {
    layout: L,
    frames: Vec<Frame>,
    files: Vec<Vec<(Part, PathBuf)>>,
    warnings: Vec<String>,
    /// A run requests a frame's key and then reads it: its files are read and hashed once.
    asked: Asked<(Files, Key)>,
}

impl<L: Layout> Dataset<L> {
    fn new(listing: Listing, layout: L) -> Self {
        let (frames, files) = listing.entries.into_iter().map(|entry| (entry.frame, entry.files)).unzip();
        Self { layout, frames, files, warnings: listing.warnings, asked: Asked::default() }
    }

    /// A broken calibration that all frames share is reported before the first frame.
    fn check_calibration(&self) -> Result<(), Fault> {
        let calibrations = |files: &[(Part, PathBuf)]| -> Vec<PathBuf> {
            let of_cameras = files.iter().filter(|(part, _)| part.starts_with(CALIBRATION));
            of_cameras.map(|(_, path)| path.clone()).collect()
        };
        let Some(shared) = self.files.first().map(|files| calibrations(files)) else { return Ok(()) };
        let is_shared = self.files.iter().all(|files| calibrations(files) == shared);
        // A file that cannot be read fails with its frame.
        let Some((files, _)) = self.files(FrameIndex(0)).ok().filter(|_| is_shared && !shared.is_empty()) else {
            return Ok(());
        };
        let mut scratch = Scratch::default();
        match self.layout.values(&files, &mut Context::new(&InlineHost, &mut scratch)) {
            Err(fault) => {
                let chain = fault.chain();
                let is_of_calibration = shared.iter().any(|path| chain.contains(&path.display().to_string()));
                if is_of_calibration { Err(fault) } else { Ok(()) }
            }
            Ok(_) => Ok(()),
        }
    }

    fn files(&self, position: FrameIndex) -> Result<(Files, Key), Fault> {
        let read =
            |(part, path): &(Part, PathBuf)| Ok(File { part, path: path.clone(), bytes: image_file::read(path)? });
        let files = Files(self.files[position].iter().map(read).collect::<Result<_, Fault>>()?);
        let key = self.layout.key(&files);
        Ok((files, key))
    }
}

impl<L: Layout> Source for Dataset<L> {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let (files, key) = self.files(position)?;
        self.asked.keep(position, (files, key));
        Ok(key)
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let (files, key) = self.asked.take(position).map_or_else(|| self.files(position), Ok)?;
        Ok(SourceOutputs { outputs: self.layout.values(&files, ctx)?, key })
    }

    fn files(&self, position: FrameIndex) -> Vec<(&'static str, PathBuf)> {
        self.files[position].clone()
    }

    fn examine(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Vec<Fault>> {
        let first = match self.read(position, ctx) {
            Ok(read) => return Ok(read),
            Err(fault) => fault,
        };
        let mut faults = Vec::new();
        let mut files = Vec::new();
        for (part, path) in &self.files[position] {
            match image_file::read(path) {
                Ok(bytes) => files.push(File { part, path: path.clone(), bytes }),
                Err(fault) => faults.push(fault),
            }
        }
        faults.extend(self.faults_by_part(&files, ctx));
        if faults.iter().all(|fault| fault.chain() != first.chain()) {
            faults.push(first);
        }
        let mut told = BTreeSet::new();
        faults.retain(|fault| told.insert(fault.chain()));
        Err(faults)
    }
}

impl<L: Layout> Dataset<L> {
    /// Checks each file with valid images, because broken images or images of different sizes would hide its faults.
    fn faults_by_part(&self, files: &[File], ctx: &mut Context<'_>) -> Vec<Fault> {
        let mut faults = Vec::new();
        let mut good = None;
        for file in files.iter().filter(|file| matches!(file.part, LEFT | RIGHT)) {
            match image_file::image(&file.path, Arc::clone(&file.bytes)) {
                Ok(_) => good = good.or_else(|| Some(Arc::clone(&file.bytes))),
                Err(fault) => faults.push(fault),
            }
        }
        let Some(good) = good else { return faults };
        let is_shared = |part: Part| matches!(part, LEFT | RIGHT) || part.starts_with(CALIBRATION);
        let mut others: Vec<Option<Part>> =
            files.iter().map(|file| file.part).filter(|part| !is_shared(part)).map(Some).collect();
        others.insert(0, None);
        for other in others {
            let beside =
                files.iter().filter(|file| is_shared(file.part) || Some(file.part) == other).map(|file| File {
                    part: file.part,
                    path: file.path.clone(),
                    bytes: if matches!(file.part, LEFT | RIGHT) { Arc::clone(&good) } else { Arc::clone(&file.bytes) },
                });
            let beside = Files(beside.collect());
            // A part that a frame never lacks is left out here on purpose.
            faults.extend(self.layout.values(&beside, ctx).err().filter(|fault| !fault.chain().contains(LACKS)));
        }
        faults
    }
}

const LACKS: &str = "the frame has no file of its part";

#[derive(Debug)]
pub(super) struct File {
    part: Part,
    pub path: PathBuf,
    pub bytes: Arc<[u8]>,
}

impl File {
    pub(super) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    pub(super) fn fault(&self, what: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{}: {what}", self.path.display()))
    }
}

#[derive(Debug)]
pub(super) struct Files(Vec<File>);

impl Files {
    pub(super) fn key(&self, (kind, version): (&str, u32), meaning: &str) -> Key {
        let key = Key::build(kind).number(version.into()).text(meaning);
        self.0.iter().fold(key, |key, file| key.text(file.part).bytes(&file.bytes)).finish()
    }

    pub(super) fn get(&self, part: Part) -> Option<&File> {
        self.0.iter().find(|file| file.part == part)
    }

    pub(super) fn the(&self, part: Part) -> Result<&File, Fault> {
        self.get(part).ok_or_else(|| Fault::new(format!("{LACKS} `{part}`")))
    }

    pub(super) fn pair(&self, ctx: &Context<'_>) -> Result<(Image, Image), Fault> {
        self.pair_of_bits(None, ctx)
    }

    /// 16-bit samples use the lowest `bits`.
    pub(super) fn pair_of_bits(&self, bits: Option<u32>, ctx: &Context<'_>) -> Result<(Image, Image), Fault> {
        let image = |file: &File| {
            let (image, brightest) = image_file::image_of_bits(&file.path, Arc::clone(&file.bytes), bits)?;
            if let Some(warning) = brightest.and_then(|brightest| brightest.warning(bits)) {
                ctx.host.warn(warning);
            }
            Ok::<_, Fault>(image)
        };
        let left = image(self.the(LEFT)?)?;
        let right = self.the(RIGHT)?;
        let other = image(right)?;
        self.same_size_as_left(left.dimensions(), right, other.dimensions())?;
        Ok((left, other))
    }

    /// `unit` is `disparity` (px) or `metres`, times 256. `None` if the frame has no such file.
    pub(super) fn map_u16(&self, part: Part, unit: &str, left: (u32, u32)) -> Result<Option<Raster<u16>>, Fault> {
        let Some(file) = self.get(part) else { return Ok(None) };
        let map = image_file::map_u16(&file.path, &file.bytes, unit)?;
        self.same_size_as_left(left, file, map.dimensions())?;
        Ok(Some(map))
    }

    pub(super) fn map_f32(&self, part: Part, left: (u32, u32)) -> Result<Option<Raster<f32>>, Fault> {
        let Some(file) = self.get(part) else { return Ok(None) };
        let map = float_file::map_f32(&file.path, &file.bytes)?;
        self.same_size_as_left(left, file, map.dimensions())?;
        Ok(Some(map))
    }

    /// `what` describes the expected map in messages.
    pub(super) fn map_u8(&self, part: Part, what: &str, left: (u32, u32)) -> Result<Option<Raster<u8>>, Fault> {
        let Some(file) = self.get(part) else { return Ok(None) };
        let map = image_file::map_u8(&file.path, &file.bytes, what)?;
        self.same_size_as_left(left, file, map.dimensions())?;
        Ok(Some(map))
    }

    pub(super) fn same_size_as_left(&self, left: (u32, u32), file: &File, (w, h): (u32, u32)) -> Result<(), Fault> {
        if left == (w, h) {
            return Ok(());
        }
        let of_left = self.the(LEFT)?.path.display();
        let what = format!(
            "{} is {w}x{h}, and {of_left} is {}x{}: they must be of one size",
            file.path.display(),
            left.0,
            left.1
        );
        Err(Fault::new(what).remedy("the files of a frame belong together: make or unpack the frame's again"))
    }
}

/// By stem, sorted. Of two files with one stem the earlier ending wins. `layout` is the remedy for a missing folder.
pub(super) fn stems(folder: &Path, endings: &[&str], layout: &str) -> Result<BTreeMap<String, PathBuf>, Fault> {
    let failed = |error| Fault::new(format!("failed to list {}", folder.display())).because(error);
    let listing = std::fs::read_dir(folder).map_err(|error| match error.kind() {
        ErrorKind::NotFound => no_folder(folder, layout),
        _ => failed(error),
    })?;
    let mut found: BTreeMap<String, (usize, PathBuf)> = BTreeMap::new();
    for entry in listing {
        let path = entry.map_err(failed)?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()).filter(|name| !name.starts_with('.')) else {
            continue;
        };
        let Some((stem, ending)) = name.rsplit_once('.') else { continue };
        let Some(rank) = endings.iter().position(|known| ending.eq_ignore_ascii_case(known)) else { continue };
        let is_better = found.get(stem).is_none_or(|(other, _)| rank < *other);
        if is_better {
            found.insert(stem.to_owned(), (rank, path.clone()));
        }
    }
    Ok(found.into_iter().map(|(stem, (_, path))| (stem, path)).collect())
}

/// `None` unless all names are rising numbers of at most 32 bits; time stamps have more.
pub(super) fn numbered<'a>(stems: impl Iterator<Item = &'a str>) -> Option<Vec<u64>> {
    let numbers: Vec<u64> = stems.map(|stem| stem.parse::<u32>().ok().map(u64::from)).collect::<Option<_>>()?;
    numbers.is_sorted_by(|a, b| a < b).then_some(numbers)
}

pub(super) fn folders(folder: &Path, layout: &str) -> Result<Vec<String>, Fault> {
    let failed = |error| Fault::new(format!("failed to list {}", folder.display())).because(error);
    let listing = std::fs::read_dir(folder).map_err(|error| match error.kind() {
        ErrorKind::NotFound => no_folder(folder, layout),
        _ => failed(error),
    })?;
    let mut names = Vec::new();
    for entry in listing {
        let path = entry.map_err(failed)?.path();
        if let (true, Some(name)) = (path.is_dir(), path.file_name().and_then(|name| name.to_str())) {
            names.push(name.to_owned());
        }
    }
    names.sort_unstable();
    Ok(names)
}

pub(super) fn no_folder(folder: &Path, remedy: &str) -> Fault {
    Fault::new(format!("there is no folder {}", folder.display())).remedy(remedy)
}

pub(super) fn no_file(path: &Path, remedy: &str) -> Fault {
    Fault::new(format!("there is no file {}", path.display())).remedy(remedy)
}

pub(super) fn at_file(path: &Path, fault: Fault) -> Fault {
    fault.map_what(|what| format!("{}: {what}", path.display()))
}
