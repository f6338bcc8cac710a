//! Images: `sensor_msgs/msg/Image` and `CompressedImage`, `foxglove.RawImage` and `foxglove.CompressedImage`.
//! <https://docs.ros.org/en/rolling/p/sensor_msgs/>,
//! <https://docs.foxglove.dev/docs/visualization/message-schemas/raw-image>

use depthloom_codecs::wire_format::{Content, Fields};
use depthloom_graphs::ErrorMessage;
use depthloom_graphs::values::{Pixels, Raster};
use image::{GrayImage, RgbImage};

use crate::cdr::Cdr;
use crate::form::{Wire, frame, timestamp};
use crate::mosaic::Mosaic;
use crate::yuv::{self, Packed};
use crate::{Form, Header, Sort};

/// The encodings that are read as camera images.
const CAMERA: &str = "mono8, 8UC1, mono16, 16UC1, rgb8, bgr8, 8UC3 (as bgr8), rgba8, bgra8, rgb16, bgr16, bayer_rggb8 and variants, also with 16, \
                      uyvy (yuv422), yuyv (yuv422_yuy2), nv21";

/// Samples of 16 bits as 8: the upper 8 of all 16, or of the lowest `bits`; larger samples become white.
#[must_use]
pub fn eight_bits(samples: &[u16], bits: Option<u32>) -> Vec<u8> {
    let shift = bits.unwrap_or(16).clamp(8, 16) - 8;
    samples.iter().map(|sample| u8::try_from(sample >> shift).unwrap_or(u8::MAX)).collect()
}

/// The largest sample of a 16-bit image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Brightest(u16);

impl Brightest {
    /// The largest sample of an image; `None` if it is empty.
    #[must_use]
    pub fn from_samples(samples: &[u16]) -> Option<Self> {
        samples.iter().max().copied().map(Self)
    }

    /// A warning, if all samples fit in 12 bits: a camera of 10 or 12 bits has most likely stored them unshifted, and
    /// of the upper 8 of 16 bits at most 16 levels differ.
    #[must_use]
    pub const fn warning(self, bits: Option<u32>) -> Option<&'static str> {
        match (self.0, bits) {
            (1..4096, None) => Some(
                "16-bit images hold no sample above 4095, and their upper 8 bits are used: at most 16 grey levels remain. Give the camera's bits if they are \
                 fewer, for example `bits: 12` (sources `images` and `ros2/bag`)",
            ),
            _ => None,
        }
    }
}

/// A message with an image.
#[derive(Debug)]
pub struct ImageMessage<'a> {
    /// Capture time and frame of the camera.
    pub header: Header,
    /// The image.
    pub content: ImageContent<'a>,
}

/// An image as a message has it.
#[derive(Debug)]
pub enum ImageContent<'a> {
    /// Uncompressed.
    Raw(RawImage<'a>),
    /// A file's bytes, and what the message calls their format.
    Compressed(CompressedImage<'a>),
}

/// An uncompressed image.
#[derive(Debug)]
pub struct RawImage<'a> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What a pixel is: `mono8`, `16UC1`.
    pub encoding: &'a str,
    /// Bytes from a row to the next.
    pub step: u32,
    /// Whether numbers of several bytes have the highest first.
    pub is_big_endian: bool,
    /// The rows.
    pub data: &'a [u8],
}

/// An image as a file's bytes.
#[derive(Debug)]
pub struct CompressedImage<'a> {
    /// `jpeg`, `rgb8; png compressed bgr8`, `16UC1; compressedDepth png`.
    pub format: &'a str,
    /// The file.
    pub data: &'a [u8],
}

