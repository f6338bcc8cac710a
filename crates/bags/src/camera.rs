//! Cameras: `sensor_msgs/msg/CameraInfo`, `foxglove.CameraCalibration`.

use depthloom_codecs::wire_format::{Content, Fields};
use depthloom_graphs::ErrorMessage;

use crate::cdr::Cdr;
use crate::form::{Wire, frame, timestamp};
use crate::images::text;
use crate::{Form, Header, Sort};

/// The calibration of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// Time and coordinate frame.
    pub header: Header,
    /// Columns of the calibrated image.
    pub width: u32,
    /// Its rows.
    pub height: u32,
    /// `plumb_bob`, `rational_polynomial`, `equidistant`.
    pub distortion_model: String,
    /// The distortion's coefficients, of the raw image.
    pub d: Vec<f64>,
    /// 3x3, row-major: the raw image's intrinsics.
    pub k: [f64; 9],
    /// 3x3: from the camera to its rectified form.
    pub r: [f64; 9],
    /// 3x4: from rectified coordinates (metres) to the rectified image (px).
    pub p: [f64; 12],
    /// How many columns and rows of the sensor are one of the image; 0 and 1 are the same.
    binning: [u32; 2],
    /// The captured part of the calibrated image: column, row, width, height; all if the size is 0.
    part: [u32; 4],
}

/// Reads a message of a topic of cameras.
pub fn camera_info(form: Form, message: &[u8]) -> Result<CameraInfo, ErrorMessage> {
    match (form.sort, form.wire) {
        (Sort::CameraInfo, Wire::Cdr) => {
            let mut cdr = Cdr::new(message)?;
            let header = Header::cdr(&mut cdr)?;
            let (height, width) = (cdr.u32("height")?, cdr.u32("width")?);
            let distortion_model = cdr.text("distortion_model")?.to_owned();
            let d = cdr.f64_sequence("d")?;
            let (k, r, p) = (cdr.f64s("k")?, cdr.f64s("r")?, cdr.f64s("p")?);
            let binning = [cdr.u32("binning_x")?, cdr.u32("binning_y")?];
            let [x, y] = [cdr.u32("roi.x_offset")?, cdr.u32("roi.y_offset")?];
            let [h, w] = [cdr.u32("roi.height")?, cdr.u32("roi.width")?];
            Ok(CameraInfo { header, width, height, distortion_model, d, k, r, p, binning, part: [x, y, w, h] })
        }
        (Sort::CameraInfo, Wire::Protobuf) => protobuf(message),
        _ => Err(ErrorMessage::new("it is not a camera info")),
    }
}

fn protobuf(message: &[u8]) -> Result<CameraInfo, ErrorMessage> {
    let mut header = Header { stamp_ns: 0, frame_id: String::new() };
    let (mut width, mut height, mut distortion_model) = (0, 0, String::new());
    let mut matrices: [Vec<f64>; 4] = Default::default();
    for field in Fields(message) {
        match field.map_err(|error| ErrorMessage::new(error.to_string()))? {
            (1, content) => header.stamp_ns = timestamp(content)?,
            (2, content) => width = content.fixed32(),
            (3, content) => height = content.fixed32(),
            (4, content) => distortion_model = text(content, "distortion_model")?.to_owned(),
            (field @ 5..=8, content) => {
                let numbers = &mut matrices[field as usize - 5];
                match content {
                    Content::Fixed64(bits) => numbers.push(f64::from_bits(bits)),
                    content => numbers
                        .extend(content.bytes().as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes))),
                }
            }
            (9, content) => header.frame_id = frame(text(content, "frame_id")?),
            _ => {}
        }
    }
    let [d, k, r, p] = matrices;
    // What is left out is empty: no matrix.
    let r = if r.is_empty() { vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] } else { r };
    Ok(CameraInfo {
        header,
        width,
        height,
        distortion_model,
        d,
        k: matrix(&k, "K")?,
        r: matrix(&r, "R")?,
        p: matrix(&p, "P")?,
        binning: [1, 1],
        part: [0; 4],
    })
}

fn matrix<const N: usize>(numbers: &[f64], name: &str) -> Result<[f64; N], ErrorMessage> {
    numbers
        .try_into()
        .map_err(|_| ErrorMessage::new(format!("{name} holds {} numbers where it has {N}", numbers.len())))
}

impl CameraInfo {
    /// Columns and rows of the images it is of.
    #[must_use]
    pub fn image_size(&self) -> (u32, u32) {
        let [bx, by] = self.binning.map(|binning| binning.max(1));
        let [_, _, width, height] = self.part;
        if width == 0 || height == 0 { (self.width / bx, self.height / by) } else { (width / bx, height / by) }
    }

    /// P of the images as recorded: of the captured part, binned, as ROS' `image_geometry` has it.
    #[must_use]
    pub fn projection(&self) -> [f64; 12] {
        let [bx, by] = self.binning.map(|binning| f64::from(binning.max(1)));
        let [x, y, _, _] = self.part.map(f64::from);
        let mut p = self.p;
        p[2] -= x;
        p[6] -= y;
        p[..4].iter_mut().for_each(|of| *of /= bx);
        p[4..8].iter_mut().for_each(|of| *of /= by);
        p
    }

    /// K of the images as they are, likewise.
    #[must_use]
    pub fn intrinsics(&self) -> [f64; 9] {
        let [bx, by] = self.binning.map(|binning| f64::from(binning.max(1)));
        let [x, y, _, _] = self.part.map(f64::from);
        let mut k = self.k;
        k[2] -= x;
        k[5] -= y;
        k[..3].iter_mut().for_each(|of| *of /= bx);
        k[3..6].iter_mut().for_each(|of| *of /= by);
        k
    }

    /// Whether it is of a camera whose raw image is rectified as it is: no distortion, no rotation, P as K.
    #[must_use]
    pub fn is_rectified(&self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(1.0);
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let p = [self.p[0], self.p[1], self.p[2], self.p[4], self.p[5], self.p[6], self.p[8], self.p[9], self.p[10]];
        let is_zero = |numbers: &[f64]| numbers.iter().all(|number| *number == 0.0);
        self.d.iter().all(|of| *of == 0.0)
            // Missing rotation or raw calibration does not contradict rectified images.
            && (is_zero(&self.r) || self.r.iter().zip(identity).all(|(a, b)| near(*a, b)))
            && (is_zero(&self.k) || self.k.iter().zip(p).all(|(a, b)| near(*a, b)))
    }

    /// By how much R turns, degrees.
    #[must_use]
    pub fn rotation_degrees(&self) -> f64 {
        let trace = self.r[0] + self.r[4] + self.r[8];
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
    }
}
