//! Messages about broken bags.

use std::fs;

use serde_json::{Value as Json, json};

use crate::bag_writer::{
    Cdr, Info, LEFT, LEFT_INFO, LEFT_P, MS, RIGHT, RIGHT_INFO, RIGHT_P, Raw, SIZE, T0, Written, cloud, frame, frames,
    grey, image, raw_image, sqlite,
};
use crate::ros2_bag::{Bench, find};

#[test]
#[expect(clippy::too_many_lines, reason = "one list of cases")]
fn broken_bags_are_reported_with_place_and_remedy() {
    let bench = Bench::new();
    let mut reports = String::new();
    let mut add = |name: &str, text: String| reports.push_str(&format!("{name}:\n{text}\n\n"));
    let file = |name: &str, bytes: &[u8]| {
        fs::write(bench.path(name), bytes).unwrap();
        bench.path(name)
    };
    let report = |messages: &[Written], more: Json| bench.report(&bench.mcap(messages), &more);
    // A frame with one message changed.
    let with = |at: usize, bytes: Vec<u8>| {
        let mut messages = frame(T0, 0);
        messages[at].bytes = bytes;
        report(&messages, json!({}))
    };
    let left = |raw: &Raw<'_>| with(0, raw_image(false, T0, "camera_left", raw));
    let data = grey(0);
    let plain = Raw { size: SIZE, encoding: "mono8", step: 40, data: &data };

    add("not there", bench.report(&bench.path("nowhere"), &json!({})));
    add("an empty file", bench.report(&file("empty.mcap", b""), &json!({})));
    add("another file", bench.report(&file("notes.db3", b"not a database"), &json!({})));
    add("of ROS 1", bench.report(&file("old.bag", b"#ROSBAG V2.0\nmore"), &json!({})));
    add("compressed as a whole", bench.report(&file("bag.db3.zstd", &[0x28, 0xb5, 0x2f, 0xfd, 0, 0]), &json!({})));
    fs::create_dir(bench.path("void")).unwrap();
    add("an empty folder", bench.report(&bench.path("void"), &json!({})));
    fs::create_dir(bench.path("two")).unwrap();
    fs::write(bench.path("two/a_0.mcap"), b"").unwrap();
    fs::write(bench.path("two/b_0.mcap"), b"").unwrap();
    add("two bags in a folder", bench.report(&bench.path("two"), &json!({})));
    fs::create_dir(bench.path("lost")).unwrap();
    let metadata = "rosbag2_bagfile_information:\n  relative_file_paths: [lost_0.db3]\n";
    fs::write(bench.path("lost/metadata.yaml"), metadata).unwrap();
    add("a file that metadata names is missing", bench.report(&bench.path("lost"), &json!({})));
    fs::write(bench.path("lost/metadata.yaml"), "no: metadata\n").unwrap();
    add("other metadata", bench.report(&bench.path("lost"), &json!({})));
    let other = rusqlite::Connection::open(bench.path("other.db3")).unwrap();
    other.execute_batch("CREATE TABLE people(name TEXT); CREATE TABLE messages(text TEXT);").unwrap();
    add("another database", bench.report(&bench.path("other.db3"), &json!({})));
    sqlite(&bench.path("cut.db3"), &frames());
    let whole = fs::read(bench.path("cut.db3")).unwrap();
    add("a database that was cut off", bench.report(&file("cut.db3", &whole[..whole.len() / 2]), &json!({})));
    let whole = fs::read(bench.mcap(&frames())).unwrap();
    add("cut off before any message", bench.report(&file("cut.mcap", &whole[..60]), &json!({})));
    let mut flipped = whole.clone();
    flipped[200] ^= 0x40;
    add("a flipped bit in a chunk", bench.report(&file("flipped.mcap", &flipped), &json!({})));
    // In the footer, behind opcode and length: the start of the summary.
    let mut elsewhere = whole.clone();
    let footer = whole.len() - 8 - 20;
    elsewhere[footer..footer + 8].copy_from_slice(&(whole.len() as u64 * 9).to_le_bytes());
    add("a summary beyond the end", bench.report(&file("elsewhere.mcap", &elsewhere), &json!({})));
    let huge = find(&whole, &[8], 9, 60..400).expect("a chunk index");
    add("a chunk of absurd size", bench.report(&file("huge.mcap", &with_sizes(&whole, huge)), &json!({})));

    add("a topic that is not there", report(&frames(), json!({ "left": "/stereo/left/image_rct" })));
    add("a topic of another type", report(&frames(), json!({ "left": LEFT_INFO, "right": RIGHT })));
    let mut foreign = frames();
    foreign.push(Written::new("/imu", "sensor_msgs/msg/Imu", T0, Vec::new()));
    add("a type that is not read", report(&foreign, json!({ "points": "/imu" })));
    let mut mono = frames();
    mono.retain(|message| message.topic != RIGHT);
    add("one camera", report(&mono, json!({})));
    let mut several = frames();
    several.extend(
        frames().into_iter().map(|message| Written { topic: message.topic.replace("/stereo", "/rear"), ..message }),
    );
    add("two pairs", report(&several, json!({})));
    let mut uncalibrated = frames();
    uncalibrated.retain(|message| message.topic != RIGHT_INFO);
    add("no camera_info", report(&uncalibrated, json!({})));
    let ours = frames().into_iter().map(|message| Written { message_type: "depthloom.Commit".into(), ..message });
    add("a recording of ours", report(&ours.collect::<Vec<_>>(), json!({})));
    let encoded = |encoding: &str| {
        frames().into_iter().map(|message| Written { encoding: encoding.into(), ..message }).collect::<Vec<_>>()
    };
    add("in JSON", report(&encoded("json"), json!({})));
    add("of ROS 1 in MCAP", report(&encoded("ros1"), json!({})));

    let late: Vec<Written> = frames().into_iter().filter(|message| message.topic != RIGHT).collect();
    let late = [late, (0..3).map(|number| image(RIGHT, "camera_right", T0 + number * 100 * MS + 32 * MS, 7)).collect()]
        .concat();
    add("no partner in time", report(&late, json!({})));
    let unset: Vec<Written> = (0..3).flat_map(|_| frame(0, 0)).collect();
    add("no time in the headers", report(&unset, json!({})));
    add("a range after the end", report(&frames(), json!({ "start_s": 7.0 })));
    add("an empty range", report(&frames(), json!({ "start_s": 7.0, "end_s": 3.0 })));

    add("a sensor's mosaic of too few pixels", left(&Raw { encoding: "bayer_rggb8", size: (40, 2), ..plain }));
    add("YUV of an odd width", left(&Raw { encoding: "uyvy", size: (19, 30), ..plain }));
    add("YUV without its second plane", left(&Raw { encoding: "nv21", ..plain }));
    add("an encoding that is not read", left(&Raw { encoding: "nv24", ..plain }));
    add("an unknown encoding", left(&Raw { encoding: "purple", ..plain }));
    add("a step that is too small", left(&Raw { step: 39, ..plain }));
    add("data shorter than its rows", left(&Raw { data: &data[..1000], ..plain }));
    add("absurd sizes", left(&Raw { size: (u32::MAX, u32::MAX), step: u32::MAX, ..plain }));
    add("an image of nothing", left(&Raw { size: (0, 0), step: 0, ..plain }));
    let text = Cdr::new(false).u32(1_700_000_000).u32(0).u32(u32::MAX).raw(b"camera").end();
    add("a text of absurd length", with(0, text));
    add("a message that is cut", with(0, raw_image(false, T0, "camera_left", &plain)[..300].to_vec()));
    add(
        "a message of another representation",
        with(0, [&[0, 7, 0, 0][..], &raw_image(false, T0, "camera_left", &plain)[4..]].concat()),
    );
    add("a message without a byte", with(0, Vec::new()));
    let jpeg = |bytes: &[u8], format: &str| {
        let mut messages = frame(T0, 0);
        messages[0].message_type = "sensor_msgs/msg/CompressedImage".into();
        messages[0].bytes =
            Cdr::new(false).header(T0, "camera_left").text(format).u32(bytes.len() as u32).raw(bytes).end();
        report(&messages, json!({}))
    };
    add("a damaged JPEG", jpeg(b"\xff\xd8\xffno", "jpeg"));
    add("depths for an image", jpeg(b"\xff\xd8\xffno", "16UC1; compressedDepth png"));
    add(
        "two sizes",
        with(1, raw_image(false, T0, "r", &Raw { size: (20, 30), step: 20, data: &data[..600], ..plain })),
    );

    let info = |info: Info<'_>| with(3, info.message(false, T0, "camera_left"));
    add("an uncalibrated camera", info(Info::with_projection([0.0; 12])));
    add("no baseline", info(Info::with_projection(LEFT_P)));
    let moved = |at: usize, value: f64| {
        let mut p = RIGHT_P;
        p[at] = value;
        info(Info::with_projection(p))
    };
    add("left and right exchanged", moved(3, 10.0));
    let exchanged = |more: Json| report(&frame(T0, 0), more);
    add("both cameras exchanged", exchanged(json!({ "left": RIGHT, "right": LEFT })));
    add("infos exchanged", exchanged(json!({ "left_info": RIGHT_INFO, "right_info": LEFT_INFO })));
    add("two principal points", moved(6, 25.0));
    add("another camera's info", info(Info { size: (640, 480), ..Info::with_projection(RIGHT_P) }));
    let raw = |info: Info<'_>| {
        let mut messages = frame(T0, 0);
        messages[2].bytes = info.message(false, T0, "camera_left");
        messages.iter_mut().for_each(|message| message.topic = message.topic.replace("image_rect", "image_raw"));
        report(&messages, json!({}))
    };
    add(
        "a lens that is not taken out",
        raw(Info { model: "double_sphere", d: &[0.1, 0.2], ..Info::with_projection(LEFT_P) }),
    );
    add("an invalid rotation", raw(Info { r: [2.0; 9], ..Info::with_projection(LEFT_P) }));

    let points = |bytes: Vec<u8>| {
        let mut messages = frame(T0, 0);
        messages.push(Written::new("/points", "sensor_msgs/msg/PointCloud2", T0, bytes));
        report(&messages, json!({ "points": "/points" }))
    };
    add("points without transforms", points(cloud(T0, "lidar", &[[1.0; 3]], &["x", "y", "z"])));
    add("points without z", points(cloud(T0, "camera_left", &[[1.0; 3]], &["x", "y", "i"])));
    let short = cloud(T0, "camera_left", &[[1.0; 3]; 9], &["x", "y", "z"]);
    add("points that are cut", points(short[..short.len() - 40].to_vec()));
    let depth = |size: (u32, u32)| {
        let mut messages = frame(T0, 0);
        let data = vec![0; (2 * size.0 * size.1) as usize];
        let raw = Raw { size, encoding: "16UC1", step: 2 * size.0, data: &data };
        messages.push(Written::new("/depth", "sensor_msgs/msg/Image", T0, raw_image(false, T0, "depth", &raw)));
        report(&messages, json!({ "depth": "/depth" }))
    };
    add("depths of another size", depth((20, 15)));
    let mut grey_depth = frame(T0, 0);
    grey_depth.push(image("/depth", "depth", T0, 0));
    add("depths of a wrong encoding", report(&grey_depth, json!({ "depth": "/depth" })));
    insta::with_settings!({ omit_expression => true }, { insta::assert_snapshot!("broken_bags", reports.trim_end()); });
}

/// The file with the last eight bytes of that record, a chunk's size, as large as they can be.
fn with_sizes(bytes: &[u8], record: usize) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let length = u64::from_le_bytes(bytes[record + 1..record + 9].try_into().unwrap()) as usize;
    let end = record + 9 + length;
    out[end - 8..end].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    out
}
