//! `ros2/bag`: a robot's recording as a data set: which messages make a frame.

mod chosen;
mod facts;
mod found;
mod frame;
mod params;
mod recognise;
mod static_transforms;

use std::path::Path;

use depthloom_bags::{Bag, Message};
use depthloom_graphs::contracts::{Fact, Frame, FrameSelection, Recognised, SourceDeclaration, Survey};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Context, Fault, Key, Port, Source, SourceKind, SourceOutputs, ValueType};

use self::chosen::Chosen;
use self::found::MatchedFrames;
use self::params::{KIND, Ros2BagParams, VERSION};
use crate::sources::dataset::{depth_port, image_port};
use crate::sources::read_ahead::ReadAhead;
use crate::sources::ros2_bag::frame::{Messages, Part, Reading};

pub(crate) struct Ros2Bag {
    bag: Bag,
    reading: Reading,
    frames: Vec<Frame>,
    messages: Vec<Vec<(Part, Message)>>,
    warnings: Vec<String>,
    /// A run requests a frame's key and then reads it: its messages are read and hashed once.
    read_ahead: ReadAhead<(Messages, Key)>,
}

impl SourceKind for Ros2Bag {
    type Params = Ros2BagParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: VERSION,
            summary: "ROS 2 bag or other MCAP file: stereo pairs matched by time, with depth or points as ground truth.",
            doc: "\
`path` is the folder of a bag in either storage of rosbag2 (MCAP, or SQLite `.db3`, which is opened read-only and \
without locks), or one of its files. Any MCAP file works. The source reads:\n\n\
- `sensor_msgs/msg/Image`: mono8, mono16, rgb8, bgr8, rgba8, bgra8, rgb16, bgr16, bayer_rggb8 and its variants, \
bayer_rggb16 and its variants, uyvy, yuyv, nv21. Of 16 bits, the upper 8 are used; see `bits`.\n\
- `CompressedImage` (JPEG, PNG, `compressedDepth`), `CameraInfo`, `PointCloud2`, `tf2_msgs/msg/TFMessage`, in CDR of \
either byte order.\n\
- `foxglove.RawImage`, `CompressedImage`, `CameraCalibration` in protobuf.\n\n\
Use the source `mcap` for recordings of depthloom.\n\n\
**Frames.** A frame is a left image with the right image nearest in time, at most `tolerance_ms` apart. Each image \
is used once. Frames are ordered by time, whatever the order in the file. Images without a partner are counted and \
reported. The id of a frame is the stamp of the left image in nanoseconds (`1317042164317412775`), its index the \
position of the pair.\n\n\
**Calibration** comes from P of `camera_info` (px, pixel centres at integer coordinates): focal length, principal \
point, baseline `-P_right[3] / f`, and `doffs` = `cx_right - cx_left`. `roi` and `binning` are taken into account. \
Images that are not rectified are rectified as OpenCV's `initUndistortRectifyMap` and `remap` do; they then no \
longer have the bytes of a file.\n\n\
**Ground truth** is read if you name a topic. Depths must be registered to the left image (REP 118: 0, NaN and \
infinity are unknown). Static transforms move the points of a laser scan to the frame of \
the left image (`header.frame_id`). P projects them to the nearest pixel (half to even); the nearest point wins a \
pixel. R is not applied, as in `image_geometry` of ROS, because drivers label images with the frame of the rectified \
camera. If depthloom rectifies the images, R is applied, too. Ground truth farther away in time than `tolerance_ms` \
is not used.\n\n\
**Reading.** Opening reads the index and the headers of messages: a few bytes each in files without compressed \
chunks. `clock: log` reads only the index. Formats: <https://github.com/ros2/rosbag2>, <https://mcap.dev/spec>.",
            outputs: vec![
                image_port(
                    "left",
                    "Left image, 8 bit, rectified; with the bytes of a compressed message if it is unchanged.",
                ),
                image_port("right", "Right image, as `left`."),
                Port::frame("calibration", ValueType::Calibration, "Focal length, principal point, baseline, doffs."),
                depth_port(
                    "Ground-truth depth, metres, NaN = unknown; absent if no ground truth is near enough in time.",
                )
                .optional(),
            ],
        }
    }

    fn check(params: &Ros2BagParams) -> Result<(), (&'static str, String)> {
        if params.path.path().as_os_str().is_empty() {
            return Err(("path", "path is missing: the folder of a ROS 2 bag, or one of its files".to_owned()));
        }
        if params.depth.is_some() && params.points.is_some() {
            return Err(("points", "points cannot be combined with depth: use one as ground truth".to_owned()));
        }
        if params.depth_unit_m.is_some() && params.depth.is_none() {
            return Err(("depth_unit_m", "it is the unit of `depth`, which is not given".to_owned()));
        }
        if let Some(end_s) = params.end_s.filter(|end| *end <= params.start_s) {
            let start_s = params.start_s;
            let what = format!("end_s is {end_s}, expected more than start_s ({start_s})");
            return Err(("end_s", what));
        }
        Ok(())
    }

    fn open(params: Ros2BagParams) -> Result<Box<dyn Source>, Fault> {
        let bag = Bag::open(params.path.path())?;
        Self::opened(bag, &params).map(|(source, _)| Box::new(source) as Box<dyn Source>)
    }

    fn survey(params: Ros2BagParams) -> Survey {
        let bag = match Bag::open(params.path.path()) {
            Ok(bag) => bag,
            Err(fault) => return Survey::failed(fault),
        };
        let mut facts = facts::topics(&bag);
        // A run reads the messages that exist; a survey reports missing ones.
        let all = params.frames == FrameSelection::All && params.end_s.is_none();
        let losses: Vec<String> = if all { bag.losses().to_vec() } else { Vec::new() };
        let fault = |what: &String| {
            Fault::new(format!("{}: {what}", params.path.path().display()))
                .remedy("record or copy it again; a run uses the messages that exist, and `end_s` and `frames` select among them")
        };
        let mut faults: Vec<Fault> = losses.iter().map(fault).collect();
        match Self::opened(bag, &params) {
            Ok((mut source, frame_facts)) => {
                facts.extend(frame_facts);
                source.warnings.retain(|warning| !losses.contains(warning));
                Survey { source: Some(Box::new(source)), faults, facts }
            }
            Err(fault) => {
                faults.push(fault);
                Survey { source: None, faults, facts }
            }
        }
    }

    fn recognise(root: &Path) -> Vec<Recognised> {
        recognise::recognise(root)
    }
}

