//! Recognises bags, and suggests their topics by name and first message.

use std::path::{Path, PathBuf};

use depthloom_bags::camera::camera_info;
use depthloom_bags::images::{ImageContent, image};
use depthloom_bags::points::point_cloud;
use depthloom_bags::{Bag, Form, Header, Sort, Topic, topics, written_by};
use depthloom_graphs::ErrorMessage;
use depthloom_graphs::contracts::Recognised;
use serde_json::json;

use crate::sources::ros2_bag::static_transforms;

const OURS: &str = "depthloom";

/// Each topic costs a message.
const MOST_LOOKED_AT: usize = 40;

pub(super) fn is_of_ours(bag: &Bag) -> bool {
    is_written_by_us(bag.path()) || bag.topics().iter().any(|topic| topic.message_type.starts_with("depthloom."))
}

fn is_written_by_us(path: &Path) -> bool {
    path.is_file() && written_by(path).is_some_and(|library| library == OURS)
}

fn is_called_one(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "mcap" || ending == "db3") && path.is_file()
}

fn files(root: &Path) -> impl Iterator<Item = PathBuf> {
    let listing = std::fs::read_dir(root).into_iter().flatten().flatten();
    listing.map(|entry| entry.path()).filter(|path| is_called_one(path))
}

fn has_metadata(root: &Path) -> bool {
    let read = depthloom_graphs::regular_file::read(&root.join("metadata.yaml"), 16 << 20);
    read.is_ok_and(|bytes| String::from_utf8_lossy(&bytes).contains("rosbag2_bagfile_information"))
}

pub(super) fn recognise(root: &Path) -> Vec<Recognised> {
    let is_bag = is_called_one(root) || has_metadata(root);
    if !is_bag && files(root).next().is_none() {
        return Vec::new();
    }
    match Bag::open(root) {
        Ok(bag) if is_of_ours(&bag) => Vec::new(),
        Ok(bag) => vec![Suggestion::for_bag(&bag).recognised(&bag)],
        Err(_) if is_bag && !is_written_by_us(root) => {
            let name = root.file_name().unwrap_or(root.as_os_str()).to_string_lossy();
            vec![Recognised::new(format!("{name}, a bag that cannot be opened"), json!({ "path": root }))]
        }
        Err(_) => Vec::new(),
    }
}

#[derive(Default)]
struct Suggestion {
    parameters: Vec<(&'static str, String)>,
    alternatives: Vec<String>,
}

struct Left {
    size: (u32, u32),
    frame: String,
}

impl Suggestion {
    fn for_bag(bag: &Bag) -> Self {
        let mut found = Self::default();
        let pairs = topics::stereo_pairs(bag);
        let Some((&(left, right), others)) = pairs.split_first() else {
            let is_image = |topic: &&Topic| Form::sort_of(topic).is_some_and(Sort::is_image);
            for topic in bag.topics().iter().filter(is_image).take(MOST_LOOKED_AT) {
                found.or("left", &topic.name, "or `right`: an image");
            }
            return found;
        };
        found.take("left", &left.name);
        found.take("right", &right.name);
        for (other_left, other_right) in others {
            found.or("left", &other_left.name, "another pair, in place of the above, with");
            found.or("right", &other_right.name, "this, and their infos");
        }
        let infos = [(left, "left_info"), (right, "right_info")].map(|(image, parameter)| {
            let info = topics::camera_of(bag, image);
            match info {
                Some(info) => found.take(parameter, &info.name),
                None => {
                    let is_info = |topic: &&Topic| Form::sort_of(topic) == Some(Sort::CameraInfo);
                    for topic in bag.topics().iter().filter(is_info) {
                        found.or(parameter, &topic.name, "is it the camera's?");
                    }
                }
            }
            info
        });
        let info = infos[0].and_then(|topic| {
            let bytes = first(bag, topic)?;
            camera_info(Form::from_topic(topic).ok()?, &bytes).ok()
        });
        let frame = frame_of(bag, left);
        let left_seen = info.zip(frame).map(|(info, frame)| Left { size: info.image_size(), frame });
        found.truths(bag, [left, right], left_seen.as_ref());
        found
    }

    fn take(&mut self, parameter: &'static str, topic: &str) {
        self.parameters.push((parameter, topic.to_owned()));
    }

