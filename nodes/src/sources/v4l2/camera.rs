//! The kind `camera/v4l2`.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use depthloom_graphs::contracts::{
    DataPath, Frame, NextFrame, Source, SourceDeclaration, SourceKind, SourceOutputs, StreamFrame, StreamingSource,
};
use depthloom_graphs::values::{Image, Pixels};
use depthloom_graphs::{Fault, Key, Outputs, Port, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::device::{Inbox, RawImage, Receiver, monotonic};
use super::pairing::{Captured, Pairing, Sequence};
use super::pixels::{PixelFormat, halves};
use crate::content_key;
use crate::sources::calibration::camera_files::{self, CameraPair, FORMS};
use crate::sources::calibration::rectifier::{LatestRectifier, RectifyOptions};
use crate::sources::dataset::folders::existing_file;
use crate::sources::dataset::image_port;
use crate::sources::files::image_file;

const KIND: &str = "camera/v4l2";
const VERSION: u32 = 1;

/// What one image of `device` contains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Layout {
    /// The left image in the left half, the right image in the right half.
    #[default]
    SideBySide,
}

/// Parameters of `camera/v4l2`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct V4l2Params {
    /// Device of a stereo camera that sends both images as one: `/dev/video0`.
    pub device: Option<String>,
    /// What one image of `device` contains.
    pub layout: Layout,
    /// Device of the left camera, instead of `device`.
    pub left: Option<String>,
    /// Device of the right camera, instead of `device`.
    pub right: Option<String>,
    /// Columns of an image that a device sends, px: with `device`, of both images together.
    #[schemars(range(min = 2, max = 16384))]
    pub width: u32,
    /// Rows of an image, px.
    #[schemars(range(min = 1, max = 16384))]
    pub height: u32,
    /// Images per second.
    #[schemars(range(min = 1, max = 1000))]
    pub rate: u32,
    /// Pixel format in which a device sends images: `yuyv`, `mjpg` or `grey`.
    pub format: PixelFormat,
    /// Exposure time, milliseconds; by default the camera chooses it.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 10_000))]
    pub exposure_ms: Option<f64>,
    /// Calibration files as in `images`: OpenCV's FileStorage (one file or two), two `camera_info` YAML files of ROS
    /// (left, right), or a camchain of Kalibr. Without them there is no output `calibration`.
    pub calibration: Vec<DataPath>,
    /// Length of one unit of translation in the calibration files, metres: 0.001 for millimetres.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub metres_per_unit: Option<f64>,
    /// Whether the images are already rectified. If so, only the projections of the calibration files are used.
    pub rectified: bool,
    /// Time limit for an image, seconds.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 86_400, "operational" = true))]
    pub timeout_s: f64,
}

impl Default for V4l2Params {
    fn default() -> Self {
        Self {
            device: None,
            layout: Layout::SideBySide,
            left: None,
            right: None,
            width: 1280,
            height: 480,
            rate: 30,
            format: PixelFormat::Yuyv,
            exposure_ms: None,
            calibration: Vec::new(),
            metres_per_unit: None,
            rectified: false,
            timeout_s: 5.0,
        }
    }
}

/// The kind `camera/v4l2`.
pub(crate) struct V4l2;

impl SourceKind for V4l2 {
    type Params = V4l2Params;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "A stereo camera of Linux (Video4Linux): one device with both images, or two devices.",
            doc: "\
This kind needs a depthloom that was compiled with the feature `v4l2`. `depthloom live` runs it.\n\n\
**Devices.** `device` sends both images side by side. `left` and `right` are two devices: images that were captured at \
most half a period apart are a pair. Images without a partner, and images that a driver lost, count as missed. The \
time stamps are those of the drivers.\n\n\
**Pixels.** YUYV becomes RGB as OpenCV converts it (BT.601, limited range), and JPEG as libjpeg-turbo decodes it.\n\n\
**Calibration** and rectification are those of `images`.",
            outputs: ports(true),
        }
    }

    fn check(params: &V4l2Params) -> Result<(), (&'static str, String)> {
        match (&params.device, &params.left, &params.right) {
            (Some(_), None, None) if params.width % 2 == 1 => {
                let what = format!("width is {}, and a side-by-side image has an even number of columns", params.width);
                Err(("width", what))
            }
            (Some(_), None, None) | (None, Some(_), Some(_)) => Ok(()),
            (Some(_), ..) => {
                Err(("device", "device cannot be combined with `left` and `right`: use one of the two".to_owned()))
            }
            _ => Err(("device", "device is missing: set `device: /dev/video0`, or `left` and `right`".to_owned())),
        }
    }

    fn outputs(params: &V4l2Params) -> Result<Vec<Port>, Fault> {
        Ok(ports(!params.calibration.is_empty()))
    }

    fn open(_: V4l2Params) -> Result<Box<dyn Source>, Fault> {
        Err(Fault::new("the frames of a camera cannot be listed: each arrives once").remedy(
            "run the experiment with `depthloom live`; its recording is then the source of other runs (`kind: mcap`)",
        ))
    }

    fn stream(params: V4l2Params) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
        Ok(Some(Box::new(Camera::new(params)?)))
    }
}

