//! Maps of numbers: portable float maps (<https://netpbm.sourceforge.net/doc/pfm.html>) and NumPy arrays
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>), recognised by their first bytes.
//! Nothing is allocated before a header's size is compared with the bytes that follow it.

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use depthloom_graphs::values::Raster;
use depthloom_graphs::{Fault, regular_file};

use super::shortened;

/// Bytes.
const LONGEST_HEADER: usize = 4096;

/// Row 0 is the top row. Infinite and NaN become NaN. PFM: one channel, either byte order (sign of the scale; its size
/// is ignored, as by Middlebury's tools), rows from bottom to top. NPY: two dimensions, row-major, floats or integers
/// of either byte order.
pub(crate) fn map_f32(path: &Path, bytes: &[u8]) -> Result<Raster<f32>, Fault> {
    slice_f32(path, bytes, None)
}

/// As [`map_f32`], of an NPY array of three dimensions the map `slice`.
pub(crate) fn slice_f32(path: &Path, bytes: &[u8], slice: Option<u64>) -> Result<Raster<f32>, Fault> {
    let read = match bytes {
        [b'P', b'f', ..] => pfm(bytes),
        [b'P', b'F', ..] => Err(Wrong::Kind("it is a PFM of three channels: maps have one (`Pf`)".to_owned())),
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => npy(bytes, slice),
        _ => Err(Wrong::Kind(format!("it is neither a PFM nor an NPY file ({} bytes)", bytes.len()))),
    };
    read.map_err(|wrong| wrong.fault(path))
}

enum Wrong {
    Kind(String),
    Bytes(String),
}

impl Wrong {
    fn fault(self, path: &Path) -> Fault {
        let (what, remedy) = match self {
            Self::Kind(what) => (what, "a map is a PFM of one channel (`Pf`) or an NPY array of two dimensions"),
            Self::Bytes(what) => (what, "the file is incomplete or damaged: copy or download it again"),
        };
        Fault::new(format!("{}: {what}", path.display())).remedy(remedy)
    }
}

fn pfm(bytes: &[u8]) -> Result<Raster<f32>, Wrong> {
    let header = |what: &str| Wrong::Bytes(format!("its PFM header {what}"));
    // Three numbers, each after white space; a single byte of it follows.
    let mut at = 2;
    let mut tokens = [""; 3];
    for token in &mut tokens {
        let begin = at + bytes[at..].iter().take(LONGEST_HEADER).take_while(|byte| byte.is_ascii_whitespace()).count();
        let rest = bytes[begin..].iter().take(LONGEST_HEADER);
        let end = begin + rest.take_while(|byte| !byte.is_ascii_whitespace()).count();
        *token = std::str::from_utf8(&bytes[begin..end]).map_err(|_| header("is not text"))?;
        at = end;
    }
    let size = |text: &str, what: &str| {
        let number = text.parse::<u32>().ok().filter(|number| *number > 0);
        number.ok_or_else(|| header(&format!("has `{}` instead of {what}", shortened(text))))
    };
    let (width, height) = (size(tokens[0], "the width")?, size(tokens[1], "the height")?);
    let scale = tokens[2].parse::<f32>().ok().filter(|scale| *scale != 0.0 && !scale.is_nan());
    let scale = scale.ok_or_else(|| header(&format!("has `{}` instead of the scale", shortened(tokens[2]))))?;
    let body = match bytes.get(at + 1..).unwrap_or_default() {
        // A line that ends as on Windows.
        [b'\n', body @ ..] if bytes[at] == b'\r' => body,
        body => body,
    };
    check_size((width, height), 4, body)?;
    let number: fn([u8; 4]) -> f32 = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let rows = body.rchunks_exact(4 * width as usize);
    let samples = rows.flat_map(|row| row.as_chunks().0.iter().map(|bytes| known(number(*bytes)))).collect();
    Ok(Raster::from_raw(width, height, samples).expect("one number per pixel"))
}

