//! Maps that another program predicted, read from files: what `depth/files` and `disparity/files` share.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{FramePaths, Observation};
use depthloom_graphs::values::{Image, Raster};
use depthloom_graphs::{Fault, Frame, Inputs, Key, regular_file};
use depthloom_kernels::resize::bilinear_f32;
use depthloom_threads::locked;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shape::filled;
use crate::sources::files::{self, float_file, image_file};

/// How a map of another size than the image is resized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ResizeMap {
    /// Another size is an error.
    #[default]
    None,
    /// The nearest number: for sparse maps.
    Nearest,
    /// Bilinear with half-pixel centres; a pixel next to an invalid one is invalid.
    Bilinear,
}

/// The files of a node, and how their numbers are read.
#[derive(Clone, Debug)]
pub(crate) struct PredictedMaps {
    pub(crate) files: FramePaths,
    pub(crate) frames: Vec<String>,
    pub(crate) array: Option<String>,
    pub(crate) divide_by: f64,
    pub(crate) invalid: Option<f64>,
    pub(crate) resize: ResizeMap,
}

/// A map at the size of the image.
pub(crate) struct PredictedMap {
    /// NaN where the file has no number, or the number that means invalid.
    pub(crate) numbers: Raster<f32>,
    /// Columns of the image for each column of the file.
    pub(crate) enlarged: f64,
}

/// A map as its file has it.
#[derive(Clone, Debug)]
pub struct FileMap {
    /// The numbers; NaN where they are not finite.
    pub numbers: Raster<f32>,
    /// Bits per number in the file.
    pub bits: u32,
}

/// Reads maps of files, and single maps of arrays.
#[derive(Debug, Default)]
pub struct MapReader {
    /// The last array that was decompressed, with the hash of its archive.
    archive: Mutex<Option<(Key, Arc<Vec<u8>>)>>,
}

impl MapReader {
    /// The map of a file, or of an array of maps the map `slice`. `array` is the name of an NPZ file's array, or of an
    /// EXR file's channel.
    ///
    /// # Errors
    /// Why the file has no such map.
    pub fn read(&self, path: &Path, array: Option<&str>, slice: Option<u64>) -> Result<FileMap, Fault> {
        let (numbers, bits) = match slice {
            None => files::numbers(path, &image_file::read(path)?, array)?,
            Some(slice) => match self.decompressed(path, array)? {
                Some(array) => (float_file::slice_f32(path, &array, Some(slice))?, 32),
                None => (float_file::npy_slice(path, slice)?, 32),
            },
        };
        Ok(FileMap { numbers, bits })
    }

    /// The array of an NPZ file; `None` of other files.
    fn decompressed(&self, path: &Path, array: Option<&str>) -> Result<Option<Arc<Vec<u8>>>, Fault> {
        if !files::is_archive(&head(path)?) {
            return Ok(None);
        }
        let bytes = image_file::read(path)?;
        let hash = Key::of_content(&bytes);
        let mut archive = locked(&self.archive);
        match &*archive {
            Some((known, array)) if *known == hash => Ok(Some(Arc::clone(array))),
            _ => {
                let array = Arc::new(files::member(path, &bytes, array)?);
                *archive = Some((hash, Arc::clone(&array)));
                Ok(Some(array))
            }
        }
    }
}

/// The first bytes of a file, as many as the header of an NPY file has.
fn head(path: &Path) -> Result<Vec<u8>, Fault> {
    let mut head = Vec::new();
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    regular_file::open(path).map_err(failed)?.take(1 << 13).read_to_end(&mut head).map_err(failed)?;
    Ok(head)
}

/// The pixel of a map with the side `own` that is nearest to the pixel `at` of an image with the side `side`.
#[must_use]
pub const fn nearest(at: u32, own: u32, side: u32) -> u32 {
    ((2 * at as u64 + 1) * own as u64 / (2 * side as u64)) as u32
}

/// The number of maps of an NPY or NPZ array of three dimensions; `None` of other files.
///
/// # Errors
/// Why the file cannot be read.
pub fn maps_in_array(path: &Path, array: Option<&str>) -> Result<Option<u64>, Fault> {
    let mut head = head(path)?;
    if files::is_archive(&head) {
        head = files::member(path, &image_file::read(path)?, array)?;
    }
    Ok(float_file::maps(&head))
}

/// What the documentation of both kinds has in common.
pub(crate) const DOC: &str = "\
**Files.** `files` names one file per frame with a placeholder: `{frame}` is the id of a frame, `{index}` its index. \
Or it is a list of files, with the ids of their frames in `frames`. Or it is one NPY or NPZ array of all frames \
(frames x rows x columns), and `frames` has the ids in its order. Without `frames`, a map's number is the index of \
its frame.\n\n\
**Formats.** PNG, TIFF and PNM with one channel of 8 or 16 bits, TIFF of 32-bit floats, PFM, NPY, NPZ and EXR; the \
content decides, not the name. The number in the file is divided by `divide_by`. Numbers that are infinite, NaN, or \
equal to `invalid` are invalid.\n\n\
**Reuse.** The cache key of a frame contains the content of its file.";