fn ports(has_calibration: bool) -> Vec<Port> {
    let mut ports = vec![
        image_port("left", "Left image, 8 bit, rectified if there is a calibration."),
        image_port("right", "Right image, 8 bit, same size as `left`."),
    ];
    if has_calibration {
        let doc = "Focal length, principal point, baseline of the rectified pair; with the parameter `calibration`.";
        ports.push(Port::frame("calibration", ValueType::Calibration, doc));
    }
    ports
}

struct Camera {
    params: V4l2Params,
    key: Key,
    calibration: Option<(CameraPair, String)>,
    rectifier: LatestRectifier,
    receivers: Vec<Receiver>,
    inbox: Arc<Inbox>,
    images: Images,
    /// The number of the next frame if none is lost.
    next: u64,
    /// Since the last frame: pairs that could not be decoded.
    broken: u64,
    warnings: Vec<String>,
    /// When the stream fails if no frame arrives.
    limit: Instant,
}

/// Images of the devices that do not form a frame yet.
enum Images {
    SideBySide { waiting: VecDeque<RawImage>, sequence: Sequence },
    Pairs(Pairing<Vec<u8>>),
}

/// The images of one frame: one with both, or two.
struct Raw {
    images: Vec<RawImage>,
    missed: u64,
}

impl Images {
    fn add(&mut self, camera: usize, image: RawImage) {
        match self {
            Self::SideBySide { waiting, .. } => waiting.push_back(image),
            Self::Pairs(pairing) => pairing.add(camera, image),
        }
    }

    fn next(&mut self) -> Option<Raw> {
        match self {
            Self::SideBySide { waiting, sequence } => {
                let image = waiting.pop_front()?;
                Some(Raw { missed: sequence.gap(image.sequence), images: vec![image] })
            }
            Self::Pairs(pairing) => {
                let (pair, missed) = pairing.next()?;
                Some(Raw { images: pair.into(), missed })
            }
        }
    }
}

impl Camera {
    fn new(params: V4l2Params) -> Result<Self, Fault> {
        let (calibration, content) = calibration(&params.calibration)?;
        let meaning = format!("{:?} {:?} {:?}", params.metres_per_unit, params.rectified, params.layout);
        let key =
            content.iter().fold(Key::build(KIND).number(VERSION.into()).text(&meaning), |key, file| key.bytes(file));
        let inbox = Arc::<Inbox>::default();
        let devices: Vec<&String> = match &params.device {
            Some(device) => vec![device],
            None => params.left.iter().chain(&params.right).collect(),
        };
        let start = |(camera, path): (usize, &&String)| Receiver::start(path, camera, &params, &inbox);
        let receivers = devices.iter().enumerate().map(start).collect::<Result<Vec<_>, Fault>>()?;
        let images = match params.device {
            Some(_) => Images::SideBySide { waiting: VecDeque::new(), sequence: Sequence::default() },
            None => Images::Pairs(Pairing::new(Duration::from_secs(1) / params.rate)),
        };
        Ok(Self {
            limit: Instant::now() + Duration::from_secs_f64(params.timeout_s),
            key: key.finish(),
            calibration,
            rectifier: LatestRectifier::default(),
            receivers,
            inbox,
            images,
            next: 0,
            broken: 0,
            warnings: Vec::new(),
            params,
        })
    }