fn check_size((width, height): (u32, u32), bytes_per_pixel: usize, body: &[u8]) -> Result<(), Wrong> {
    let expected = u128::from(width) * u128::from(height) * bytes_per_pixel as u128;
    match body.len() as u128 == expected && expected > 0 {
        true => Ok(()),
        false => Err(Wrong::Bytes(format!(
            "its header states {width}x{height}, which needs {expected} bytes, but it has {}",
            body.len()
        ))),
    }
}

/// The first axis of an array of maps counts them; `slice` selects one. Other axes of length 1 are ignored.
fn npy(bytes: &[u8], slice: Option<u64>) -> Result<Raster<f32>, Wrong> {
    let header = NpyHeader::read(bytes)?;
    let (size, first) = header.map(slice)?;
    let body = bytes.get(header.start..).unwrap_or_default();
    if body.len() as u128 != header.bytes() {
        return Err(header.wrong_length(body.len() as u64));
    }
    let bytes_of_map = size.0 as usize * size.1 as usize * header.sample.bytes();
    let first = first as usize * bytes_of_map;
    Ok(header.raster(size, &body[first..first + bytes_of_map]))
}

/// Reads one map of an NPY file of several, and nothing else of it.
///
/// Row 0 is the top row. Infinite and NaN become NaN.
pub(crate) fn npy_slice(path: &Path, slice: u64) -> Result<Raster<f32>, Fault> {
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let mut file = regular_file::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let mut head = Vec::new();
    file.by_ref().take(LONGEST_HEADER as u64 + 12).read_to_end(&mut head).map_err(failed)?;
    let wrong = |wrong: Wrong| wrong.fault(path);
    let header = NpyHeader::read(&head).map_err(wrong)?;
    let (size, first) = header.map(Some(slice)).map_err(wrong)?;
    let body = length.saturating_sub(header.start as u64);
    if u128::from(body) != header.bytes() {
        return Err(wrong(header.wrong_length(body)));
    }
    let bytes_of_map = size.0 as usize * size.1 as usize * header.sample.bytes();
    let mut map = vec![0; bytes_of_map];
    file.seek(SeekFrom::Start(header.start as u64 + first * bytes_of_map as u64)).map_err(failed)?;
    file.read_exact(&mut map).map_err(failed)?;
    Ok(header.raster(size, &map))
}

/// The number of maps of an NPY array of three dimensions; `None` of other bytes.
pub(crate) fn maps(bytes: &[u8]) -> Option<u64> {
    let shape = NpyHeader::read(bytes.starts_with(b"\x93NUMPY").then_some(bytes)?).ok()?.shape;
    let [count, rest @ ..] = &shape[..] else { return None };
    (rest.iter().filter(|side| **side != 1).count() >= 2 && rest.len() >= 2).then_some(*count)
}

struct NpyHeader {
    sample: Sample,
    shape: Vec<u64>,
    /// Where the numbers begin.
    start: usize,
}

impl NpyHeader {
    fn read(bytes: &[u8]) -> Result<Self, Wrong> {
        let cut = || Wrong::Bytes("its NPY header is cut off".to_owned());
        let (length, start) = match bytes.get(6).ok_or_else(cut)? {
            1 => (usize::from(u16::from_le_bytes(*bytes.get(8..).and_then(<[u8]>::first_chunk).ok_or_else(cut)?)), 10),
            2 | 3 => (u32::from_le_bytes(*bytes.get(8..).and_then(<[u8]>::first_chunk).ok_or_else(cut)?) as usize, 12),
            version => return Err(Wrong::Kind(format!("it is of version {version} of NPY, and 1 to 3 are read"))),
        };
        if length > LONGEST_HEADER {
            return Err(Wrong::Kind(format!(
                "its NPY header has the length {length} bytes, and a map's is below {LONGEST_HEADER}"
            )));
        }
        let text = bytes.get(start..start + length).ok_or_else(cut)?;
        let text = std::str::from_utf8(text).map_err(|_| Wrong::Bytes("its NPY header is not text".to_owned()))?;
        let entry = |key: &str| {
            let behind = text.split_once(&format!("'{key}'")).map(|(_, behind)| behind.trim_start());
            behind.and_then(|behind| behind.strip_prefix(':')).map(str::trim_start)
        };
        let missing = |key: &str| Wrong::Kind(format!("its NPY header has no `{key}` of a plain array"));
        let sample = entry("descr").and_then(|text| text.strip_prefix('\'')).and_then(|text| text.split('\'').next());
        let sample = sample.ok_or_else(|| missing("descr"))?;
        if !entry("fortran_order").ok_or_else(|| missing("fortran_order"))?.starts_with("False") {
            return Err(Wrong::Kind("its columns come first: write np.ascontiguousarray(map)".to_owned()));
        }
        let shape = entry("shape").and_then(|text| text.strip_prefix('(')).and_then(|text| text.split(')').next());
        let shape = shape.ok_or_else(|| missing("shape"))?;
        let shape = shape.split(',').filter_map(|size| size.trim().parse().ok()).collect();
        let Some(sample) = Sample::parse(sample) else {
            return Err(Wrong::Kind(format!(
                "its numbers are `{}`, and those of a map are floats of 16, 32 or 64 bits, or integers: write map.astype(np.float32)",
                shortened(sample)
            )));
        };
        Ok(Self { sample, shape, start: start + length })
    }

