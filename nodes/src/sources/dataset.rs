//! Data sets on disk as sources: each frame consists of files.

pub(super) mod folders;
pub(super) mod frame_files;

use std::collections::BTreeSet;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::contracts::{
    DataPath, Frame, FrameSelection, Recognised, SourceDeclaration, Survey, SwitchedOff,
};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Context, Fault, Key, Outputs, Port, Source, SourceKind, SourceOutputs, ValueType};
use depthloom_graphs::{Scratch, contracts::InlineHost};
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use crate::sources::files::image_file;
use crate::sources::read_ahead::ReadAhead;
use frame_files::{CALIBRATION, File, Files, LACKS, LEFT, Part, RIGHT};

/// A kind of data set on disk; [`OnDisk`] makes it a source kind.
pub(crate) trait DatasetKind: Sized + Send + Sync + 'static {
    type Params: Serialize + DeserializeOwned + JsonSchema;

    const KIND: (&'static str, u32);

    fn declaration() -> SourceDeclaration;

    fn check(params: &Self::Params) -> Result<(), (&'static str, String)>;

    fn outputs(_params: &Self::Params) -> Result<Vec<Port>, Fault> {
        Ok(Self::declaration().outputs)
    }

    /// See [`SourceKind::switched_off`].
    fn switched_off(_params: &Self::Params) -> Vec<SwitchedOff> {
        Vec::new()
    }

    fn list(params: &Self::Params) -> Result<(Listing, Self), Fault>;

    fn survey(params: &Self::Params) -> Survey {
        match Self::list(params) {
            Ok((listing, kind)) => listing.survey(kind),
            Err(fault) => Survey::failed(fault),
        }
    }

    fn recognise(root: &Path) -> Vec<Recognised>;

    /// Parameters that decide values besides the files.
    fn meaning(&self) -> String {
        String::new()
    }

    fn key(&self, files: &Files) -> Key {
        files.key(Self::KIND, &self.meaning())
    }

    fn values(&self, files: &Files, ctx: &mut Context<'_>) -> Result<Outputs, Fault>;
}

/// The source kind of a kind of data set.
pub(crate) struct OnDisk<K>(PhantomData<fn() -> K>);

impl<K: DatasetKind> SourceKind for OnDisk<K> {
    type Params = K::Params;

    fn declaration() -> SourceDeclaration {
        K::declaration()
    }

    fn check(params: &K::Params) -> Result<(), (&'static str, String)> {
        K::check(params)
    }

    fn outputs(params: &K::Params) -> Result<Vec<Port>, Fault> {
        K::outputs(params)
    }

    fn switched_off(params: &K::Params) -> Vec<SwitchedOff> {
        K::switched_off(params)
    }

    fn open(params: K::Params) -> Result<Box<dyn Source>, Fault> {
        let (listing, kind) = K::list(&params)?;
        listing.open(kind)
    }

    fn survey(params: K::Params) -> Survey {
        K::survey(&params)
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        K::recognise(root)
    }
}

/// Checks that a path parameter is given.
pub(super) fn required(name: &'static str, path: &DataPath, layout: &str) -> Result<(), (&'static str, String)> {
    match path.path().as_os_str().is_empty() {
        true => Err((name, format!("{name} is missing: {layout}"))),
        false => Ok(()),
    }
}

/// Outputs that `ground_truth: none` switches off, and another value switches on.
pub(super) fn truth_off(is_none: bool, then: &str, outputs: &[&'static str]) -> Vec<SwitchedOff> {
    if is_none { SwitchedOff::by("ground_truth", "none", then, outputs) } else { Vec::new() }
}

pub(super) const fn image_port(name: &'static str, doc: &'static str) -> Port {
    Port::frame(name, ValueType::Image, doc)
}

pub(super) const fn calibration_port() -> Port {
    Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline.")
}

pub(super) const fn depth_port(doc: &'static str) -> Port {
    Port::frame("depth", ValueType::Depth, doc)
}

/// The files of a frame that exist, and the faults of those that do not.
#[derive(Debug, Default)]
pub(crate) struct FrameFiles {
    files: Vec<(Part, PathBuf)>,
    faults: Vec<Fault>,
}

impl FrameFiles {
    pub(super) fn add(&mut self, part: Part, file: Result<PathBuf, Fault>) {
        match file {
            Ok(path) => self.files.push((part, path)),
            Err(fault) => self.faults.push(fault),
        }
    }
}

impl From<Result<Vec<(Part, PathBuf)>, Fault>> for FrameFiles {
    fn from(files: Result<Vec<(Part, PathBuf)>, Fault>) -> Self {
        match files {
            Ok(files) => Self { files, faults: Vec::new() },
            Err(fault) => Self { files: Vec::new(), faults: vec![fault] },
        }
    }
}

/// The selected frames of a data set.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    /// Frames that have all their files.
    frames: Vec<(Frame, Vec<(Part, PathBuf)>)>,
    pub faults: Vec<Fault>,
    pub warnings: Vec<String>,
    /// Files without a partner: `run` leaves them out and warns, `check --data` reports them.
    pub unpaired: Vec<String>,
    incomplete: Vec<Vec<(Part, PathBuf)>>,
    /// Faults beyond the first of their frame.
    extra_faults: usize,
}

impl Listing {
    pub(super) fn add(&mut self, frame: Frame, files: impl Into<FrameFiles>) {
        let FrameFiles { files, faults } = files.into();
        if faults.is_empty() {
            self.frames.push((frame, files));
            return;
        }
        self.extra_faults += faults.len() - 1;
        self.faults.extend(faults);
        self.incomplete.push(files);
    }

    /// Adds the selected frames of `known`, at 10 Hz; `files` returns the files of the frame at a position.
    pub(super) fn add_selected<F: Into<FrameFiles>>(
        &mut self,
        selection: &FrameSelection,
        known: &[(u64, &str)],
        mut files: impl FnMut(usize) -> F,
    ) -> Result<(), Fault> {
        for at in selection.select(known)? {
            let (index, id) = known[at];
            self.add(Frame::at_10_hz(id, index), files(at));
        }
        self.warnings.extend(selection.left_out(known));
        Ok(())
    }

    /// Number of frames that have all their files.
    pub(super) const fn len(&self) -> usize {
        self.frames.len()
    }

    /// Ids of the frames whose files match.
    pub(super) fn ids_where(&self, matches: impl Fn(&[(Part, PathBuf)]) -> bool) -> Vec<&str> {
        self.frames.iter().filter(|(_, files)| matches(files)).map(|(frame, _)| &*frame.id).collect()
    }

    fn open<K: DatasetKind>(mut self, kind: K) -> Result<Box<dyn Source>, Fault> {
        if self.faults.is_empty() {
            self.warnings.append(&mut self.unpaired);
            let source = Dataset::new(self, kind);
            source.check_calibration()?;
            return Ok(Box::new(source));
        }
        let more = self.faults.len() - 1 - self.extra_faults;
        Err(self.faults.swap_remove(0).map_what(|what| match more {
            0 => what,
            1 => format!("{what}; 1 more frame lacks files"),
            more => format!("{what}; {more} more frames lack files"),
        }))
    }

    pub(crate) fn survey<K: DatasetKind>(mut self, kind: K) -> Survey {
        let mut faults = std::mem::take(&mut self.faults);
        let unpaired = std::mem::take(&mut self.unpaired).into_iter();
        faults.extend(unpaired.map(|what| Fault::new(what).remedy("add the missing file, or remove the other")));
        // The images of a frame that lacks a file may be broken as well.
        for (part, path) in self.incomplete.iter().flatten() {
            if is_image(part) {
                faults.extend(image_file::read(path).and_then(|bytes| image_file::image(path, bytes)).err());
            }
        }
        Survey { source: Some(Box::new(Dataset::new(self, kind))), faults, facts: Vec::new() }
    }
}

/// Recognises a folder that has frames, or faults of frames.
pub(super) fn recognised<K: DatasetKind>(params: &K::Params, what: &str, root: &Path) -> Vec<Recognised> {
    let is_one = K::list(params).is_ok_and(|(listing, _)| listing.len() + listing.faults.len() > 0);
    is_one.then(|| Recognised::new(what, json!({ "root": root }))).into_iter().collect()
}

fn is_image(part: Part) -> bool {
    matches!(part, LEFT | RIGHT)
}

struct Dataset<K> {
    kind: K,
    frames: Vec<Frame>,
    files: Vec<Vec<(Part, PathBuf)>>,
    warnings: Vec<String>,
    /// A run requests a frame's key and then reads it: its files are read and hashed once.
    read_ahead: ReadAhead<(Files, Key)>,
}

impl<K: DatasetKind> Dataset<K> {
    fn new(listing: Listing, kind: K) -> Self {
        let (frames, files) = listing.frames.into_iter().unzip();
        Self { kind, frames, files, warnings: listing.warnings, read_ahead: ReadAhead::default() }
    }

    /// A broken calibration that all frames share is reported before the first frame.
    fn check_calibration(&self) -> Result<(), Fault> {
        let calibrations = |files: &[(Part, PathBuf)]| -> Vec<PathBuf> {
            files.iter().filter(|(part, _)| part.starts_with(CALIBRATION)).map(|(_, path)| path.clone()).collect()
        };
        let Some(shared) = self.files.first().map(|files| calibrations(files)) else { return Ok(()) };
        let is_shared = self.files.iter().all(|files| calibrations(files) == shared);
        // A file that cannot be read fails with its frame.
        let Some((files, _)) = self.read_files(FrameIndex(0)).ok().filter(|_| is_shared && !shared.is_empty()) else {
            return Ok(());
        };
        let mut scratch = Scratch::default();
        let Err(fault) = self.kind.values(&files, &mut Context::new(&InlineHost, &mut scratch)) else { return Ok(()) };
        let chain = fault.chain();
        match shared.iter().any(|path| chain.contains(&path.display().to_string())) {
            true => Err(fault),
            false => Ok(()),
        }
    }

    fn read_files(&self, position: FrameIndex) -> Result<(Files, Key), Fault> {
        let files = Files(self.files[position].iter().map(File::read).collect::<Result<_, Fault>>()?);
        let key = self.kind.key(&files);
        Ok((files, key))
    }

    /// Checks each file with valid images, because broken images or images of different sizes would hide its faults.
    fn faults_by_part(&self, files: &[File], ctx: &mut Context<'_>) -> Vec<Fault> {
        let mut faults = Vec::new();
        let mut valid = None;
        for file in files.iter().filter(|file| is_image(file.part)) {
            match image_file::image(&file.path, Arc::clone(&file.bytes)) {
                Ok(_) => valid = valid.or_else(|| Some(Arc::clone(&file.bytes))),
                Err(fault) => faults.push(fault),
            }
        }
        let Some(valid) = valid else { return faults };
        let is_shared = |part: Part| is_image(part) || part.starts_with(CALIBRATION);
        let others = files.iter().map(|file| file.part).filter(|part| !is_shared(part)).map(Some);
        for other in std::iter::once(None).chain(others) {
            let chosen = files.iter().filter(|file| is_shared(file.part) || Some(file.part) == other);
            let chosen = Files(
                chosen
                    .map(|file| {
                        let bytes = if is_image(file.part) { &valid } else { &file.bytes };
                        File { part: file.part, path: file.path.clone(), bytes: Arc::clone(bytes) }
                    })
                    .collect(),
            );
            // Required parts are left out here on purpose.
            faults.extend(self.kind.values(&chosen, ctx).err().filter(|fault| !fault.chain().contains(LACKS)));
        }
        faults
    }
}

impl<K: DatasetKind> Source for Dataset<K> {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let (files, key) = self.read_files(position)?;
        self.read_ahead.keep(position, (files, key));
        Ok(key)
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let (files, key) = self.read_ahead.take(position).map_or_else(|| self.read_files(position), Ok)?;
        Ok(SourceOutputs { outputs: self.kind.values(&files, ctx)?, key })
    }

    fn files(&self, position: FrameIndex) -> Vec<(&'static str, PathBuf)> {
        self.files[position].clone()
    }

    fn examine(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Vec<Fault>> {
        let first = match self.read(position, ctx) {
            Ok(read) => return Ok(read),
            Err(fault) => fault,
        };
        let (mut faults, mut files) = (Vec::new(), Vec::new());
        for file in self.files[position].iter().map(File::read) {
            match file {
                Ok(file) => files.push(file),
                Err(fault) => faults.push(fault),
            }
        }
        faults.extend(self.faults_by_part(&files, ctx));
        if faults.iter().all(|fault| fault.chain() != first.chain()) {
            faults.push(first);
        }
        let mut seen = BTreeSet::new();
        faults.retain(|fault| seen.insert(fault.chain()));
        Err(faults)
    }
}