impl PredictedMaps {
    pub(crate) fn check(&self) -> Result<(), (&'static str, String)> {
        let FramePaths(paths) = &self.files;
        let error = |what: &str| Err(("files", what.to_owned()));
        if paths.is_empty() {
            return error("files is missing: set e.g. `files: predictions/{frame}.npy`");
        }
        let mut are_per_frame = false;
        for path in paths {
            are_per_frame |= Observation::is_per_frame(path).map_err(|what| ("files", format!("files: {what}")))?;
        }
        let ids: BTreeSet<&String> = self.frames.iter().collect();
        if ids.len() < self.frames.len() {
            return Err(("frames", "frames names a frame twice".to_owned()));
        }
        match (&paths[..], self.frames.len()) {
            ([_], 0) => {}
            ([_], _) if are_per_frame => {
                return Err((
                    "frames",
                    "frames is for a list of files, or for one array: a placeholder finds the file".to_owned(),
                ));
            }
            ([_], _) => {}
            (_, 0) => return error("files is a list: `frames` must name the frame of each file"),
            (_, _) if are_per_frame => return error("files is a list: its paths have no placeholders"),
            (several, count) if several.len() != count => {
                return Err(("frames", format!("frames has {count} ids for {} files", several.len())));
            }
            _ => {}
        }
        if self.divide_by <= 0.0 || !self.divide_by.is_finite() {
            return Err(("divide_by", format!("divide_by is {}, which is not a number above 0", self.divide_by)));
        }
        Ok(())
    }

    /// The frame's files enter its cache key.
    pub(crate) fn observation(&self) -> Observation {
        match &self.files.0[..] {
            [only] => Observation { files: vec![only.clone()], by_id: BTreeMap::new() },
            several => Observation {
                files: Vec::new(),
                by_id: self.frames.iter().cloned().zip(several.iter().cloned()).collect(),
            },
        }
    }
}

/// Reads the map of each frame.
pub(crate) struct PredictionReader {
    maps: PredictedMaps,
    observation: Observation,
    /// Whether one file has the maps of all frames, or of the only one.
    is_array: bool,
    reader: MapReader,
}

impl PredictionReader {
    pub(crate) fn new(maps: PredictedMaps) -> Self {
        let observation = maps.observation();
        let is_array = match &maps.files.0[..] {
            [only] => !Observation::is_per_frame(only).unwrap_or(false),
            _ => false,
        };
        Self { maps, observation, is_array, reader: MapReader::default() }
    }

    /// The map of a frame, at the size of the image at the input `image`.
    pub(crate) fn read(&self, frame: &Frame, inputs: &Inputs<'_>) -> Result<PredictedMap, Fault> {
        let size = inputs.get::<Image>("image")?.dimensions();
        let Some(path) = self.observation.files_of(frame).next() else {
            return Err(Fault::new(format!("`files` has no file for the frame `{}`", frame.id))
                .remedy("add its file to `files` and its id to `frames`, or select fewer frames at the source"));
        };
        if !path.exists() {
            return Err(Fault::new(format!(
                "{} does not exist: it is the file of the frame `{}`",
                path.display(),
                frame.id
            ))
            .remedy("correct `files`, or select fewer frames at the source"));
        }
        let FileMap { mut numbers, bits } =
            self.reader.read(&path, self.maps.array.as_deref(), self.slice(&path, frame)?)?;
        let PredictedMaps { divide_by, invalid, resize, .. } = &self.maps;
        if bits == 8 && *divide_by >= 256.0 {
            let what = format!("{} has 8 bits: no number in it is above {:.3}", path.display(), 255.0 / divide_by);
            return Err(Fault::new(what)
                .remedy("an image tool may have saved it with 8 bits: write it with 16 bits, or lower `divide_by`"));
        }
        let (divisor, invalid) = (*divide_by as f32, invalid.map_or(f32::NAN, |invalid| invalid as f32));
        for number in numbers.iter_mut() {
            *number = if number.is_finite() && *number != invalid { *number / divisor } else { f32::NAN };
        }
        let own = numbers.dimensions();
        let enlarged = f64::from(size.0) / f64::from(own.0);
        if own == size {
            return Ok(PredictedMap { numbers, enlarged: 1.0 });
        }
        let numbers = match resize {
            ResizeMap::None => {
                let ((w, h), (width, height)) = (own, size);
                let what = format!("{} is {w}x{h}, and the image is {width}x{height}", path.display());
                return Err(Fault::new(what).remedy("set `resize: bilinear`, or `resize: nearest` for a sparse map"));
            }
            ResizeMap::Nearest => Raster::from_fn(size.0, size.1, |x, y| {
                *numbers.get_pixel(nearest(x, own.0, size.0), nearest(y, own.1, size.1))
            }),
            ResizeMap::Bilinear => filled(size, |out| {
                let sides = [own.0, own.1, size.0, size.1].map(|side| side as usize);
                bilinear_f32(&numbers, sides[0], sides[1], sides[2], sides[3], out);
            }),
        };
        Ok(PredictedMap { numbers, enlarged })
    }

    /// The number of the frame's map in an array of all frames; `None` if the frame has a file of its own.
    fn slice(&self, path: &Path, frame: &Frame) -> Result<Option<u64>, Fault> {
        if !self.is_array {
            return Ok(None);
        }
        let ids = &self.maps.frames;
        if ids.is_empty() {
            return Ok(Some(frame.index));
        }
        let at = ids.iter().position(|id| **id == *frame.id).ok_or_else(|| {
            Fault::new(format!("`frames` does not have the frame `{}`", frame.id))
                .remedy("list the ids of all frames, in the order of `files` or of the array")
        })?;
        // A list of one file is not an array.
        let is_single = ids.len() == 1 && maps_in_array(path, self.maps.array.as_deref())?.is_none();
        Ok((!is_single).then_some(at as u64))
    }
}

/// The paths of a node before the first frame: only what needs no frame is checked.
pub(crate) fn missing_array(maps: &PredictedMaps) -> Option<&PathBuf> {
    match &maps.files.0[..] {
        [only] if Observation::is_per_frame(only) == Ok(false) && !only.exists() => Some(only),
        _ => None,
    }
}
