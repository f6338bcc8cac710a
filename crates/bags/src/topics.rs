//! Which topics are a stereo pair, by the names that people give them.

use crate::{Bag, Form, Sort, Topic};

/// Names of left and right cameras: `left`, RealSense's `infra1`, EuRoC's `cam0`, KITTI's numbers.
const SIDES: [(&str, &str); 8] = [
    ("left", "right"),
    ("infra1", "infra2"),
    ("cam0", "cam1"),
    ("cam_0", "cam_1"),
    ("camera0", "camera1"),
    ("camera_0", "camera_1"),
    ("image_02", "image_03"),
    ("image_00", "image_01"),
];

/// What `image_transport` puts behind a topic.
const TRANSPORTS: [&str; 6] = ["compressed", "compressedDepth", "theora", "ffmpeg", "zstd", "draco"];

/// The topic that another camera's has by convention: each `left` in its name is a `right`.
fn partner(name: &str) -> Option<String> {
    SIDES.iter().find(|(left, _)| name.contains(left)).map(|(left, right)| name.replace(left, right))
}

fn base(name: &str) -> &str {
    match name.rsplit_once('/') {
        Some((base, last)) if TRANSPORTS.contains(&last) => base,
        _ => name,
    }
}

/// Whether a topic's images are rectified, by its name: `image_rect`, `image_rect_color`.
#[must_use]
pub fn is_rectified(name: &str) -> bool {
    base(name).rsplit('/').next().is_some_and(|last| last.contains("rect"))
}

/// The right camera's topic of a left one's.
#[must_use]
pub fn right_of<'a>(bag: &'a Bag, left: &Topic) -> Option<&'a Topic> {
    let name = partner(&left.name)?;
    bag.topics().iter().find(|topic| topic.name == name && Form::sort_of(topic).is_some_and(Sort::is_image))
}

/// The left camera's topic of a right one's.
#[must_use]
pub fn left_of<'a>(bag: &'a Bag, right: &Topic) -> Option<&'a Topic> {
    let is_left = |topic: &&Topic| {
        Form::sort_of(topic).is_some_and(Sort::is_image) && partner(&topic.name).as_deref() == Some(&right.name)
    };
    bag.topics().iter().find(is_left)
}

/// The stereo pairs that there are by name. Where some are rectified, these; of one image in several transports the
/// uncompressed one.
#[must_use]
pub fn stereo_pairs(bag: &Bag) -> Vec<(&Topic, &Topic)> {
    let is_image = |topic: &&Topic| Form::sort_of(topic).is_some_and(Sort::is_image);
    let mut pairs: Vec<(&Topic, &Topic)> = bag
        .topics()
        .iter()
        .filter(is_image)
        .filter_map(|left| right_of(bag, left).map(|right| (left, right)))
        .collect();
    if pairs.iter().any(|(left, _)| is_rectified(&left.name)) {
        pairs.retain(|(left, _)| is_rectified(&left.name));
    }
    let there: Vec<&str> = pairs.iter().map(|(left, _)| left.name.as_str()).collect();
    pairs.retain(|(left, _)| base(&left.name) == left.name || !there.contains(&base(&left.name)));
    pairs
}

/// The camera topic of an image: `camera_info` in the same namespace, or the only camera topic in its folder or
/// below it.
#[must_use]
pub fn camera_of<'a>(bag: &'a Bag, image: &Topic) -> Option<&'a Topic> {
    let name = base(&image.name);
    let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
    let cameras = || bag.topics().iter().filter(|topic| Form::sort_of(topic) == Some(Sort::CameraInfo));
    let named = |name: String| cameras().find(|topic| topic.name == name);
    let only = |folder: &str| {
        let mut infos =
            cameras().filter(|topic| topic.name.rsplit_once('/').is_some_and(|(parent, _)| parent == folder));
        infos.next().filter(|_| infos.next().is_none())
    };
    named(format!("{folder}/camera_info"))
        .or_else(|| named(format!("{name}/camera_info")))
        .or_else(|| only(folder))
        .or_else(|| only(name))
}

#[cfg(test)]
mod tests {
    use super::{base, is_rectified, partner};

    #[test]
    fn names_that_drivers_give() {
        for (left, right) in [
            ("/stereo/left/image_rect", "/stereo/right/image_rect"),
            ("/zed/zed_node/left/image_rect_color/compressed", "/zed/zed_node/right/image_rect_color/compressed"),
            ("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"),
            ("/cam0/image_raw", "/cam1/image_raw"),
            ("/left_camera/image", "/right_camera/image"),
            ("/kitti/camera_color_left/image_rect", "/kitti/camera_color_right/image_rect"),
        ] {
            assert_eq!(partner(left).as_deref(), Some(right));
        }
        assert_eq!(partner("/camera/color/image_raw"), None);
        assert!(is_rectified("/left/image_rect_color/compressed") && !is_rectified("/rect/image_raw"));
        assert_eq!(base("/left/image/compressed"), "/left/image");
    }
}
