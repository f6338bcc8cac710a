//! `ros2/bag`: the values of a frame from its messages.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use depthloom_bags::camera::{CameraInfo, camera_info};
use depthloom_bags::images::{self, ImageContent, ImageMessage};
use depthloom_bags::points::point_cloud;
use depthloom_bags::transforms::{Motion, Transforms, compose};
use depthloom_bags::{Form, Sort, message_fault};
use depthloom_graphs::ErrorMessage;
use depthloom_graphs::values::{Calibration, Depth, Image, Pixels, Raster};
use depthloom_graphs::{Context, Fault, Key, Outputs};
use depthloom_kernels::rectify::{Camera, Interpolation, Map, View};
use depthloom_kernels::velodyne::{Rule, depth_from_points};
use depthloom_threads::locked;

use crate::shape::filled;
use crate::sources::calibration::camera_files::lens;
use crate::sources::calibration::rectified_pair;
use crate::sources::calibration::rectifier::rectified;
use crate::sources::files::image_file;
use crate::sources::ros2_bag::params::{KIND, PointRotation, Ros2BagParams, VERSION};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Left,
    Right,
    LeftInfo,
    RightInfo,
    Depth,
    Points,
}

impl Part {
    pub(super) const fn is_camera(self) -> bool {
        matches!(self, Self::LeftInfo | Self::RightInfo)
    }

    pub(super) const fn parameter(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::LeftInfo => "left_info",
            Self::RightInfo => "right_info",
            Self::Depth => "depth",
            Self::Points => "points",
        }
    }

    pub(super) fn fits(self, sort: Sort) -> bool {
        match self {
            Self::Left | Self::Right | Self::Depth => sort.is_image(),
            Self::LeftInfo | Self::RightInfo => sort == Sort::CameraInfo,
            Self::Points => sort == Sort::PointCloud,
        }
    }

    pub(super) const fn wanted(self) -> &'static str {
        match self {
            Self::Left | Self::Right | Self::Depth => "images",
            Self::LeftInfo | Self::RightInfo => "camera infos",
            Self::Points => "point clouds",
        }
    }
}

/// R below this angle is not worth a warning, degrees: a sixth of a pixel at 1000 px.
const REPORTED_TURN_DEGREES: f64 = 0.01;

#[derive(Debug)]
pub(super) struct Messages {
    parts: Vec<(Part, Arc<[u8]>)>,
    stamp: Arc<str>,
}

impl Messages {
    pub(super) fn new(parts: Vec<(Part, Arc<[u8]>)>, stamp: &Arc<str>) -> Self {
        Self { parts, stamp: Arc::clone(stamp) }
    }

    fn get(&self, part: Part) -> Option<&[u8]> {
        self.parts.iter().find(|(other, _)| *other == part).map(|(_, bytes)| &**bytes)
    }

    fn the(&self, part: Part) -> Result<&[u8], Fault> {
        self.get(part).ok_or_else(|| Fault::new(format!("the frame has no message of its part `{}`", part.parameter())))
    }
}

struct Read {
    part: Part,
    topic: String,
    form: Form,
}

/// The maps, and the numbers that they were computed from.
type Maps = (Vec<u64>, Arc<[Map; 2]>);

pub(super) struct Reading {
    path: PathBuf,
    topics: Vec<Read>,
    rectified: Option<bool>,
    bits: Option<u32>,
    baseline_m: Option<f64>,
    depth_unit_m: Option<f64>,
    points_rotation: PointRotation,
    transforms: Option<Transforms>,
    beside: [Option<String>; 2],
    /// Of the latest calibration: most bags have one.
    maps: Mutex<Option<Maps>>,
}

impl Reading {
    pub(super) fn new(
        params: &Ros2BagParams,
        topics: impl Iterator<Item = (Part, String, Form)>,
        beside: [Option<String>; 2],
        transforms: Option<Transforms>,
    ) -> Self {
        Self {
            path: params.path.path().to_owned(),
            topics: topics.map(|(part, topic, form)| Read { part, topic, form }).collect(),
            rectified: params.rectified,
            bits: params.bits,
            baseline_m: params.baseline_m,
            depth_unit_m: params.depth_unit_m,
            points_rotation: params.points_rotation,
            transforms,
            beside,
            maps: Mutex::default(),
        }
    }

