//! The input files of a sequence: images, ground truth, networks, texts that programs read. A file is a description, so
//! that a step can be printed.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::{GrayImage, ImageBuffer, ImageFormat, Luma};

use depthloom_test_needs::onnx_file::{F32, Tensor, model, model_with};
use depthloom_test_needs::random::Random;

/// Columns of all images.
pub(crate) const WIDTH: u32 = 64;
/// Rows of all images.
pub(crate) const HEIGHT: u32 = 32;

/// What a file contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// A texture, moved to the left.
    Image { seed: u32, shift: u32 },
    /// One depth, in 1/256 m.
    Truth { depth: u16 },
    /// A number as text.
    Text(u32),
    /// An NPY array of small maps, one per index of a frame, that begins with this number.
    Maps(u32),
    /// A network of one operator.
    Network(Network),
    /// A node in Python that imports the module.
    PythonNode,
    /// The module, with a number.
    PythonModule(u32),
}

/// Networks of one operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Network {
    /// The mean of an image's channels.
    Mean,
    /// The maximum of an image's channels.
    Maximum,
    /// The mean of the channels of a pair's left image.
    MeanOfPair,
    /// The maximum of the channels of a pair's left image.
    MaximumOfPair,
}

/// Files by their path.
pub(crate) type Files = BTreeMap<String, Content>;

/// Roots of the image data sets.
pub(crate) const ROOTS: [&str; 2] = ["data-a", "data-b"];
/// The array of `depth/files` and `disparity/files`.
pub(crate) const MAPS: &str = "maps.npy";
/// Texts that programs read.
pub(crate) const TEXTS: [&str; 3] = ["gain-a.txt", "gain-b.txt", NEVER_REUSED];
/// The text that only programs with neither `version` nor `code` read.
pub(crate) const NEVER_REUSED: &str = "gain-c.txt";

/// The module that nodes in Python import.
pub(crate) const MODULE: &str = "package/module.py";
const PYTHON_NODE: &str = "import depthloom
from package.module import FACTOR

@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})
def own(depth):
    return depth * FACTOR

depthloom.serve(own)
";

/// The files that a sequence begins with.
pub(crate) fn first(random: &mut Random, has_python: bool) -> Files {
    let mut files = Files::new();
    if has_python {
        files.insert("node.py".to_owned(), Content::PythonNode);
        files.insert(MODULE.to_owned(), Content::PythonModule(2));
    }
    for root in ROOTS {
        for frame in 0..3 {
            add_pair(&mut files, root, frame, random);
        }
    }
    // Of some frames of each source; of others they are missing.
    for frame in ["000000_10", "000002_10", "000", "001", "f1"] {
        files.insert(format!("predictions/{frame}.txt"), Content::Text(random.below(100) as u32));
    }
    for text in TEXTS {
        files.insert(text.to_owned(), Content::Text(random.below(100) as u32));
    }
    files.insert(MAPS.to_owned(), Content::Maps(random.below(100) as u32));
    let networks = [
        ("net-a.onnx", Network::Mean),
        ("net-b.onnx", Network::Maximum),
        ("pair-a.onnx", Network::MeanOfPair),
        ("pair-b.onnx", Network::MaximumOfPair),
    ];
    files.extend(networks.map(|(name, network)| (name.to_owned(), Content::Network(network))));
    files
}

/// Adds both images and the ground truth of a frame.
pub(crate) fn add_pair(files: &mut Files, root: &str, frame: usize, random: &mut Random) {
    let seed = random.below(1000) as u32;
    let shift = 2 + random.below(8) as u32;
    files.insert(format!("{root}/left/{frame:03}.png"), Content::Image { seed, shift: 0 });
    files.insert(format!("{root}/right/{frame:03}.png"), Content::Image { seed, shift });
    files.insert(format!("{root}/truth/{frame:03}.png"), Content::Truth { depth: (5120 / shift) as u16 });
}

/// A texture that stereo can match.
pub(crate) fn texture(seed: u32, x: u32, y: u32) -> u8 {
    let mixed = (y * 4096 + x / 2).wrapping_add(seed.wrapping_mul(77_777)).wrapping_mul(2_654_435_761);
    ((mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519) >> 24) as u8
}

/// 64 maps of 2x2 bytes.
fn maps(first: u32) -> Vec<u8> {
    let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (64, 2, 2), }\n";
    let numbers = (0..64 * 4).map(|at| (1 + (first + at) % 60) as u8);
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes()].concat().into_iter().chain(numbers).collect()
}

impl Content {
    fn bytes(self) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        match self {
            Self::Image { seed, shift } => {
                let image = GrayImage::from_fn(WIDTH, HEIGHT, |x, y| Luma([texture(seed, x + shift, y)]));
                image.write_to(&mut bytes, ImageFormat::Png).expect("PNG in memory");
            }
            Self::Truth { depth } => {
                let image = ImageBuffer::from_pixel(WIDTH, HEIGHT, Luma([depth]));
                image.write_to(&mut bytes, ImageFormat::Png).expect("PNG in memory");
            }
            Self::PythonNode => return PYTHON_NODE.as_bytes().to_vec(),
            Self::PythonModule(number) => return format!("FACTOR = {number}\n").into_bytes(),
            Self::Text(number) => return number.to_string().into_bytes(),
            Self::Maps(first) => return maps(first),
            Self::Network(network) => return network.bytes(),
        }
        bytes.into_inner()
    }
}

impl Network {
    fn bytes(self) -> Vec<u8> {
        let (width, height) = (i64::from(WIDTH), i64::from(HEIGHT));
        let image = |name| Tensor(name, F32, &[1, 3, 32, 64]);
        let map = Tensor("map", F32, &[1, 1, 32, 64]);
        assert_eq!((width, height), (64, 32), "networks are of the images' size");
        match self {
            Self::Mean => model("ReduceMean", Some(1), &[image("image")], &map),
            Self::Maximum => model_with("ReduceMax", &[("axes", &[1])], &[image("image")], &map),
            Self::MeanOfPair => model("ReduceMean", Some(1), &[image("left"), image("right")], &map),
            Self::MaximumOfPair => model_with("ReduceMax", &[("axes", &[1])], &[image("left"), image("right")], &map),
        }
    }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }
}

/// Brings a folder from one state to the next: writes what differs and removes what is gone.
pub(crate) fn write(folder: &Path, before: &Files, files: &Files) -> std::io::Result<()> {
    for name in before.keys().filter(|name| !files.contains_key(*name)) {
        fs::remove_file(folder.join(name))?;
    }
    for (name, content) in files.iter().filter(|(name, content)| before.get(*name) != Some(*content)) {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::write(path, content.bytes())?;
    }
    Ok(())
}

/// How the files of two states differ, one line per file.
pub(crate) fn differences(before: &Files, after: &Files) -> Vec<String> {
    let removed = before.keys().filter(|name| !after.contains_key(*name)).map(|name| format!("{name}: removed"));
    let changed = after.iter().filter(|(name, content)| before.get(*name) != Some(*content));
    removed.chain(changed.map(|(name, content)| format!("{name}: {content}"))).collect()
}
