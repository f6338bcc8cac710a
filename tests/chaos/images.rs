//! Spoilt images and calibrations of a data set in KITTI's layout.
//!
//! A PNG has checksums: a flipped bit or a cut is an error, or changes no table. Of an image of another size or kind
//! the program must decide itself: an error, or a whole answer. JPEGs and calibrations have no checksum, so that only
//! panics, hangs and errors without a word count.

use std::fs;
use std::io::Cursor;
use std::path::PathBuf;

use image::{DynamicImage, ImageFormat};

use crate::answer::Answer;
use crate::case::{Case, copy_folder};
use crate::child::Ended;
use crate::ground::{DATA, RUN};
use crate::verdict::{Verdict, judge};

/// The folders of images.
const FOLDERS: [&str; 3] = ["image_2", "image_3", "disp_occ_0"];

pub(crate) fn bits(case: &mut Case<'_>) -> Verdict {
    let (path, mut bytes) = an_image(case);
    let what = case.random.flip(&mut bytes);
    case.note(what);
    fs::write(path, bytes).expect("written");
    run_and_compare(case)
}

pub(crate) fn cuts(case: &mut Case<'_>) -> Verdict {
    let (path, bytes) = an_image(case);
    let at = case.random.below(bytes.len());
    case.note(format!("cut to {at} of {} bytes", bytes.len()));
    fs::write(path, &bytes[..at]).expect("written");
    run_and_compare(case)
}

/// Another image: of odd size, or of other pixels.
pub(crate) fn others(case: &mut Case<'_>) -> Verdict {
    let sides = [1, 2, 3, 7, 15, 16, 17, 31, 33, 47, 48, 64, 95, 96, 97, 130, 257];
    let size = (case.random.pick(&sides), case.random.pick(&sides));
    // Sometimes all files of the frame, so that they agree.
    let folders: &[&str] = if case.random.chance(2) { &FOLDERS } else { &[case.random.pick(&FOLDERS)] };
    let kind = case.random.below(6);
    let data = data(case);
    case.note(format!("{folders:?}: {size:?}, kind {kind}"));
    for folder in folders {
        let path = data.join("training").join(folder).join("000000_10.png");
        let image = image::open(&path).expect("an image").resize_exact(size.0, size.1, image::imageops::Nearest);
        let is_truth = *folder == "disp_occ_0";
        let image = match kind {
            0 => DynamicImage::ImageLuma16(image.to_luma16()),
            1 => DynamicImage::ImageRgba8(image.to_rgba8()),
            2 => DynamicImage::ImageRgb16(image.to_rgb16()),
            3 if !is_truth => DynamicImage::ImageLuma8(image.to_luma8()),
            4 => DynamicImage::ImageLumaA8(image.to_luma_alpha8()),
            _ => image,
        };
        fs::write(path, encoded(&image, ImageFormat::Png)).expect("written");
    }
    let ended = run(case);
    judge(&ended, || whole(case))
}

/// A JPEG under the name of a PNG, whole or spoilt.
pub(crate) fn jpegs(case: &mut Case<'_>) -> Verdict {
    let (path, bytes) = an_image(case);
    let image = image::load_from_memory(&bytes).expect("an image");
    let mut jpeg = encoded(&DynamicImage::ImageRgb8(image.to_rgb8()), ImageFormat::Jpeg);
    match case.random.below(3) {
        0 => {}
        1 => drop(case.random.flip(&mut jpeg)),
        _ => jpeg.truncate(case.random.below(bytes.len())),
    }
    fs::write(path, jpeg).expect("written");
    let ended = run(case);
    judge(&ended, || whole(case))
}