/// Reads a message of a topic of images.
pub fn image(form: Form, message: &[u8]) -> Result<ImageMessage<'_>, ErrorMessage> {
    match (form.sort, form.wire) {
        (Sort::Image, Wire::Cdr) => {
            let mut cdr = Cdr::new(message)?;
            let header = Header::cdr(&mut cdr)?;
            let (height, width) = (cdr.u32("height")?, cdr.u32("width")?);
            let encoding = cdr.text("encoding")?;
            let is_big_endian = cdr.u8("is_bigendian")? != 0;
            let step = cdr.u32("step")?;
            let data = cdr.bytes("data")?;
            let content = ImageContent::Raw(RawImage { width, height, encoding, step, is_big_endian, data });
            Ok(ImageMessage { header, content })
        }
        (Sort::CompressedImage, Wire::Cdr) => {
            let mut cdr = Cdr::new(message)?;
            let header = Header::cdr(&mut cdr)?;
            let (format, data) = (cdr.text("format")?, cdr.bytes("data")?);
            Ok(ImageMessage { header, content: ImageContent::Compressed(CompressedImage { format, data }) })
        }
        (Sort::Image, Wire::Protobuf) => {
            let mut raw = RawImage { width: 0, height: 0, encoding: "", step: 0, is_big_endian: false, data: &[] };
            let mut header = Header { stamp_ns: 0, frame_id: String::new() };
            for field in Fields(message) {
                match field.map_err(|error| ErrorMessage::new(error.to_string()))? {
                    (1, content) => header.stamp_ns = timestamp(content)?,
                    (2, content) => raw.width = content.fixed32(),
                    (3, content) => raw.height = content.fixed32(),
                    (4, content) => raw.encoding = text(content, "encoding")?,
                    (5, content) => raw.step = content.fixed32(),
                    (6, content) => raw.data = content.bytes(),
                    (7, content) => header.frame_id = frame(text(content, "frame_id")?),
                    _ => {}
                }
            }
            Ok(ImageMessage { header, content: ImageContent::Raw(raw) })
        }
        (Sort::CompressedImage, Wire::Protobuf) => {
            let mut image = CompressedImage { format: "", data: &[] };
            let mut header = Header { stamp_ns: 0, frame_id: String::new() };
            for field in Fields(message) {
                match field.map_err(|error| ErrorMessage::new(error.to_string()))? {
                    (1, content) => header.stamp_ns = timestamp(content)?,
                    (2, content) => image.data = content.bytes(),
                    (3, content) => image.format = text(content, "format")?,
                    (4, content) => header.frame_id = frame(text(content, "frame_id")?),
                    _ => {}
                }
            }
            Ok(ImageMessage { header, content: ImageContent::Compressed(image) })
        }
        (Sort::CameraInfo | Sort::PointCloud | Sort::Transforms, _) => Err(ErrorMessage::new("it is not an image")),
    }
}

pub(crate) fn text<'a>(content: Content<'a>, name: &str) -> Result<&'a str, ErrorMessage> {
    std::str::from_utf8(content.bytes()).map_err(|_| ErrorMessage::new(format!("`{name}` is not UTF-8")))
}