    fn decode(&self, raw: &[RawImage]) -> Result<[Pixels; 2], String> {
        let size = (self.params.width, self.params.height);
        let decode =
            |(image, receiver): (&RawImage, &Receiver)| self.params.format.decode(&image.item, size, receiver.stride);
        let pixels = raw.iter().zip(&self.receivers).map(decode).collect::<Result<Vec<_>, String>>()?;
        match <[Pixels; 2]>::try_from(pixels) {
            Ok(pair) => Ok(pair),
            Err(one) => halves(&one[0]),
        }
    }

    fn outputs(&self, [left, right]: [Pixels; 2]) -> Result<Outputs, Fault> {
        let (mut left, mut right) = (Image::new(left), Image::new(right));
        let Some((cameras, files)) = &self.calibration else {
            return Ok(Outputs::none().with("left", left).with("right", right));
        };
        let options = RectifyOptions {
            rectified: self.params.rectified,
            metres_per_unit: self.params.metres_per_unit,
            ..RectifyOptions::default()
        };
        let rectifier = self
            .rectifier
            .get(cameras, &options, left.dimensions())
            .map_err(|error| Fault::Failed(error).map_what(|what| format!("{files}: {what}")))?;
        (left, right) = rectifier.pair(left, right);
        Ok(Outputs::none().with("left", left).with("right", right).with("calibration", rectifier.calibration.clone()))
    }

    /// `None` if an image is damaged; it then counts as missed.
    fn frame(&mut self, raw: &Raw) -> Result<Option<StreamFrame>, Fault> {
        let pixels = match self.decode(&raw.images) {
            Ok(pixels) => pixels,
            Err(what) => {
                self.warnings.push(format!("an image of the camera is damaged and counts as missed: {what}"));
                self.broken += 1 + raw.missed;
                return Ok(None);
            }
        };
        let outputs = self.outputs(pixels)?;
        let missed = raw.missed + std::mem::take(&mut self.broken);
        let index = self.next + missed;
        self.next = index + 1;
        let at = raw.images.iter().map(|Captured { at, .. }| *at).min().unwrap_or_default();
        let age = monotonic().saturating_sub(at);
        let now = Instant::now();
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let time_ns = u64::try_from(since_epoch.saturating_sub(age).as_nanos()).unwrap_or(u64::MAX);
        let key = content_key::of_frame(KIND, &self.key, &outputs);
        Ok(Some(StreamFrame {
            frame: Frame { id: format!("{index:06}").into(), index, time_ns },
            read: SourceOutputs { outputs, key },
            captured: now.checked_sub(age).unwrap_or(now),
            missed,
        }))
    }
}

/// The calibration of the files with their names, and their content.
type ReadCalibration = (Option<(CameraPair, String)>, Vec<Arc<[u8]>>);

fn calibration(files: &[DataPath]) -> Result<ReadCalibration, Fault> {
    if files.is_empty() {
        return Ok((None, Vec::new()));
    }
    let paths = files.iter().map(|file| existing_file(file.path().to_owned(), FORMS));
    let paths = paths.collect::<Result<Vec<PathBuf>, Fault>>()?;
    let bytes = paths.iter().map(|path| image_file::read(path)).collect::<Result<Vec<_>, Fault>>()?;
    let texts: Vec<(&Path, &[u8])> =
        paths.iter().map(PathBuf::as_path).zip(bytes.iter().map(|bytes| &**bytes)).collect();
    let pair = camera_files::read(&texts, false)?;
    let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    Ok((Some((pair, names.join(", "))), bytes))
}

impl StreamingSource for Camera {
    fn next(&mut self, deadline: Instant) -> Result<NextFrame, Fault> {
        loop {
            while let Some(raw) = self.images.next() {
                if let Some(frame) = self.frame(&raw)? {
                    self.limit = Instant::now() + Duration::from_secs_f64(self.params.timeout_s);
                    return Ok(NextFrame::Captured(Box::new(frame)));
                }
            }
            let images = self.inbox.take(deadline.min(self.limit))?;
            let is_empty = images.iter().all(VecDeque::is_empty);
            for (camera, images) in images.into_iter().enumerate() {
                images.into_iter().for_each(|image| self.images.add(camera, image));
            }
            if !is_empty {
                continue;
            }
            if Instant::now() >= self.limit {
                let what = format!("the camera sent no frame within {} s", self.params.timeout_s);
                return Err(Fault::new(what).remedy("check its cable, or raise `timeout_s`"));
            }
            if Instant::now() >= deadline {
                return Ok(NextFrame::TimedOut);
            }
        }
    }

    fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }
}
