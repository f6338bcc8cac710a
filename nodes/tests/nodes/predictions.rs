//! `depth/files` and `disparity/files`: formats, frames, units, and what is refused.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Image, Pixels};
use image::{GrayImage, ImageBuffer, Luma};
use serde_json::{Value as Json, json};

use crate::call::{call, metres};

fn image(width: u32, height: u32) -> Value {
    Image::new(Pixels::Grey(GrayImage::new(width, height))).into()
}

/// An NPY file.
pub(crate) fn npy(shape: &str, numbers: &[f32]) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    let body: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &body].concat()
}

fn depth(params: &Json, size: (u32, u32)) -> Result<Vec<f32>, String> {
    let values = call("depth/files", params, &[("image", image(size.0, size.1))]);
    let text =
        |fault: depthloom_graphs::Fault| format!("{} / {}", fault.chain(), fault.remedy_text().unwrap_or("no remedy"));
    values.map(|values| metres(&values["depth"]).to_vec()).map_err(text)
}

fn disparity(params: &Json, size: (u32, u32)) -> Vec<f32> {
    let values = call("disparity/files", params, &[("image", image(size.0, size.1))]);
    let values = values.unwrap_or_else(|fault| panic!("{}", fault.chain()));
    values["disparity"].disparity_px().expect("a disparity").into_raw()
}

fn assert_equal(found: &[f32], expected: &[f32]) {
    let same = |(a, b): (&f32, &f32)| a == b || a.is_nan() && b.is_nan();
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(same), "{found:?} is not {expected:?}");
}

/// The frame of these tests has the id 0 and the index 0.
fn write(folder: &Path, name: &str, bytes: &[u8]) -> Json {
    fs::write(folder.join(name), bytes).unwrap();
    json!(folder.join(name))
}

#[test]
fn every_format_gives_the_numbers_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let expected = [1.0, 2.5, f32::NAN, 4.0];
    let file = |name: &str| json!(folder.join(name.replace('0', "{frame}")));

    write(folder, "0.npy", &npy("(2, 2)", &[1.0, 2.5, f32::INFINITY, 4.0]));
    assert_equal(&depth(&json!({ "files": file("0.npy") }), (2, 2)).unwrap(), &expected);

    let pfm: Vec<u8> = [f32::NAN, 4.0, 1.0, 2.5].iter().flat_map(|number| number.to_le_bytes()).collect();
    write(folder, "0.pfm", &[b"Pf\n2 2\n-1\n", &pfm[..]].concat());
    assert_equal(&depth(&json!({ "files": file("0.pfm") }), (2, 2)).unwrap(), &expected);

    let png = ImageBuffer::from_raw(2, 2, vec![256_u16, 640, 0, 1024]).unwrap();
    let png: ImageBuffer<Luma<u16>, Vec<u16>> = png;
    png.save(folder.join("0.png")).unwrap();
    assert_equal(&depth(&json!({ "files": file("0.png"), "divide_by": 256 }), (2, 2)).unwrap(), &expected);
    // In millimetres, and the number that means invalid.
    let params = json!({ "files": file("0.png"), "unit": "millimetres", "invalid": 640 });
    assert_equal(&depth(&params, (2, 2)).unwrap(), &[0.256, f32::NAN, f32::NAN, 1.024]);

    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, first) in [("depth.npy", 1.0), ("other.npy", 9.0)] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&npy("(2, 2)", &[first, 2.5, f32::NAN, 4.0])).unwrap();
    }
    write(folder, "0.npz", zip.finish().unwrap().get_ref());
    assert_equal(&depth(&json!({ "files": file("0.npz"), "array": "depth" }), (2, 2)).unwrap(), &expected);
    let error = depth(&json!({ "files": file("0.npz") }), (2, 2)).unwrap_err();
    assert!(error.contains("has several arrays: depth, other / name one of them by `array`"), "{error}");

    let mut exr = std::io::Cursor::new(Vec::new());
    {
        use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, WritableImage as _};
        let channel = |name: &str, samples: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(samples));
        let channels = [channel("Z", vec![1.0, 2.5, f32::INFINITY, 4.0]), channel("index", vec![7.0; 4])];
        let channels = AnyChannels::sort(SmallVec::from_iter(channels));
        Image::from_channels((2, 2), channels).write().to_buffered(&mut exr).unwrap();
    }
    write(folder, "0.exr", exr.get_ref());
    assert_equal(&depth(&json!({ "files": file("0.exr") }), (2, 2)).unwrap(), &expected);
    assert_equal(&depth(&json!({ "files": file("0.exr"), "array": "index" }), (2, 2)).unwrap(), &[7.0; 4]);
    let error = depth(&json!({ "files": file("0.exr"), "array": "far" }), (2, 2)).unwrap_err();
    assert!(error.contains("has no channel `far`; it has Z, index"), "{error}");
}