    pub(super) fn key(&self, messages: &Messages) -> Key {
        let mut key = Key::build(KIND).number(VERSION.into());
        let float = |number: Option<f64>| number.map_or(u64::MAX, f64::to_bits);
        let rectified = self.rectified.map_or(2, u64::from);
        key = key
            .number(rectified)
            .number(self.bits.map_or(u64::MAX, u64::from))
            .number(float(self.baseline_m))
            .number(float(self.depth_unit_m))
            .number(self.points_rotation as u64);
        for Read { part, topic, form } in &self.topics {
            let Some(bytes) = messages.get(*part) else { continue };
            // A topic's name matters only for whether its images are rectified.
            let says_rectified = depthloom_bags::topics::is_rectified(topic);
            key = key.text(part.parameter()).text(&format!("{form:?} {says_rectified}")).bytes(bytes);
        }
        if let Some(transforms) = &self.transforms {
            key = key.text(&format!("{transforms:?}"));
        }
        key.finish()
    }

    fn exchanged(&self, infos: [&String; 2]) -> &'static str {
        let [left, right] = [&self.beside[0], &self.beside[1]].map(Option::as_ref);
        if (left, right) == (Some(infos[0]), Some(infos[1])) {
            "the cameras are exchanged: exchange `left` and `right`, with their infos where these are named"
        } else if (left, right) == (Some(infos[1]), Some(infos[0])) {
            "`left_info` and `right_info` are exchanged: each belongs to the images of its camera"
        } else {
            "left and right are exchanged: exchange `left_info` and `right_info`, or, if these are the cameras' own, `left` and `right`"
        }
    }

    fn topic(&self, part: Part) -> Result<&Read, Fault> {
        let found = self.topics.iter().find(|topic| topic.part == part);
        found.ok_or_else(|| Fault::new(format!("the frame has no topic of its part `{}`", part.parameter())))
    }

    /// The left camera's info if the right camera lacks one and `baseline_m` is set.
    fn right_info(&self) -> Part {
        let has_own = self.topics.iter().any(|topic| topic.part == Part::RightInfo);
        if has_own { Part::RightInfo } else { Part::LeftInfo }
    }

    fn decoded<'a, T>(
        &self,
        messages: &'a Messages,
        part: Part,
        decode: impl FnOnce(Form, &'a [u8]) -> Result<T, ErrorMessage>,
    ) -> Result<T, Fault> {
        let Read { topic, form, .. } = self.topic(part)?;
        let what = if part.is_camera() { format!("of frame {}", messages.stamp) } else { messages.stamp.to_string() };
        decode(*form, messages.the(part)?).map_err(|error| message_fault(error, &self.path, topic, &what))
    }

    /// Finds faults of every frame in the first one, and warnings for all.
    pub(super) fn look_at(&self, messages: &Messages) -> Result<Vec<String>, Fault> {
        let mut warnings = Vec::new();
        let cameras = self.cameras(messages)?;
        let left = self.image_header(messages, Part::Left)?;
        self.image_header(messages, Part::Right)?;
        if self.topics.iter().any(|topic| topic.part == Part::Depth) && cameras.is_raw {
            warnings.push(
                "the images are rectified here, and the depths are taken as registered to the rectified left one"
                    .to_owned(),
            );
        }
        if messages.get(Part::Points).is_some() {
            self.projection(messages, &cameras, &left)?;
            let turn = cameras.infos[0].rotation_degrees();
            if !cameras.is_raw && self.points_rotation == PointRotation::Auto && turn > REPORTED_TURN_DEGREES {
                warnings.push(format!(
                    "R of {} turns by {turn:.2} degrees, and points are projected without it, as image_geometry does: `points_rotation: always` \
                     if the frame `{left}` is the camera's as it is mounted, `never` if it is the rectified camera's",
                    self.topic(Part::LeftInfo)?.topic
                ));
            }
        }
        Ok(warnings)
    }

    fn image_header(&self, messages: &Messages, part: Part) -> Result<String, Fault> {
        self.decoded(messages, part, |form, bytes| {
            let message = images::image(form, bytes)?;
            match &message.content {
                ImageContent::Raw(raw) => drop(raw.pixels(self.bits)?),
                ImageContent::Compressed(compressed) => drop(compressed.camera()?),
            }
            Ok(message.header.frame_id)
        })
    }

    pub(super) fn values(&self, messages: &Messages, ctx: &Context<'_>) -> Result<Outputs, Fault> {
        let cameras = self.cameras(messages)?;
        let (mut left, left_frame) = self.image(messages, Part::Left, ctx)?;
        let (mut right, _) = self.image(messages, Part::Right, ctx)?;
        let size = left.dimensions();
        if right.dimensions() != size {
            let (name, other) = (&self.topic(Part::Left)?.topic, &self.topic(Part::Right)?.topic);
            let ((w, h), (rw, rh)) = (size, right.dimensions());
            let what = format!("{name} is {w}x{h} and {other} is {rw}x{rh}: they must have the same size");
            return Err(self
                .fault(messages, what)
                .remedy("set `left` and `right` to topics of cameras with one resolution"));
        }
        for (info, part) in cameras.infos.iter().zip([Part::LeftInfo, self.right_info()]) {
            if info.image_size() != size {
                let ((w, h), (iw, ih)) = (size, info.image_size());
                let topic = &self.topic(part)?.topic;
                let what = format!("{topic} is of images of {iw}x{ih}, and the image is {w}x{h}");
                let remedy = "image and camera_info belong to one camera, of one resolution: name the right one with";
                return Err(self.fault(messages, what).remedy(format!("{remedy} `{}`", part.parameter())));
            }
        }
        if cameras.is_raw {
            let maps = self.maps(&cameras, size)?;
            left = rectified(&left, &maps[0]);
            right = rectified(&right, &maps[1]);
        }
        let calibration = cameras.calibration(size, self)?;
        let mut outputs = Outputs::one("left", left).with("right", right);
        if messages.get(Part::Depth).is_some() {
            outputs = outputs.with("depth", Depth { metres: self.depth(messages, size)? });
        }
        if messages.get(Part::Points).is_some() {
            let projection = self.projection(messages, &cameras, &left_frame)?;
            let points = self.decoded(messages, Part::Points, point_cloud)?;
            let points = points.points().map(|[x, y, z]| [x, y, z, 0.0]);
            let metres = filled(size, |out| {
                depth_from_points(points, &projection, (size.0 as usize, size.1 as usize), Rule::Nearest, out);
            });
            outputs = outputs.with("depth", Depth { metres });
        }
        Ok(outputs.with("calibration", calibration))
    }

    fn image(&self, messages: &Messages, part: Part, ctx: &Context<'_>) -> Result<(Image, String), Fault> {
        let ImageMessage { header, content } = self.decoded(messages, part, images::image)?;
        let topic = &self.topic(part)?.topic;
        let failed = |error: ErrorMessage| message_fault(error, &self.path, topic, &messages.stamp);
        let (image, brightest) = match content {
            ImageContent::Raw(raw) => {
                let (pixels, brightest) = raw.pixels(self.bits).map_err(failed)?;
                (Image::new(pixels), brightest)
            }
            ImageContent::Compressed(compressed) => {
                let (file, is_exchanged) = compressed.camera().map_err(failed)?;
                let (image, brightest) =
                    image_file::image_of_bits(&self.label(topic, messages), file.into(), self.bits)?;
                let image = match (is_exchanged, image.pixels()) {
                    (true, Pixels::Rgb(rgb)) => {
                        let mut rgb = rgb.clone();
                        rgb.pixels_mut().for_each(|pixel| pixel.0.swap(0, 2));
                        Image::new(Pixels::Rgb(rgb))
                    }
                    _ => image,
                };
                (image, brightest)
            }
        };
        if let Some(warning) = brightest.and_then(|brightest| brightest.warning(self.bits)) {
            ctx.host.warn(warning);
        }
        Ok((image, header.frame_id))
    }

    fn label(&self, topic: &str, messages: &Messages) -> PathBuf {
        format!("{}: message {} of {topic}", self.path.display(), messages.stamp).into()
    }

    fn fault(&self, messages: &Messages, what: impl std::fmt::Display) -> Fault {
        Fault::new(format!("{}: frame {}: {what}", self.path.display(), messages.stamp))
    }

    fn depth(&self, messages: &Messages, size: (u32, u32)) -> Result<Raster<f32>, Fault> {
        let message = self.decoded(messages, Part::Depth, images::image)?;
        let topic = &self.topic(Part::Depth)?.topic;
        let failed = |error: ErrorMessage| message_fault(error, &self.path, topic, &messages.stamp);
        let metres = match message.content {
            ImageContent::Raw(raw) => raw.depths(self.depth_unit_m).map_err(failed)?,
            ImageContent::Compressed(compressed) => {
                let (png, coding) = compressed.depths().map_err(failed)?;
                let raw = image_file::map_u16(&self.label(topic, messages), png, "metres")?;
                let metres = raw.iter().map(|raw| coding.metres(*raw, self.depth_unit_m)).collect();
                Raster::from_raw(raw.width(), raw.height(), metres).expect("a depth a pixel")
            }
        };
        if metres.dimensions() != size {
            let ((w, h), (dw, dh)) = (size, metres.dimensions());
            let what = format!("{topic} is {dw}x{dh}, and the left image {w}x{h}");
            return Err(self.fault(messages, what).remedy(
                "ground truth must be registered to the left image, pixel by pixel: record the driver's registered topic (aligned_depth_to_..., depth_registered)",
            ));
        }
        Ok(metres)
    }

    fn projection(&self, messages: &Messages, cameras: &Cameras, left_frame: &str) -> Result<Motion, Fault> {
        let cloud = self.decoded(messages, Part::Points, point_cloud)?.header.frame_id;
        let info = &cameras.infos[0];
        let camera = if left_frame.is_empty() { &info.header.frame_id } else { left_frame };
        let transforms = self.transforms.as_ref().ok_or_else(|| Fault::new("points without transforms"))?;
        let camera_from_points = transforms.between(camera, &cloud).map_err(|what| {
            let topic = &self.topic(Part::Points).map_or("points", |read| &read.topic);
            Fault::new(format!("{}: {topic} cannot be projected: {what}", self.path.display()))
                .remedy("record /tf_static too (latched, from the start): it must lead from the scanner's frame to the camera's optical one")
        })?;
        let rotation = match self.points_rotation {
            PointRotation::Always => true,
            PointRotation::Never => false,
            PointRotation::Auto => cameras.is_raw,
        };
        let [a, b, c, d, e, f, g, h, i] = if rotation { info.r } else { [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        let turned = compose(&[a, b, c, 0.0, d, e, f, 0.0, g, h, i, 0.0], &camera_from_points);
        Ok(compose(&info.projection(), &turned))
    }

    fn cameras(&self, messages: &Messages) -> Result<Cameras, Fault> {
        let left = self.decoded(messages, Part::LeftInfo, camera_info)?;
        let right = self.decoded(messages, self.right_info(), camera_info)?;
        let says_rectified = |part| self.topic(part).map(|read| depthloom_bags::topics::is_rectified(&read.topic));
        let is_raw = match self.rectified {
            Some(rectified) => !rectified,
            None => {
                !(says_rectified(Part::Left)? || left.is_rectified())
                    || !(says_rectified(Part::Right)? || right.is_rectified())
            }
        };
        if is_raw && self.right_info() != Part::RightInfo {
            return Err(Fault::new(format!("{}: the right camera has no camera_info", self.path.display())).remedy(
                "images that are not rectified need one each: name it with `right_info`; `rectified: true` uses the images unchanged",
            ));
        }
        let cameras = Cameras { infos: [left, right], is_raw };
        // Reports an uncalibrated camera as such, before faults that follow from it.
        cameras.calibration(cameras.infos[0].image_size(), self)?;
        Ok(cameras)
    }

    fn maps(&self, cameras: &Cameras, size: (u32, u32)) -> Result<Arc<[Map; 2]>, Fault> {
        let numbers: Vec<u64> =
            cameras.infos.iter().flat_map(numbers_of).chain([size.0.into(), size.1.into()]).collect();
        // Concurrent callers wait: they need the same maps.
        let mut latest = locked(&self.maps);
        if let Some((known, maps)) = &*latest
            && *known == numbers
        {
            return Ok(Arc::clone(maps));
        }
        let map = |info: &CameraInfo, part: Part| {
            let topic = &self.topic(part)?.topic;
            let (camera, view) = lens_and_view(info).map_err(|what| {
                Fault::new(format!("{}: {topic}: {what}", self.path.display()))
                    .remedy("images are rectified by D, K, R and P of a calibrated stereo pair; `rectified: true` uses them unchanged")
            })?;
            Ok::<_, Fault>(Map::new(&camera, &view, size, Interpolation::Float))
        };
        let maps = Arc::new([map(&cameras.infos[0], Part::LeftInfo)?, map(&cameras.infos[1], Part::RightInfo)?]);
        *latest = Some((numbers, Arc::clone(&maps)));
        Ok(maps)
    }
}

struct Cameras {
    infos: [CameraInfo; 2],
    is_raw: bool,
}

impl Cameras {
    fn calibration(&self, size: (u32, u32), reading: &Reading) -> Result<Calibration, Fault> {
        let [left, mut right] = [&self.infos[0], &self.infos[1]].map(CameraInfo::projection);
        if let Some(baseline_m) = reading.baseline_m {
            right[3] = right[0] * (left[3] / left[0] - baseline_m);
        }
        let names = [&reading.topic(Part::LeftInfo)?.topic, &reading.topic(reading.right_info())?.topic];
        let pair = rectified_pair::calibration([names[0], names[1]], [&left, &right], size);
        pair.map_err(|no| {
            let what = format!("{}: P of {}: {}", reading.path.display(), names[no.camera], no.what);
            Fault::new(what).remedy(match (right[3] == left[3], left[0] == 0.0 || right[0] == 0.0) {
                _ if right[3] > left[3] => reading.exchanged([names[0], names[1]]),
                (_, true) => "the camera was not calibrated when it was recorded: camera_info's P is zeros",
                (true, _) => "a stereo calibration has the baseline in P[3] of the right camera, -f * metres; set `baseline_m` if the driver does not publish it",
                _ => "P is that of a rectified stereo pair, as `camera_calibration` and stereo cameras' drivers publish it",
            })
        })
    }
}

fn numbers_of(info: &CameraInfo) -> impl Iterator<Item = u64> {
    let (k, p) = (info.intrinsics(), info.projection());
    let model = info.distortion_model.bytes().map(u64::from);
    let numbers: Vec<u64> = info.d.iter().chain(&k).chain(&info.r).chain(&p).map(|number| number.to_bits()).collect();
    model.chain(numbers)
}

fn lens_and_view(info: &CameraInfo) -> Result<(Camera, View), String> {
    let (k, p, r) = (info.intrinsics(), info.projection(), info.r);
    if !(k[0] > 0.0 && k[4] > 0.0) {
        return Err(format!("K has the focal lengths {} and {} px", k[0], k[4]));
    }
    let rotation = [[r[0], r[1], r[2]], [r[3], r[4], r[5]], [r[6], r[7], r[8]]];
    let is_turn = (0..3).all(|a| {
        (0..3).all(|b| {
            let product: f64 = (0..3).map(|k| rotation[a][k] * rotation[b][k]).sum();
            (product - f64::from(u8::from(a == b))).abs() < 1e-3
        })
    });
    if !is_turn {
        return Err("R is not a rotation".to_owned());
    }
    // An empty name with coefficients is that of older drivers.
    let model = if info.distortion_model.is_empty() { "plumb_bob" } else { &info.distortion_model };
    let lens = lens(model, &info.d)?;
    let camera = Camera { focal_px: [k[0], k[4]], centre_px: [k[2], k[5]], lens };
    let view = View { rotation, focal_px: [p[0], p[5]], centre_px: [p[2], p[6]] };
    Ok((camera, view))
}