impl<'a> RawImage<'a> {
    /// Its rows, checked against the length of the message.
    fn rows(&self, bytes_per_pixel: usize) -> Result<impl Iterator<Item = &'a [u8]>, ErrorMessage> {
        self.planes(bytes_per_pixel, self.height)
    }

    /// The first `rows` rows of `data`. An image in several planes has more rows than its height.
    fn planes(&self, bytes_per_pixel: usize, rows: u32) -> Result<impl Iterator<Item = &'a [u8]>, ErrorMessage> {
        let Self { width, height, step, data, .. } = *self;
        if width == 0 || height == 0 {
            return Err(ErrorMessage::new(format!("its image is {width}x{height}")));
        }
        let row = width as usize * bytes_per_pixel;
        if (step as usize) < row {
            let what = format!("step is {step} bytes, and a row of {width} pixels of {} has {row}", self.encoding);
            return Err(ErrorMessage::new(what));
        }
        let wanted = u64::from(step) * u64::from(rows);
        if (data.len() as u64) < wanted {
            let what = format!("{rows} rows of {step} bytes are {wanted} bytes, and `data` has {}", data.len());
            return Err(ErrorMessage::new(what));
        }
        Ok(data.chunks_exact(step as usize).take(rows as usize).map(move |line| &line[..row]))
    }

    fn u16s(&self, channels: usize) -> Result<Vec<u16>, ErrorMessage> {
        let number = if self.is_big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
        Ok(self.rows(2 * channels)?.flat_map(|row| row.as_chunks::<2>().0).map(|sample| number(*sample)).collect())
    }

    /// Red, green and blue of each pixel, if colour differences are stored with brightness; `None` if they are not.
    fn yuv(&self) -> Result<Option<Vec<u8>>, ErrorMessage> {
        let Self { width, height, .. } = *self;
        let even = |side: u32, name: &str| match side % 2 {
            0 => Ok(()),
            _ => Err(ErrorMessage::new(format!(
                "{name} is {side}, and pixels of {} share colours in pairs",
                self.encoding
            ))),
        };
        if let Some(packed) = Packed::named(self.encoding) {
            even(width, "width")?;
            let pairs = self.rows(2)?.flat_map(|row| row.as_chunks::<4>().0);
            return Ok(Some(pairs.flat_map(|pair| packed.colours(*pair)).flatten().collect()));
        }
        if self.encoding != "nv21" {
            return Ok(None);
        }
        // Brightness of each pixel, then V and U of each square of four.
        even(width, "width")?;
        even(height, "height")?;
        let rows: Vec<&[u8]> = self.planes(1, height.saturating_add(height / 2))?.collect();
        let (brightness, colours) = rows.split_at(height as usize);
        let mut rgb = Vec::with_capacity(width as usize * height as usize * 3);
        for (y, row) in brightness.iter().enumerate() {
            let shared = colours[y / 2].as_chunks::<2>().0;
            rgb.extend(
                row.iter().enumerate().flat_map(|(x, own)| yuv::colour(*own, shared[x / 2][1], shared[x / 2][0])),
            );
        }
        Ok(Some(rgb))
    }

    /// The image of a camera, 8 bits per sample: grey or RGB. Of 16 bits the upper 8 are used, or those of the lowest
    /// `bits`; transparency is dropped. A sensor's mosaic and YUV become the colours that OpenCV's `cvtColor` gives.
    /// Beside it how bright a 16-bit image is.
    pub fn pixels(&self, bits: Option<u32>) -> Result<(Pixels, Option<Brightest>), ErrorMessage> {
        let size = (self.width, self.height);
        let grey = |samples| Pixels::Grey(GrayImage::from_raw(size.0, size.1, samples).expect("one byte per pixel"));
        let rgb = |rows: Vec<u8>| Pixels::Rgb(RgbImage::from_raw(size.0, size.1, rows).expect("three bytes per pixel"));
        let colours = |bytes: usize, [r, g, b]: [usize; 3]| {
            let rows = self.rows(bytes)?;
            let mut samples = Vec::with_capacity(size.0 as usize * size.1 as usize * 3);
            for row in rows {
                samples.extend(row.chunks_exact(bytes).flat_map(|pixel| [pixel[r], pixel[g], pixel[b]]));
            }
            Ok(rgb(samples))
        };
        if let Some(mosaic) = Mosaic::named(self.encoding) {
            let samples = match mosaic.bytes {
                1 => self.rows(1)?.flatten().copied().map(u16::from).collect(),
                _ => self.u16s(1)?,
            };
            let colours = mosaic.colours(&samples, size.0, size.1)?;
            return Ok(match mosaic.bytes {
                1 => (rgb(colours.into_iter().map(|sample| sample as u8).collect()), None),
                _ => (rgb(eight_bits(&colours, bits)), Brightest::from_samples(&samples)),
            });
        }
        if let Some(samples) = self.yuv()? {
            return Ok((rgb(samples), None));
        }
        let shallow = match self.encoding {
            "mono8" | "8UC1" => Ok(grey(self.rows(1)?.flatten().copied().collect())),
            "mono16" | "16UC1" => {
                let samples = self.u16s(1)?;
                return Ok((grey(eight_bits(&samples, bits)), Brightest::from_samples(&samples)));
            }
            "rgb16" | "bgr16" => {
                let samples: Vec<u16> = self.u16s(3)?;
                let mut narrow = eight_bits(&samples, bits);
                if self.encoding == "bgr16" {
                    narrow.as_chunks_mut::<3>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
                }
                return Ok((rgb(narrow), Brightest::from_samples(&samples)));
            }
            "rgb8" => colours(3, [0, 1, 2]),
            "bgr8" | "8UC3" => colours(3, [2, 1, 0]),
            "rgba8" => colours(4, [0, 1, 2]),
            "bgra8" => colours(4, [2, 1, 0]),
            other => {
                let malformed = ErrorMessage::new(format!("its encoding is `{other}`"));
                Err(malformed.remedy(match other {
                    "32FC1" | "64FC1" => "these are depths: expected a camera image; use `depth` for a topic of depths",
                    _ if other.starts_with("yuv") || other.starts_with("uyvy") || other.starts_with("nv") => {
                        "record the topic as bgr8 or mono8, as `image_proc` publishes it"
                    }
                    _ => {
                        return Err(ErrorMessage::new(format!("its encoding is `{other}`"))
                            .remedy(format!("these are read: {CAMERA}")));
                    }
                }))
            }
        };
        shallow.map(|pixels| (pixels, None))
    }

    /// Depths in metres, NaN where unknown (0, negative, infinite or NaN). `unit` is the length of one unit in metres;
    /// by default a millimetre of `16UC1`, a metre of `32FC1`, as REP 118 has it.
    pub fn depths(&self, unit_m: Option<f64>) -> Result<Raster<f32>, ErrorMessage> {
        let metres: Vec<f32> = match self.encoding {
            "16UC1" | "mono16" => {
                let unit_m = unit_m.unwrap_or(0.001);
                self.u16s(1)?.into_iter().map(|raw| depth_of(f64::from(raw) * unit_m)).collect()
            }
            "32FC1" => {
                let number = if self.is_big_endian { f32::from_be_bytes } else { f32::from_le_bytes };
                let unit_m = unit_m.unwrap_or(1.0);
                self.rows(4)?
                    .flat_map(|row| row.as_chunks::<4>().0)
                    .map(|raw| depth_of(f64::from(number(*raw)) * unit_m))
                    .collect()
            }
            other => {
                let what = format!("its encoding is `{other}`, and depths are 16UC1 (millimetres) or 32FC1 (metres)");
                return Err(
                    ErrorMessage::new(what).remedy("`depth` takes a topic of depths, registered to the left image")
                );
            }
        };
        Ok(Raster::from_raw(self.width, self.height, metres).expect("a depth a pixel"))
    }
}