impl Ros2Bag {
    fn opened(bag: Bag, params: &Ros2BagParams) -> Result<(Self, Vec<Fact>), Fault> {
        if recognise::is_of_ours(&bag) {
            let what = format!("{} is a recording of depthloom", bag.path().display());
            return Err(
                Fault::new(what).remedy("`kind: mcap` reads it, with all its frames and values, by the same `path`")
            );
        }
        let chosen = Chosen::select(&bag, params)?;
        let found = MatchedFrames::find(&bag, &chosen, params)?;
        let transforms = params.points.is_some().then(|| static_transforms::read(&bag)).transpose()?;
        let reading = Reading::new(
            params,
            chosen.0.iter().map(|(part, topic, form)| (*part, topic.name.clone(), *form)),
            chosen.beside(&bag),
            transforms,
        );
        let mut source = Self {
            reading,
            frames: found.frames,
            messages: found.messages,
            warnings: found.warnings,
            read_ahead: ReadAhead::default(),
            bag,
        };
        // What would fail on every frame is found on the first.
        let (first, _) = source.messages_of(FrameIndex(0))?;
        let more = source.reading.look_at(&first)?;
        source.warnings.extend(more);
        Ok((source, found.facts))
    }

    fn messages_of(&self, position: FrameIndex) -> Result<(Messages, Key), Fault> {
        let stamp = &self.frames[position].id;
        let read = |(part, message): &(Part, Message)| Ok((*part, self.bag.read(message)?));
        let messages = Messages::new(self.messages[position].iter().map(read).collect::<Result<_, Fault>>()?, stamp);
        let key = self.reading.key(&messages);
        Ok((messages, key))
    }
}

impl Source for Ros2Bag {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let (messages, key) = self.messages_of(position)?;
        self.read_ahead.keep(position, (messages, key));
        Ok(key)
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let (messages, key) = self.read_ahead.take(position).map_or_else(|| self.messages_of(position), Ok)?;
        Ok(SourceOutputs { outputs: self.reading.values(&messages, ctx)?, key })
    }
}