/// A small file that says it is a huge image.
pub(crate) fn bombs(case: &mut Case<'_>) -> Verdict {
    let (path, _) = an_image(case);
    let sides = [0, 1, 20_000, 65_535, 1 << 20, 0x7fff_ffff, 0x8000_0000, u32::MAX];
    let (width, height) = (case.random.pick(&sides), case.random.pick(&sides));
    let (depth, colour) = case.random.pick(&[(8_u8, 2_u8), (8, 0), (16, 0), (16, 2), (8, 6), (1, 3), (3, 9)]);
    case.note(format!("{width}x{height}, {depth} bits, colour {colour}"));
    let mut header = Vec::new();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([depth, colour, 0, 0, case.random.below(2) as u8]);
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    // An empty stream of zlib.
    for (name, body) in [(b"IHDR", &header[..]), (b"IDAT", &[0x78, 0x9c, 3, 0, 0, 0, 0, 1]), (b"IEND", &[])] {
        png.extend((body.len() as u32).to_be_bytes());
        png.extend(name);
        png.extend(body);
        png.extend(crc32(&[name, body].concat()).to_be_bytes());
    }
    fs::write(path, png).expect("written");
    let ended = run(case);
    judge(&ended, || Verdict::different("a bomb was taken for an image"))
}

pub(crate) fn calibrations(case: &mut Case<'_>) -> Verdict {
    let path = data(case).join("training/calib_cam_to_cam/000000.txt");
    let text = fs::read_to_string(&path).expect("a calibration");
    let numbers = [
        "nan",
        "inf",
        "-inf",
        "1e300",
        "1e-300",
        "0",
        "-1",
        "1e999",
        "",
        "7,5",
        "0x10",
        "\u{663}",
        "--1",
        "1e",
        "9".repeat(400).as_str(),
    ]
    .map(str::to_owned);
    let words: Vec<&str> = text.split(' ').collect();
    let at = case.random.below(words.len());
    let mut changed: Vec<String> = words.iter().map(|&word| word.to_owned()).collect();
    match case.random.below(4) {
        0 => drop(changed.remove(at)),
        1 => changed.truncate(at),
        _ => changed[at] = numbers[case.random.below(numbers.len())].clone(),
    }
    let mut bytes = changed.join(" ").into_bytes();
    if case.random.chance(4) && !bytes.is_empty() {
        case.random.flip(&mut bytes);
    }
    fs::write(path, bytes).expect("written");
    let ended = run(case);
    judge(&ended, || whole(case))
}

/// The data set, copied into the case's folder.
fn data(case: &Case<'_>) -> PathBuf {
    let copy = case.at("data");
    copy_folder(&case.ground.data().0, &copy);
    copy
}

/// One image of the copied data set, and its bytes.
fn an_image(case: &mut Case<'_>) -> (PathBuf, Vec<u8>) {
    let folder = case.random.pick(&FOLDERS);
    let frame = case.random.below(2);
    let path = data(case).join("training").join(folder).join(format!("{frame:06}_10.png"));
    case.note(format!("{folder}, frame {frame}"));
    let bytes = fs::read(&path).expect("an image");
    (path, bytes)
}

fn run(case: &mut Case<'_>) -> Ended {
    case.write("experiment.yaml", DATA);
    let mut arguments = RUN.to_vec();
    if case.random.chance(2) {
        arguments.push("--keep-going");
    }
    case.run(&mut case.depthloom(&arguments))
}

fn run_and_compare(case: &mut Case<'_>) -> Verdict {
    let ended = run(case);
    let answer = Answer::new(&ended, &case.at("run")).without_recording();
    let undamaged = case.ground.data().1.clone().without_recording();
    judge(&ended, || match undamaged.difference(&answer) {
        None => Verdict::Equal,
        Some(difference) => Verdict::Different(difference),
    })
}

/// That a run that succeeded left everything.
fn whole(case: &Case<'_>) -> Verdict {
    let missing =
        ["recording.mcap", "scores.csv", "table.csv"].iter().find(|name| !case.at("run").join(name).is_file());
    missing.map_or(Verdict::Equal, |name| Verdict::different(format!("exit 0 without {name}")))
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("an image can be encoded");
    bytes.into_inner()
}

/// The checksum of PNG (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}