    /// The size of a map (columns, rows), and which of the maps `slice` is.
    fn map(&self, slice: Option<u64>) -> Result<((u32, u32), u64), Wrong> {
        let mut sides = self.shape.as_slice();
        let text = || shortened(&self.shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", "));
        if let Some(slice) = slice {
            let count = match sides {
                [count, rest @ ..] if rest.len() >= 2 => {
                    sides = rest;
                    *count
                }
                _ => {
                    return Err(Wrong::Kind(format!(
                        "its shape is ({}), and an array of maps has frames x rows x columns",
                        text()
                    )));
                }
            };
            if slice >= count {
                return Err(Wrong::Kind(format!("it has {count} maps, and number {slice} (from 0) is needed")));
            }
        }
        let mut sides = sides.to_vec();
        while sides.len() > 2
            && let Some(at) = sides.iter().position(|side| *side == 1)
        {
            sides.remove(at);
        }
        let sizes: Vec<u32> = sides.iter().filter_map(|side| u32::try_from(*side).ok()).collect();
        let [height, width] = sizes[..] else {
            return Err(Wrong::Kind(format!("its shape is ({}), and a map has two dimensions", text())));
        };
        if width == 0 || height == 0 {
            return Err(Wrong::Kind(format!("its shape is ({}): it has no pixels", text())));
        }
        Ok(((width, height), slice.unwrap_or(0)))
    }

    /// Of all its numbers.
    fn bytes(&self) -> u128 {
        self.shape.iter().fold(self.sample.bytes() as u128, |bytes, side| bytes.saturating_mul(u128::from(*side)))
    }

    fn wrong_length(&self, have: u64) -> Wrong {
        let shape = self.shape.iter().map(u64::to_string).collect::<Vec<_>>();
        let needed = self.bytes();
        Wrong::Bytes(format!("its header states {}, which needs {needed} bytes, but it has {have}", shape.join("x")))
    }

    fn raster(&self, size: (u32, u32), bytes: &[u8]) -> Raster<f32> {
        let samples = bytes.chunks_exact(self.sample.bytes()).map(|bytes| known(self.sample.number(bytes))).collect();
        Raster::from_raw(size.0, size.1, samples).expect("one number per pixel")
    }
}

#[derive(Clone, Copy)]
struct Sample {
    is_big_endian: bool,
    kind: u8,
    bytes: usize,
}

impl Sample {
    fn parse(text: &str) -> Option<Self> {
        let [order, kind, bytes] = *text.as_bytes() else { return None };
        let bytes = usize::from(bytes.checked_sub(b'0')?);
        let is_known = match kind {
            b'f' => matches!(bytes, 2 | 4 | 8),
            b'u' | b'i' => matches!(bytes, 1 | 2 | 4 | 8),
            _ => false,
        };
        let is_ordered = matches!(order, b'<' | b'>') || order == b'|' && bytes == 1;
        (is_known && is_ordered).then_some(Self { is_big_endian: order == b'>', kind, bytes })
    }

