//! The files of one frame, read completely and decoded on request.

use std::path::PathBuf;
use std::sync::Arc;

use depthloom_graphs::values::{Image, Raster};
use depthloom_graphs::{Context, Fault, Key};

use crate::sources::files::{float_file, image_file};

/// The role of a file in a frame: `left`, `calibration`. It enters the frame's key.
pub(crate) type Part = &'static str;

pub(crate) const LEFT: Part = "left";
pub(crate) const RIGHT: Part = "right";
pub(crate) const CALIBRATION: Part = "calibration";
pub(crate) const TRUTH: Part = "truth";

pub(super) const LACKS: &str = "the frame has no file of its part";

#[derive(Debug)]
pub(crate) struct File {
    pub(super) part: Part,
    pub path: PathBuf,
    pub bytes: Arc<[u8]>,
}

impl File {
    pub(super) fn read((part, path): &(Part, PathBuf)) -> Result<Self, Fault> {
        Ok(Self { part, path: path.clone(), bytes: image_file::read(path)? })
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    fn image_of_bits(&self, bits: Option<u32>, ctx: &Context<'_>) -> Result<Image, Fault> {
        let (image, brightest) = image_file::image_of_bits(&self.path, Arc::clone(&self.bytes), bits)?;
        if let Some(warning) = brightest.and_then(|brightest| brightest.warning(bits)) {
            ctx.host.warn(warning);
        }
        Ok(image)
    }

    pub(crate) fn fault(&self, what: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{}: {what}", self.path.display()))
    }
}

#[derive(Debug)]
pub(crate) struct Files(pub(super) Vec<File>);

impl Files {
    pub(crate) fn key(&self, (kind, version): (&str, u32), meaning: &str) -> Key {
        let key = Key::build(kind).number(version.into()).text(meaning);
        self.0.iter().fold(key, |key, file| key.text(file.part).bytes(&file.bytes)).finish()
    }

    pub(crate) fn get(&self, part: Part) -> Option<&File> {
        self.0.iter().find(|file| file.part == part)
    }

    /// The file of a part that every frame of the data set has.
    pub(crate) fn required(&self, part: Part) -> Result<&File, Fault> {
        self.get(part).ok_or_else(|| Fault::new(format!("{LACKS} `{part}`")))
    }

    pub(crate) fn pair(&self, ctx: &Context<'_>) -> Result<(Image, Image), Fault> {
        self.pair_of_bits(None, ctx)
    }

    /// 16-bit samples use the lowest `bits`.
    pub(crate) fn pair_of_bits(&self, bits: Option<u32>, ctx: &Context<'_>) -> Result<(Image, Image), Fault> {
        let (left, file) = (self.left_of_bits(bits, ctx)?, self.required(RIGHT)?);
        let right = file.image_of_bits(bits, ctx)?;
        self.same_size_as_left(left.dimensions(), file, right.dimensions())?;
        Ok((left, right))
    }

    /// 16-bit samples use the lowest `bits`.
    pub(crate) fn left_of_bits(&self, bits: Option<u32>, ctx: &Context<'_>) -> Result<Image, Fault> {
        self.required(LEFT)?.image_of_bits(bits, ctx)
    }

    /// `unit` is `disparity` (px) or `metres`, times 256. `None` if the frame has no such file.
    pub(crate) fn map_u16(&self, part: Part, unit: &str, left: (u32, u32)) -> Result<Option<Raster<u16>>, Fault> {
        self.map(part, left, |file| image_file::map_u16(&file.path, &file.bytes, unit))
    }

    pub(crate) fn map_f32(&self, part: Part, left: (u32, u32)) -> Result<Option<Raster<f32>>, Fault> {
        self.map(part, left, |file| float_file::map_f32(&file.path, &file.bytes))
    }

    /// `what` describes the expected map in messages.
    pub(crate) fn map_u8(&self, part: Part, what: &str, left: (u32, u32)) -> Result<Option<Raster<u8>>, Fault> {
        self.map(part, left, |file| image_file::map_u8(&file.path, &file.bytes, what))
    }

    fn map<T: image::Primitive>(
        &self,
        part: Part,
        left: (u32, u32),
        read: impl FnOnce(&File) -> Result<Raster<T>, Fault>,
    ) -> Result<Option<Raster<T>>, Fault> {
        let Some(file) = self.get(part) else { return Ok(None) };
        let map = read(file)?;
        self.same_size_as_left(left, file, map.dimensions())?;
        Ok(Some(map))
    }

    pub(crate) fn same_size_as_left(&self, left: (u32, u32), file: &File, (w, h): (u32, u32)) -> Result<(), Fault> {
        if left == (w, h) {
            return Ok(());
        }
        let (path, left_path) = (file.path.display(), self.required(LEFT)?.path.display());
        let what = format!("{path} is {w}x{h}, and {left_path} is {}x{}: they must have the same size", left.0, left.1);
        Err(Fault::new(what).remedy("all files of a frame must have one size: create or unpack them again"))
    }
}