    fn or(&mut self, parameter: &str, topic: &str, why: &str) {
        self.alternatives.push(format!("{parameter}: {}   # {why}", json!(topic)));
    }

    /// Takes the first topic that fits the left image; the others become alternatives with what contradicts them.
    fn truths(&mut self, bag: &Bag, pair: [&Topic; 2], left: Option<&Left>) {
        let is_other = |topic: &&Topic| pair.iter().all(|image| image.name != topic.name);
        let mut fitting: Vec<(&'static str, &Topic)> = Vec::new();
        for topic in bag.topics().iter().filter(is_other).take(MOST_LOOKED_AT) {
            let Some((parameter, against)) = truth(bag, topic, left) else { continue };
            match against {
                None => fitting.push((parameter, topic)),
                Some(why) => self.or(parameter, &topic.name, &why),
            }
        }
        // Depths are pixel by pixel, a scan's points are few.
        fitting.sort_by_key(|(parameter, _)| *parameter);
        let mut fitting = fitting.into_iter();
        if let Some((parameter, topic)) = fitting.next() {
            self.take(parameter, &topic.name);
        }
        for (parameter, topic) in fitting {
            self.or(parameter, &topic.name, "other ground truth, instead of the above");
        }
    }

    fn recognised(self, bag: &Bag) -> Recognised {
        let mut params = json!({ "path": bag.path() });
        for (parameter, topic) in &self.parameters {
            params[*parameter] = json!(topic);
        }
        let name = bag.path().file_name().unwrap_or(bag.path().as_os_str()).to_string_lossy();
        let what = match bag.topics().len() {
            1 => format!("{name}, a bag of 1 topic"),
            count => format!("{name}, a bag of {count} topics"),
        };
        Recognised { alternatives: self.alternatives, ..Recognised::new(what, params) }
    }
}

fn first(bag: &Bag, topic: &Topic) -> Option<std::sync::Arc<[u8]>> {
    let messages = bag.messages(&[topic]).ok()?.remove(0);
    bag.read(messages.first()?).ok()
}

fn frame_of(bag: &Bag, topic: &Topic) -> Option<String> {
    let (form, bytes) = (Form::from_topic(topic).ok()?, first(bag, topic)?);
    let header: Result<Header, ErrorMessage> = match form.sort {
        Sort::PointCloud => point_cloud(form, &bytes).map(|message| message.header),
        _ => image(form, &bytes).map(|message| message.header),
    };
    header.ok().map(|header| header.frame_id)
}

/// The parameter, and what contradicts it.
fn truth(bag: &Bag, topic: &Topic, left: Option<&Left>) -> Option<(&'static str, Option<String>)> {
    const UNKNOWN: &str = "does it belong to the left image?";
    let form = Form::from_topic(topic).ok()?;
    if form.sort == Sort::PointCloud {
        let against = match (left, frame_of(bag, topic), static_transforms::read(bag)) {
            (Some(left), Some(frame), Ok(transforms)) => transforms.between(&left.frame, &frame).err(),
            (_, _, Err(fault)) => Some(fault.chain()),
            _ => Some(UNKNOWN.to_owned()),
        };
        return Some(("points", against));
    }
    if !form.sort.is_image() {
        return None;
    }
    let bytes = first(bag, topic)?;
    let message = image(form, &bytes).ok()?;
    let size = match &message.content {
        ImageContent::Raw(raw) if matches!(raw.encoding, "16UC1" | "32FC1") => Some((raw.width, raw.height)),
        ImageContent::Compressed(image) if image.format.contains("compressedDepth") => None,
        _ => return None,
    };
    let frame = &message.header.frame_id;
    let against = match (left, size) {
        (None, _) => Some(UNKNOWN.to_owned()),
        (Some(left), Some((width, height))) if left.size != (width, height) => {
            let (w, h) = left.size;
            Some(format!("of {width}x{height}, and the left image is {w}x{h}: record the registered topic"))
        }
        (Some(left), _) if left.frame != *frame => {
            Some(format!("in the frame `{frame}`, and the left image is in `{}`: is it registered to it?", left.frame))
        }
        _ => None,
    };
    Some(("depth", against))
}
