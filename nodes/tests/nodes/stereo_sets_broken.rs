//! Messages about broken data of `middlebury`, `eth3d/two-view`, `sintel-stereo`, `scene-flow` and `drivingstereo`.

use std::fs;

use serde_json::{Value as Json, json};

use crate::folder::Folder;
use crate::stereo_sets::{OF_2014, OF_DRIVING, driving_stereo, eth3d, of_2001, of_2006, of_2014, scene_flow, sintel};

/// A small set of a kind, its parameters, and what is broken of it.
type Broken = (&'static str, fn(Folder) -> Folder, Json, &'static str, fn(&Folder));

#[test]
#[expect(clippy::too_many_lines, reason = "one list of cases")]
fn broken_data_are_named_with_a_remedy() {
    const SINTEL: &str = "training/disparities/alley_1/frame_0001.png";
    const FLOW: &str = "disparity/15mm_focallength/scene_backwards/slow/left/0001.pfm";
    const DRIVING: &str = "2018-10-19-09-30-39_2018-10-19-09-31-36-438";
    let cases: Vec<Broken> = vec![
        ("middlebury", of_2014, json!({}), "no right image", |set| set.remove("Vintage/im1.png")),
        ("middlebury", of_2014, json!({}), "no truth, nor in the other scene", |set| {
            set.remove("Adirondack/disp0.pfm");
            set.remove("Vintage/disp0.pfm");
        }),
        ("middlebury", of_2014, json!({ "ground_truth": "noc" }), "no mask", |set| {
            set.remove("Adirondack/mask0nocc.png");
        }),
        ("middlebury", of_2014, json!({ "scenes": ["Piano"] }), "a scene that is not there", |_| {}),
        ("middlebury", of_2014, json!({}), "a pair of two sizes", |set| set.image_of("Adirondack/im1.png", (38, 30))),
        ("middlebury", of_2014, json!({}), "truth of another size", |set| {
            set.pfm("Adirondack/disp0.pfm", (20, 15), &[1.0]);
        }),
        ("middlebury", of_2014, json!({}), "a truncated PFM", |set| {
            let bytes = fs::read(set.path("Adirondack/disp0.pfm")).unwrap();
            set.bytes("Adirondack/disp0.pfm", &bytes[..bytes.len() / 2]);
        }),
        ("middlebury", of_2014, json!({}), "a PFM that lies", |set| {
            set.text("Adirondack/disp0.pfm", "Pf\n4000000000 4000000000\n-1\n");
        }),
        ("middlebury", of_2014, json!({}), "a PNG called PFM", |set| {
            set.map("Adirondack/other.png", 7);
            fs::rename(set.path("Adirondack/other.png"), set.path("Adirondack/disp0.pfm")).unwrap();
        }),
        ("middlebury", of_2014, json!({}), "a mask of 16 bits", |set| set.map("Adirondack/mask0nocc.png", 255)),
        ("middlebury", of_2014, json!({}), "no doffs", |set| {
            set.text("Adirondack/calib.txt", &OF_2014.replace("doffs=5.5\n", ""));
        }),
        ("middlebury", of_2014, json!({}), "another doffs", |set| {
            set.text("Adirondack/calib.txt", &OF_2014.replace("doffs=5.5", "doffs=0"));
        }),
        ("middlebury", of_2014, json!({}), "the calibration of another size", |set| {
            set.text("Adirondack/calib.txt", &OF_2014.replace("width=40", "width=80"));
        }),
        ("middlebury", of_2014, json!({}), "a matrix cut off", |set| {
            set.text(
                "Adirondack/calib.txt",
                &OF_2014.replace("cam1=[100 0 23.5; 0 100 15; 0 0 1]", "cam1=[100 0 23.5; 0 100"),
            );
        }),
        ("middlebury", of_2014, json!({}), "a baseline of nothing", |set| {
            set.text("Adirondack/calib.txt", &OF_2014.replace("baseline=200", "baseline=0"));
        }),
        ("middlebury", of_2006, json!({}), "dmin.txt of words", |set| set.text("Aloe/dmin.txt", "none")),
        ("middlebury", of_2006, json!({}), "images of no published size", |set| {
            for file in ["view1", "view5"] {
                set.image_of(&format!("Aloe/{file}.png"), (8, 500));
            }
            set.map_u8_of("Aloe/disp1.png", (8, 500), 3);
        }),
        ("middlebury", of_2001, json!({}), "no sixth view", |set| set.remove("venus/im6.ppm")),
        ("middlebury", of_2001, json!({ "views": [4, 6] }), "truth of another view", |_| {}),
        ("middlebury", of_2001, json!({}), "disparities in colours", |set| {
            set.remove("venus/disp2.pgm");
            set.image("venus/disp2.png");
        }),
        ("middlebury", |set| set, json!({}), "nothing", |_| {}),
        ("eth3d/two-view", eth3d, json!({}), "no truth unpacked", |set| set.remove("two_view_training_gt")),
        ("eth3d/two-view", eth3d, json!({}), "a calibration that ends early", |set| {
            set.text("two_view_training/delivery_area_1l/calib.txt", "cam0=[541 0 20; 0 541 x; 0 0 1]\n");
        }),
        ("sintel-stereo", sintel, json!({}), "no right image", |set| {
            set.remove("training/final_right/alley_1/frame_0002.png");
        }),
        ("sintel-stereo", sintel, json!({}), "no masks", |set| set.remove("training/outofframe")),
        ("sintel-stereo", sintel, json!({}), "disparities in grey", |set| set.map_u8(SINTEL, 9)),
        ("sintel-stereo", sintel, json!({}), "disparities cut off", |set| {
            let bytes = fs::read(set.path(SINTEL)).unwrap();
            set.bytes(SINTEL, &bytes[..bytes.len() / 2]);
        }),
        ("sintel-stereo", sintel, json!({}), "a damaged camera file", |set| {
            set.bytes("training/camdata_left/alley_1/frame_0001.cam", &[0; 172]);
            set.bytes("training/camdata_left/alley_1/frame_0002.cam", &[0; 172]);
        }),
        ("sintel-stereo", sintel, json!({ "sequences": ["ambush_2"] }), "a sequence that is not there", |_| {}),
        ("scene-flow", scene_flow, json!({}), "no right image", |set| {
            set.remove("frames_finalpass/15mm_focallength/scene_backwards/slow/right/0001.png");
        }),
        ("scene-flow", scene_flow, json!({}), "no disparities", |set| set.remove("disparity")),
        ("scene-flow", scene_flow, json!({}), "a PFM of three channels", |set| {
            set.bytes(FLOW, &[b"PF\n960 4\n-1\n".as_slice(), &[0; 12 * 960 * 4]].concat());
        }),
        ("scene-flow", scene_flow, json!({}), "a PFM whose header is words", |set| {
            set.text(FLOW, "Pf\nwide high\n-1\n");
        }),
        ("scene-flow", scene_flow, json!({ "pass": "clean" }), "no such pass", |set| set.remove("frames_cleanpass")),
        ("drivingstereo", driving_stereo, json!({}), "no right image", |set| {
            set.remove(&format!("right-image-half-size/{DRIVING}.jpg"));
        }),
        ("drivingstereo", driving_stereo, json!({}), "no truth", |set| set.remove("disparity-map-half-size")),
        ("drivingstereo", driving_stereo, json!({}), "truth of 8 bits", |set| {
            set.map_u8(&format!("disparity-map-half-size/{DRIVING}.png"), 9);
        }),
        ("drivingstereo", driving_stereo, json!({}), "no calibration of the sequence", |set| {
            set.remove("half-image-calib/2018-10-19-09-30-39.txt");
        }),
        ("drivingstereo", driving_stereo, json!({}), "a calibration without T_103", |set| {
            let text = OF_DRIVING.replace("T_103", "T_102");
            set.text("half-image-calib/2018-10-19-09-30-39.txt", &text);
        }),
        ("drivingstereo", driving_stereo, json!({}), "the calibration of the full size", |set| {
            let text = OF_DRIVING.replace(" 0 20 ", " 0 40 ");
            set.text("half-image-calib/2018-10-19-09-30-39.txt", &text);
        }),
        ("drivingstereo", driving_stereo, json!({}), "two sets in one root", |set| {
            set.image("train-left-image/a/a_b.jpg");
        }),
        ("drivingstereo", driving_stereo, json!({ "size": "full" }), "no such size", |_| {}),
    ];
    let mut reports = Vec::new();
    for (kind, make, more, what, break_it) in cases {
        let set = make(Folder::new());
        break_it(&set);
        reports.push(format!("{kind}: {what}\n{}\n", set.report(kind, &more)));
    }
    insta::assert_snapshot!(reports.join("\n"));
}