fn depth_of(metres: f64) -> f32 {
    if metres > 0.0 && metres.is_finite() { metres as f32 } else { f32::NAN }
}

/// How `compressed_depth_image_transport` made a 16-bit PNG of depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthCoding {
    /// The numbers themselves, of 16 bits.
    Plain,
    /// Of floats their inverse: `A / (v - B)` metres.
    Inverse {
        /// A.
        a: f32,
        /// B.
        b: f32,
    },
}

impl DepthCoding {
    /// Metres of a PNG's number; see [`RawImage::depths`] for the unit.
    #[must_use]
    pub fn metres(self, raw: u16, unit_m: Option<f64>) -> f32 {
        match self {
            Self::Plain => depth_of(f64::from(raw) * unit_m.unwrap_or(0.001)),
            Self::Inverse { .. } if raw == 0 => f32::NAN,
            Self::Inverse { a, b } => depth_of(f64::from(a / (f32::from(raw) - b)) * unit_m.unwrap_or(1.0)),
        }
    }
}

impl<'a> CompressedImage<'a> {
    /// The image file of a camera, and whether its red and blue are exchanged: `image_transport` passes an image to
    /// OpenCV's encoder, which takes the first sample as blue, and writes the order of the samples after `compressed`.
    pub fn camera(&self) -> Result<(&'a [u8], bool), ErrorMessage> {
        let (encoding, how) = self.format.split_once(';').unwrap_or(("", self.format));
        if how.contains("compressedDepth") {
            return Err(ErrorMessage::new(format!("its format is `{}`: depths", self.format))
                .remedy("expected a camera image; use `depth` for a topic of depths"));
        }
        let handed = how.rsplit_once("compressed").map_or("", |(_, handed)| handed.trim());
        if handed.starts_with("bayer_") || handed.is_empty() && encoding.starts_with("bayer_") {
            return Err(ErrorMessage::new(format!("its format is `{}`", self.format)).remedy(
                "a sensor's mosaic is not read: take the topic in colour or grey that `image_proc` makes of it (image_rect_color, image_rect)",
            ));
        }
        Ok((self.data, handed == "rgb8"))
    }

    /// The 16-bit PNG of depths, and how they were made.
    pub fn depths(&self) -> Result<(&'a [u8], DepthCoding), ErrorMessage> {
        const REMEDY: &str =
            "depths are read of `16UC1; compressedDepth png`, `32FC1; compressedDepth png` and `16UC1; png compressed`";
        let refused = || ErrorMessage::new(format!("its format is `{}`", self.format)).remedy(REMEDY);
        let (encoding, how) = self.format.split_once(';').unwrap_or(("", self.format));
        if !how.contains("compressedDepth") {
            return if how.contains("png") { Ok((self.data, DepthCoding::Plain)) } else { Err(refused()) };
        }
        if how.contains("rvl") {
            return Err(refused());
        }
        // The format's number and two parameters.
        let Some(([_, _, _, _, a0, a1, a2, a3, b0, b1, b2, b3], png)) = self.data.split_first_chunk::<12>() else {
            return Err(ErrorMessage::new(format!("`data` of {} bytes holds no compressed depths", self.data.len())));
        };
        let (a, b) = (f32::from_le_bytes([*a0, *a1, *a2, *a3]), f32::from_le_bytes([*b0, *b1, *b2, *b3]));
        match encoding.trim() {
            "16UC1" | "mono16" => Ok((png, DepthCoding::Plain)),
            "32FC1" => Ok((png, DepthCoding::Inverse { a, b })),
            _ => Err(refused()),
        }
    }
}