#[test]
fn maps_belong_to_frames_by_placeholder_by_list_or_by_their_number_in_an_array() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let one = write(folder, "one.npy", &npy("(1, 2)", &[1.0, 2.0]));
    let other = write(folder, "other.npy", &npy("(1, 2)", &[3.0, 4.0]));
    let list = |frames: [&str; 2]| json!({ "files": [one, other], "frames": frames });
    assert_equal(&depth(&list(["0", "1"]), (2, 1)).unwrap(), &[1.0, 2.0]);
    assert_equal(&depth(&list(["1", "0"]), (2, 1)).unwrap(), &[3.0, 4.0]);
    let error = depth(&list(["1", "2"]), (2, 1)).unwrap_err();
    assert!(error.contains("has no file for the frame `0`"), "{error}");

    let all = write(folder, "all.npy", &npy("(2, 1, 2)", &[1.0, 2.0, 3.0, 4.0]));
    assert_equal(&depth(&json!({ "files": all }), (2, 1)).unwrap(), &[1.0, 2.0]);
    assert_equal(&depth(&json!({ "files": all, "frames": ["7", "0"] }), (2, 1)).unwrap(), &[3.0, 4.0]);
    let error = depth(&json!({ "files": all, "frames": ["7", "8"] }), (2, 1)).unwrap_err();
    assert!(error.contains("`frames` does not have the frame `0`"), "{error}");

    let error = depth(&json!({ "files": folder.join("{frame}.npy") }), (2, 1)).unwrap_err();
    assert!(error.contains("0.npy does not exist: it is the file of the frame `0`"), "{error}");
    for (params, expected) in [
        (json!({}), "files is missing"),
        (json!({ "files": [one, other] }), "`frames` must name the frame of each file"),
        (json!({ "files": [one, other], "frames": ["0"] }), "frames has 1 ids for 2 files"),
        (json!({ "files": [one, other], "frames": ["0", "0"] }), "names a frame twice"),
        (json!({ "files": "{id}.npy" }), "`{id}` is not a placeholder"),
        (json!({ "files": "{frame}.npy", "frames": ["0"] }), "a placeholder finds the file"),
        (json!({ "files": "{frame}.npy", "divide_by": 0 }), "divide_by is 0"),
    ] {
        let error = depth(&params, (2, 1)).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn another_size_is_an_error_or_resized() {
    let folder = tempfile::tempdir().unwrap();
    let files = write(folder.path(), "all.npy", &npy("(1, 1, 2)", &[4.0, 8.0]));
    let error = depth(&json!({ "files": files }), (4, 1)).unwrap_err();
    assert!(error.contains("all.npy is 2x1, and the image is 4x1 / set `resize: bilinear`"), "{error}");
    let resized = |resize: &str| json!({ "files": files, "resize": resize });
    assert_equal(&depth(&resized("nearest"), (4, 1)).unwrap(), &[4.0, 4.0, 8.0, 8.0]);
    assert_equal(&depth(&resized("bilinear"), (4, 1)).unwrap(), &[4.0, 5.0, 7.0, 8.0]);
    // Pixels grow with the width, shares do not.
    assert_equal(&disparity(&resized("nearest"), (4, 1)), &[8.0, 8.0, 16.0, 16.0]);
    let shares = json!({ "files": files, "resize": "nearest", "unit": "share", "divide_by": 16 });
    assert_equal(&disparity(&shares, (4, 1)), &[1.0, 1.0, 2.0, 2.0]);
}

#[test]
fn inverse_depth_becomes_metres() {
    let folder = tempfile::tempdir().unwrap();
    let files = write(folder.path(), "all.npy", &npy("(1, 1, 4)", &[0.5, 0.001, -1.0, f32::NAN]));
    let metres = depth(&json!({ "files": files, "quantity": "inverse-depth", "cap": 80 }), (4, 1)).unwrap();
    assert_equal(&metres, &[2.0, 80.0, 80.0, f32::NAN]);
    assert_equal(&disparity(&json!({ "files": files }), (4, 1)), &[0.5, 0.001, f32::NAN, f32::NAN]);
}

#[test]
fn eight_bits_do_not_hold_a_256th() {
    let folder = tempfile::tempdir().unwrap();
    GrayImage::from_pixel(2, 2, Luma([3])).save(folder.path().join("0.png")).unwrap();
    let error = depth(&json!({ "files": folder.path().join("{frame}.png"), "divide_by": 256 }), (2, 2)).unwrap_err();
    assert!(error.contains("has 8 bits: no number in it is above 0.996"), "{error}");
}
