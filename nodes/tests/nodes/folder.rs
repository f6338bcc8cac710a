//! A data set made by a test: files in a folder, and the messages of a source.

use depthloom_graphs::plan::FrameIndex;
use std::fs;
use std::path::{Path, PathBuf};

use image::{DynamicImage, GrayImage, ImageBuffer, Luma, RgbImage};
use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::call::{Opened, open};

/// Columns and rows of the images.
pub(crate) const SIZE: (u32, u32) = (40, 30);

/// A folder of files.
pub(crate) struct Folder {
    root: PathBuf,
    _folder: Option<TempDir>,
}

impl Folder {
    /// One of its own, which goes with the value.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { root: folder.path().to_owned(), _folder: Some(folder) }
    }

    /// One that is there.
    pub(crate) fn at(root: &Path) -> Self {
        Self { root: root.to_owned(), _folder: None }
    }

    /// A file or folder in it; what lies above is made.
    pub(crate) fn path(&self, file: &str) -> PathBuf {
        let path = self.root.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    }

    pub(crate) fn text(&self, file: &str, text: &str) {
        self.bytes(file, text.as_bytes());
    }

    pub(crate) fn bytes(&self, file: &str, bytes: &[u8]) {
        fs::write(self.path(file), bytes).unwrap();
    }

    pub(crate) fn remove(&self, file: &str) {
        let path = self.path(file);
        if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }.unwrap();
    }

    /// A colour image.
    pub(crate) fn image(&self, file: &str) {
        self.image_of(file, SIZE);
    }

    pub(crate) fn image_of(&self, file: &str, (width, height): (u32, u32)) {
        let image = RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 7]));
        DynamicImage::ImageRgb8(image).save(self.path(file)).unwrap();
    }

    /// 16 bits: `value` in column 3 of row 2, 0 elsewhere.
    pub(crate) fn map(&self, file: &str, value: u16) {
        let map = ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| Luma([if (x, y) == (3, 2) { value } else { 0 }]));
        DynamicImage::ImageLuma16(map).save(self.path(file)).unwrap();
    }

    /// 8 bits, likewise.
    pub(crate) fn map_u8(&self, file: &str, value: u8) {
        self.map_u8_of(file, SIZE, value);
    }

    pub(crate) fn map_u8_of(&self, file: &str, (width, height): (u32, u32), value: u8) {
        let map = GrayImage::from_fn(width, height, |x, y| Luma([if (x, y) == (3, 2) { value } else { 0 }]));
        map.save(self.path(file)).unwrap();
    }

    /// A PFM of floats, little-endian: these at columns 3, 4, ... of row 2, infinite elsewhere.
    pub(crate) fn pfm(&self, file: &str, (width, height): (u32, u32), values: &[f32]) {
        let at = |x: u32, y: u32| {
            let value = x.checked_sub(3).and_then(|x| values.get(x as usize)).filter(|_| y == 2);
            value.copied().unwrap_or(f32::INFINITY)
        };
        let mut bytes = format!("Pf\n{width} {height}\n-1\n").into_bytes();
        for (y, x) in (0..height).rev().flat_map(|y| (0..width).map(move |x| (y, x))) {
            bytes.extend(at(x, y).to_le_bytes());
        }
        self.bytes(file, &bytes);
    }

    pub(crate) fn params(&self, more: &Json) -> Json {
        let mut params = json!({ "root": self.root });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    }

    pub(crate) fn open(&self, kind: &str, more: &Json) -> Opened {
        open(kind, &self.params(more)).unwrap_or_else(|fault| panic!("{}", fault.chain()))
    }

    /// The message when it is opened or at its first frame, with the folder called ROOT.
    pub(crate) fn report(&self, kind: &str, more: &Json) -> String {
        let fault = match open(kind, &self.params(more)) {
            Ok(opened) => opened.read(FrameIndex(0)).expect_err("it is refused"),
            Err(fault) => fault,
        };
        let remedy = fault.remedy_text().map_or_else(String::new, |text| format!("\n  remedy: {text}"));
        format!("{}{remedy}", fault.chain()).replace(&self.root.display().to_string(), "ROOT")
    }
}