    const fn bytes(self) -> usize {
        self.bytes
    }

    fn number(self, bytes: &[u8]) -> f32 {
        let mut wide = [0; 8];
        wide[..self.bytes].copy_from_slice(bytes);
        if self.is_big_endian {
            wide[..self.bytes].reverse();
        }
        let bits = u64::from_le_bytes(wide);
        let empty = 64 - 8 * self.bytes as u32;
        match (self.kind, self.bytes) {
            (b'f', 2) => half::f16::from_bits(bits as u16).to_f32(),
            (b'f', 4) => f32::from_bits(bits as u32),
            (b'f', _) => f64::from_bits(bits) as f32,
            (b'i', _) => ((bits << empty) as i64 >> empty) as f32,
            _ => bits as f32,
        }
    }
}

const fn known(number: f32) -> f32 {
    if number.is_finite() { number } else { f32::NAN }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;

    use super::{map_f32, npy_slice, slice_f32};

    fn pfm(header: &str, numbers: &[f32], bytes: fn(f32) -> [u8; 4]) -> Vec<u8> {
        [header.as_bytes(), &numbers.iter().flat_map(|number| bytes(*number)).collect::<Vec<u8>>()].concat()
    }

    fn npy(descr: &str, shape: &str, body: &[u8]) -> Vec<u8> {
        let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let length = (text.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00".as_slice(), &length, text.as_bytes(), body].concat()
    }

    fn read(bytes: &[u8]) -> (u32, u32, Vec<f32>) {
        let map = map_f32(Path::new("disp0.pfm"), bytes).unwrap_or_else(|fault| panic!("{fault}"));
        (map.width(), map.height(), map.into_raw())
    }

    fn error(bytes: &[u8]) -> String {
        map_f32(Path::new("disp0.pfm"), bytes).expect_err("it is refused").to_string()
    }

    #[test]
    fn rows_stand_bottom_up_in_either_byte_order_and_infinity_is_unknown() {
        let numbers = [4.0, 5.0, 6.0, 1.0, f32::INFINITY, 3.5];
        let files = [
            pfm("Pf\n3 2\n-1.0\n", &numbers, f32::to_le_bytes),
            pfm("Pf\n3 2\n1\n", &numbers, f32::to_be_bytes),
            pfm("Pf 3 2 -0.003922\n", &numbers, f32::to_le_bytes),
            pfm("Pf\r\n3 2\r\n-1.0\r\n", &numbers, f32::to_le_bytes),
        ];
        for file in files {
            let (width, height, map) = read(&file);
            assert_eq!((width, height, map[0], map[2..].to_vec()), (3, 2, 1.0, vec![3.5, 4.0, 5.0, 6.0]));
            assert!(map[1].is_nan());
        }
        // A number whose first byte is that of a line's end.
        let odd = f32::from_le_bytes([b'\n', 0, 0, 0x40]);
        assert_eq!(read(&pfm("Pf\n1 1\n-1\n", &[odd], f32::to_le_bytes)).2, [odd]);
    }

    #[test]
    fn arrays_are_read_in_their_numbers() {
        let floats = [1.5_f32, f32::NAN, -2.0, 4.0].map(f32::to_le_bytes).concat();
        let (width, height, map) = read(&npy("<f4", "(2, 2)", &floats));
        assert_eq!((width, height, map[0], map[2], map[3], map[1].is_nan()), (2, 2, 1.5, -2.0, 4.0, true));
        assert_eq!(read(&npy(">f8", "(1, 2)", &[0.5_f64, 3.0].map(f64::to_be_bytes).concat())).2, [0.5, 3.0]);
        assert_eq!(read(&npy("|u1", "(1, 3)", &[0, 7, 255])).2, [0.0, 7.0, 255.0]);
        assert_eq!(read(&npy("<f2", "(1, 2)", &[0x00, 0x3c, 0x00, 0xc0])).2, [1.0, -2.0]);
        assert_eq!(read(&npy("<i8", "(1, 1)", &(-7_i64).to_le_bytes())).2, [-7.0]);
        assert_eq!(read(&npy(">i2", "(2, 1)", &[-3_i16, 500].map(i16::to_be_bytes).concat())).2, [-3.0, 500.0]);
        assert_eq!(read(&npy("<u2", "(1, 1)", &65535_u16.to_le_bytes())).2, [65535.0]);
    }

    #[test]
    fn one_map_of_an_array_of_maps_is_read() {
        let numbers: Vec<u8> = (0..12_u16).flat_map(u16::to_le_bytes).collect();
        let file = npy("<u2", "(3, 2, 2)", &numbers);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.npy");
        std::fs::write(&path, &file).unwrap();
        for (slice, expected) in [(0, [0.0, 1.0, 2.0, 3.0]), (2, [8.0, 9.0, 10.0, 11.0])] {
            assert_eq!(slice_f32(&path, &file, Some(slice)).unwrap().into_raw(), expected);
            assert_eq!(npy_slice(&path, slice).unwrap().into_raw(), expected);
        }
        for error in [slice_f32(&path, &file, Some(3)), npy_slice(&path, 3)] {
            let error = error.unwrap_err().to_string();
            assert!(error.contains("all.npy: it has 3 maps, and number 3 (from 0) is needed"), "{error}");
        }
        // Axes of length 1 are ignored, beside that of the frames.
        let one = npy("<u2", "(3, 1, 2, 2)", &numbers);
        assert_eq!(slice_f32(&path, &one, Some(1)).unwrap().into_raw(), [4.0, 5.0, 6.0, 7.0]);
        assert_eq!(read(&npy("<u2", "(1, 3, 4, 1)", &numbers)).0, 4);
        let flat = npy("<u2", "(3, 4)", &numbers);
        assert!(slice_f32(&path, &flat, Some(0)).unwrap_err().to_string().contains("frames x rows x columns"));
        std::fs::write(&path, &file[..file.len() - 2]).unwrap();
        let error = npy_slice(&path, 0).unwrap_err().to_string();
        assert!(error.contains("its header states 3x2x2, which needs 24 bytes, but it has 22"), "{error}");
    }

    #[test]
    fn files_that_are_not_maps_or_state_a_wrong_size_are_refused() {
        let file = pfm("Pf\n3 2\n-1.0\n", &[0.0; 6], f32::to_le_bytes);
        assert_eq!(error(&file[..30]), "disp0.pfm: its header states 3x2, which needs 24 bytes, but it has 18");
        assert_eq!(
            error(b"Pf\n4000000000 4000000000\n-1.0\n1234"),
            "disp0.pfm: its header states 4000000000x4000000000, which needs 64000000000000000000 bytes, but it has 4"
        );
        assert!(error(b"Pf\n3 2\n0\n").contains("has `0` instead of the scale"));
        assert!(error(b"Pf\n3 -2\n1\n").contains("has `-2` instead of the height"));
        assert!(error(b"Pf").contains("has `` instead of the width"));
        assert!(error(b"PF\n1 1\n-1\n000000000000").contains("a PFM of three channels"));
        assert!(error(b"\x89PNG").contains("neither a PFM nor an NPY file (4 bytes)"));
        assert!(error(&npy("<f4", "(2, 2, 3)", &[0; 48])).contains("its shape is (2, 2, 3), and a map has two"));
        assert!(error(&npy("<c8", "(2, 2)", &[0; 32])).contains("its numbers are `<c8`"));
        assert!(error(&npy("<f4", "(70000, 70000)", &[0; 4])).contains("which needs 19600000000 bytes, but it has 4"));
        assert!(error(b"\x93NUMPY\x01\x00\xff").contains("cut off"));
    }

    proptest! {
        #[test]
        fn whatever_a_file_holds_is_a_map_or_an_error(
            start in prop_oneof![Just(b"Pf\n".to_vec()), Just(b"\x93NUMPY\x01\x00".to_vec()), Just(b"\x93NUMPY\x02\x00".to_vec())],
            rest in proptest::collection::vec(prop_oneof![any::<u8>(), b'0'..=b'9', Just(b' '), Just(b'-')], 0..80),
        ) {
            drop(map_f32(Path::new("a"), &[start, rest].concat()));
        }
    }
}
