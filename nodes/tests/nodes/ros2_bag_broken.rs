//! What is said of broken bags.

use std::fs;

use serde_json::{Value as Json, json};

use crate::bag_writer::{
    Cdr, Info, LEFT, LEFT_INFO, LEFT_P, MS, RIGHT, RIGHT_INFO, RIGHT_P, Raw, SIZE, T0, Written, cloud, frame, frames,
    grey, image, raw_image, sqlite,
};
use crate::ros2_bag::{Bench, find};

#[test]
#[expect(clippy::too_many_lines, reason = "one list of cases")]
fn broken_bags_are_told_with_place_and_remedy() {
    let bench = Bench::new();
    let mut told = String::new();
    let mut tell = |name: &str, text: String| told.push_str(&format!("{name}:\n{text}\n\n"));
    let file = |name: &str, bytes: &[u8]| {
        fs::write(bench.path(name), bytes).unwrap();
        bench.path(name)
    };
    let of = |messages: &[Written], more: Json| bench.told(&bench.mcap(messages), &more);
    // A frame with one message changed.
    let with = |at: usize, bytes: Vec<u8>| {
        let mut messages = frame(T0, 0);
        messages[at].bytes = bytes;
        of(&messages, json!({}))
    };
    let left = |raw: &Raw<'_>| with(0, raw_image(false, T0, "camera_left", raw));
    let data = grey(0);
    let plain = Raw { size: SIZE, encoding: "mono8", step: 40, data: &data };

    tell("not there", bench.told(&bench.path("nowhere"), &json!({})));
    tell("an empty file", bench.told(&file("empty.mcap", b""), &json!({})));
    tell("another file", bench.told(&file("notes.db3", b"these are no messages"), &json!({})));
    tell("of ROS 1", bench.told(&file("old.bag", b"#ROSBAG V2.0\nmore"), &json!({})));
    tell("compressed as a whole", bench.told(&file("bag.db3.zstd", &[0x28, 0xb5, 0x2f, 0xfd, 0, 0]), &json!({})));
    fs::create_dir(bench.path("void")).unwrap();
    tell("an empty folder", bench.told(&bench.path("void"), &json!({})));
    fs::create_dir(bench.path("two")).unwrap();
    fs::write(bench.path("two/a_0.mcap"), b"").unwrap();
    fs::write(bench.path("two/b_0.mcap"), b"").unwrap();
    tell("two bags in a folder", bench.told(&bench.path("two"), &json!({})));
    fs::create_dir(bench.path("lost")).unwrap();
    let metadata = "rosbag2_bagfile_information:\n  relative_file_paths: [lost_0.db3]\n";
    fs::write(bench.path("lost/metadata.yaml"), metadata).unwrap();
    tell("a file that metadata names is missing", bench.told(&bench.path("lost"), &json!({})));
    fs::write(bench.path("lost/metadata.yaml"), "no: metadata\n").unwrap();
    tell("other metadata", bench.told(&bench.path("lost"), &json!({})));
    let other = rusqlite::Connection::open(bench.path("other.db3")).unwrap();
    other.execute_batch("CREATE TABLE people(name TEXT); CREATE TABLE messages(text TEXT);").unwrap();
    tell("another database", bench.told(&bench.path("other.db3"), &json!({})));
    sqlite(&bench.path("cut.db3"), &frames());
    let whole = fs::read(bench.path("cut.db3")).unwrap();
    tell("a database that was cut off", bench.told(&file("cut.db3", &whole[..whole.len() / 2]), &json!({})));
    let whole = fs::read(bench.mcap(&frames())).unwrap();
    tell("cut off before any message", bench.told(&file("cut.mcap", &whole[..60]), &json!({})));
    let mut flipped = whole.clone();
    flipped[200] ^= 0x40;
    tell("a flipped bit in a chunk", bench.told(&file("flipped.mcap", &flipped), &json!({})));
    // In the footer, behind opcode and length: the start of the summary.
    let mut elsewhere = whole.clone();
    let footer = whole.len() - 8 - 20;
    elsewhere[footer..footer + 8].copy_from_slice(&(whole.len() as u64 * 9).to_le_bytes());
    tell("a summary beyond the end", bench.told(&file("elsewhere.mcap", &elsewhere), &json!({})));
    let huge = find(&whole, &[8], 9, 60..400).expect("a chunk index");
    tell("a chunk of absurd size", bench.told(&file("huge.mcap", &with_sizes(&whole, huge)), &json!({})));

    tell("a topic that is not there", of(&frames(), json!({ "left": "/stereo/left/image_rct" })));
    tell("a topic of another type", of(&frames(), json!({ "left": LEFT_INFO, "right": RIGHT })));
    let mut foreign = frames();
    foreign.push(Written::new("/imu", "sensor_msgs/msg/Imu", T0, Vec::new()));
    tell("a type that is not read", of(&foreign, json!({ "points": "/imu" })));
    let mut mono = frames();
    mono.retain(|message| message.topic != RIGHT);
    tell("one camera", of(&mono, json!({})));
    let mut several = frames();
    several.extend(
        frames().into_iter().map(|message| Written { topic: message.topic.replace("/stereo", "/rear"), ..message }),
    );
    tell("two pairs", of(&several, json!({})));
    let mut uncalibrated = frames();
    uncalibrated.retain(|message| message.topic != RIGHT_INFO);
    tell("no camera_info", of(&uncalibrated, json!({})));
    let ours = frames().into_iter().map(|message| Written { message_type: "depthloom.Commit".into(), ..message });
    tell("a recording of ours", of(&ours.collect::<Vec<_>>(), json!({})));
    let encoded = |encoding: &str| {
        frames().into_iter().map(|message| Written { encoding: encoding.into(), ..message }).collect::<Vec<_>>()
    };
    tell("in JSON", of(&encoded("json"), json!({})));
    tell("of ROS 1 in MCAP", of(&encoded("ros1"), json!({})));

    let late: Vec<Written> = frames().into_iter().filter(|message| message.topic != RIGHT).collect();
    let late = [late, (0..3).map(|number| image(RIGHT, "camera_right", T0 + number * 100 * MS + 32 * MS, 7)).collect()]
        .concat();
    tell("no partner in time", of(&late, json!({})));
    let unset: Vec<Written> = (0..3).flat_map(|_| frame(0, 0)).collect();
    tell("no time in the headers", of(&unset, json!({})));
    tell("a range after the end", of(&frames(), json!({ "start_s": 7.0 })));
    tell("a range that is none", of(&frames(), json!({ "start_s": 7.0, "end_s": 3.0 })));

    tell("a sensor's mosaic of too few pixels", left(&Raw { encoding: "bayer_rggb8", size: (40, 2), ..plain }));
    tell("YUV of an odd width", left(&Raw { encoding: "uyvy", size: (19, 30), ..plain }));
    tell("YUV without its second plane", left(&Raw { encoding: "nv21", ..plain }));
    tell("an encoding that is not read", left(&Raw { encoding: "nv24", ..plain }));
    tell("an encoding that nobody knows", left(&Raw { encoding: "purple", ..plain }));
    tell("a step that is too small", left(&Raw { step: 39, ..plain }));
    tell("data shorter than its rows", left(&Raw { data: &data[..1000], ..plain }));
    tell("absurd sizes", left(&Raw { size: (u32::MAX, u32::MAX), step: u32::MAX, ..plain }));
    tell("an image of nothing", left(&Raw { size: (0, 0), step: 0, ..plain }));
    let text = Cdr::new(false).u32(1_700_000_000).u32(0).u32(u32::MAX).raw(b"camera").end();
    tell("a text of absurd length", with(0, text));
    tell("a message that is cut", with(0, raw_image(false, T0, "camera_left", &plain)[..300].to_vec()));
    tell(
        "a message of another representation",
        with(0, [&[0, 7, 0, 0][..], &raw_image(false, T0, "camera_left", &plain)[4..]].concat()),
    );
    tell("a message without a byte", with(0, Vec::new()));
    let jpeg = |bytes: &[u8], format: &str| {
        let mut messages = frame(T0, 0);
        messages[0].message_type = "sensor_msgs/msg/CompressedImage".into();
        messages[0].bytes =
            Cdr::new(false).header(T0, "camera_left").text(format).u32(bytes.len() as u32).raw(bytes).end();
        of(&messages, json!({}))
    };
    tell("a JPEG that is none", jpeg(b"\xff\xd8\xffno", "jpeg"));
    tell("depths for an image", jpeg(b"\xff\xd8\xffno", "16UC1; compressedDepth png"));
    tell(
        "two sizes",
        with(1, raw_image(false, T0, "r", &Raw { size: (20, 30), step: 20, data: &data[..600], ..plain })),
    );

    let info = |info: Info<'_>| with(3, info.message(false, T0, "camera_left"));
    tell("a camera that nobody calibrated", info(Info::of([0.0; 12])));
    tell("no baseline", info(Info::of(LEFT_P)));
    let moved = |at: usize, value: f64| {
        let mut p = RIGHT_P;
        p[at] = value;
        info(Info::of(p))
    };
    tell("left and right exchanged", moved(3, 10.0));
    let exchanged = |more: Json| of(&frame(T0, 0), more);
    tell("both cameras exchanged", exchanged(json!({ "left": RIGHT, "right": LEFT })));
    tell("infos exchanged", exchanged(json!({ "left_info": RIGHT_INFO, "right_info": LEFT_INFO })));
    tell("two principal points", moved(6, 25.0));
    tell("another camera's info", info(Info { size: (640, 480), ..Info::of(RIGHT_P) }));
    let raw = |info: Info<'_>| {
        let mut messages = frame(T0, 0);
        messages[2].bytes = info.message(false, T0, "camera_left");
        messages.iter_mut().for_each(|message| message.topic = message.topic.replace("image_rect", "image_raw"));
        of(&messages, json!({}))
    };
    tell("a lens that is not taken out", raw(Info { model: "double_sphere", d: &[0.1, 0.2], ..Info::of(LEFT_P) }));
    tell("a rotation that is none", raw(Info { r: [2.0; 9], ..Info::of(LEFT_P) }));

    let points = |bytes: Vec<u8>| {
        let mut messages = frame(T0, 0);
        messages.push(Written::new("/points", "sensor_msgs/msg/PointCloud2", T0, bytes));
        of(&messages, json!({ "points": "/points" }))
    };
    tell("points without transforms", points(cloud(T0, "lidar", &[[1.0; 3]], &["x", "y", "z"])));
    tell("points without z", points(cloud(T0, "camera_left", &[[1.0; 3]], &["x", "y", "i"])));
    let short = cloud(T0, "camera_left", &[[1.0; 3]; 9], &["x", "y", "z"]);
    tell("points that are cut", points(short[..short.len() - 40].to_vec()));
    let depth = |size: (u32, u32)| {
        let mut messages = frame(T0, 0);
        let data = vec![0; (2 * size.0 * size.1) as usize];
        let raw = Raw { size, encoding: "16UC1", step: 2 * size.0, data: &data };
        messages.push(Written::new("/depth", "sensor_msgs/msg/Image", T0, raw_image(false, T0, "depth", &raw)));
        of(&messages, json!({ "depth": "/depth" }))
    };
    tell("depths of another size", depth((20, 15)));
    let mut grey_depth = frame(T0, 0);
    grey_depth.push(image("/depth", "depth", T0, 0));
    tell("depths that are none", of(&grey_depth, json!({ "depth": "/depth" })));
    insta::with_settings!({ omit_expression => true }, { insta::assert_snapshot!("broken_bags", told.trim_end()); });
}

/// The file with the last eight bytes of that record, a chunk's size, as large as they can be.
fn with_sizes(bytes: &[u8], record: usize) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let length = u64::from_le_bytes(bytes[record + 1..record + 9].try_into().unwrap()) as usize;
    let end = record + 9 + length;
    out[end - 8..end].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    out
}
