//! Recognises pairs of images: two folders, or two series of names in one, that are called left and right. Without a
//! pair, images of a single camera with ground truth.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use depthloom_graphs::contracts::Recognised;
use serde_json::{Value, json};

use crate::sources::calibration::camera_files;
use crate::sources::images::sides;

const IMAGES: [&str; 9] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "pgm", "ppm", "pnm"];
const CALIBRATIONS: [&str; 4] = ["yml", "yaml", "xml", "json"];
/// Words in folder names, and the unit that they suggest.
const TRUTHS: [(&str, Option<&str>); 8] = [
    ("disp", Some("pixels")),
    ("depth", Some("millimetres")),
    ("gt", None),
    ("ground_truth", None),
    ("ground", None),
    ("dmap", Some("millimetres")),
    ("range", Some("millimetres")),
    ("label", None),
];
const OF_TRUTH: [&str; 5] = ["png", "tif", "tiff", "pfm", "npy"];
const DEEPEST: usize = 4;
const MOST_FILES: usize = 200_000;
const MOST_LISTS: usize = 20;

pub(super) fn recognise(root: &Path) -> Vec<Recognised> {
    let mut folders = BTreeMap::new();
    let mut left = MOST_FILES;
    list(root, String::new(), DEEPEST, &mut left, &mut folders);
    let of_images: BTreeMap<&str, Vec<&str>> = folders
        .iter()
        .map(|(folder, files)| {
            let images = files.iter().filter(|file| has_ending(file, &IMAGES)).map(String::as_str);
            (folder.as_str(), images.collect::<Vec<_>>())
        })
        .filter(|(_, files)| !files.is_empty())
        .collect();
    let lists = lists(root, &folders);
    let calibration = calibration(root, &folders);
    let known = |mut params: Value, images: &str| {
        let and = match &calibration {
            Some(files) => {
                params["calibration"] = json!({ "files": files });
                format!("calibrated by {}", files.join(", "))
            }
            None => "without a calibration that is known".to_owned(),
        };
        let mut found = Recognised::new(format!("pairs of images, {images}, {and}"), params);
        if calibration.is_none() {
            found.alternatives.push(
                "calibration: { focal_px: 700, baseline_m: 0.12 }   # yours, of a rectified pair; or { files: [left.yaml, right.yaml] }"
                    .to_owned(),
            );
        }
        found
    };
    let pairs = pairs(&of_images);
    let mut found = Vec::new();
    for (left, right) in &pairs {
        let mut one = known(json!({ "root": root, "left": left, "right": right }), &format!("{left} and {right}"));
        one.alternatives.extend(truths(&folders, &of_images, left, &pairs));
        one.alternatives
            .extend(lists.iter().map(|list| format!("list: {}   # in place of left and right", json!(list))));
        found.push(one);
    }
    if found.is_empty() {
        found.extend(
            lists.iter().map(|list| known(json!({ "root": root, "list": list }), &format!("as listed in {list}"))),
        );
    }
    if found.is_empty() {
        found.extend(single_cameras(root, &folders, &of_images));
    }
    found
}

/// Folders of images beside a folder that is called depth, with the first line of ground truth that fits.
fn single_cameras(
    root: &Path,
    folders: &BTreeMap<String, Vec<String>>,
    of_images: &BTreeMap<&str, Vec<&str>>,
) -> Vec<Recognised> {
    let is_truth = |folder: &str| {
        let name = folder.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
        TRUTHS.iter().any(|(word, _)| name.contains(word))
    };
    let mut found = Vec::new();
    for (folder, files) in of_images.iter().filter(|(folder, _)| !folder.is_empty() && !is_truth(folder)) {
        let left = format!("{folder}/{}", all_of(files));
        let mut lines = truths(folders, of_images, &left, &[]);
        // Disparities belong to a pair, of which one half is missing.
        lines.retain(|line| !line.contains("unit: pixels"));
        if lines.is_empty() {
            continue;
        }
        let mut one =
            Recognised::new(format!("images of a single camera, {left}"), json!({ "root": root, "left": left }));
        one.alternatives.push(
            "calibration: { focal_px: 700 }   # yours, where a node needs it; cx_px, cy_px where known".to_owned(),
        );
        one.alternatives.extend(lines);
        found.push(one);
    }
    found
}

fn pairs(of_images: &BTreeMap<&str, Vec<&str>>) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for (folder, files) in of_images {
        let is_there = |name: &str| of_images.contains_key(name);
        if let Some(other) =
            sides::others(folder).into_iter().find(|other| is_there(&other.right) && !other.follows(&is_there))
        {
            let right = &of_images[other.right.as_str()];
            found.push((format!("{folder}/{}", all_of(files)), format!("{}/{}", other.right, all_of(right))));
        }
        if let Some((left, right)) = in_one(files) {
            let within = |pattern: String| if folder.is_empty() { pattern } else { format!("{folder}/{pattern}") };
            found.push((within(left), within(right)));
        }
    }
    found
}

fn all_of(files: &[&str]) -> String {
    match ending(files) {
        Some(ending) => format!("*.{ending}"),
        None => "*".to_owned(),
    }
}

fn in_one(files: &[&str]) -> Option<(String, String)> {
    let names: BTreeSet<&str> = files.iter().copied().collect();
    let is_there = |name: &str| names.contains(name);
    // By the two sides' words: the text before and after the word, of each file.
    let mut by_side: BTreeMap<(String, String), Vec<(&str, &str)>> = BTreeMap::new();
    for file in files {
        for other in sides::others(file) {
            if is_there(&other.right) && !other.follows(&is_there) {
                let parts = (&file[..other.at], &file[other.at + other.left_word.len()..]);
                by_side.entry((other.left_word, other.right_word)).or_default().push(parts);
            }
        }
    }
    // The side that most files have; of as many the first.
    let ((a, b), parts) = by_side.into_iter().rev().max_by_key(|(_, parts)| parts.len())?;
    if let [(before, after)] = parts.as_slice() {
        return Some((format!("{before}{a}{after}"), format!("{before}{b}{after}")));
    }
    let same = |text: &dyn Fn(&(&str, &str)) -> String| {
        let first = text(parts.first()?);
        parts.iter().all(|part| text(part) == first).then_some(first)
    };
    let ending = ending(files)?;
    // A separator that all have belongs to the side's name: `*_left.png`.
    let last = |part: &(&str, &str)| {
        part.0.chars().last().filter(|c| !c.is_alphanumeric()).map_or_else(String::new, String::from)
    };
    let first = |part: &(&str, &str)| {
        part.1.chars().next().filter(|c| "_-".contains(*c)).map_or_else(String::new, String::from)
    };
    let (before, after) = (same(&|part| part.0.to_owned()), same(&|part| part.1.to_owned()));
    let (last, first) = (same(&last).unwrap_or_default(), same(&first).unwrap_or_default());
    let pattern = |side: &str| match (&before, &after) {
        (_, Some(after)) => format!("*{last}{side}{after}"),
        (Some(before), None) => format!("{before}{side}{first}*.{ending}"),
        (None, None) => format!("*{last}{side}{first}*.{ending}"),
    };
    Some((pattern(&a), pattern(&b)))
}

fn truths(
    folders: &BTreeMap<String, Vec<String>>,
    of_images: &BTreeMap<&str, Vec<&str>>,
    left: &str,
    pairs: &[(String, String)],
) -> Vec<String> {
    let folder_of = |pattern: &str| pattern.rsplit_once('/').map_or(String::new(), |(folder, _)| folder.to_owned());
    let own = folder_of(left);
    let above = own.rsplit_once('/').map_or("", |(above, _)| above);
    let is_of_a_pair = |folder: &str| pairs.iter().any(|(l, r)| folder_of(l) == folder || folder_of(r) == folder);
    let count = of_images.get(own.as_str()).map_or(0, Vec::len);
    let mut lines = Vec::new();
    for (folder, files) in folders {
        let is_beside = folder.starts_with(above) && !is_of_a_pair(folder);
        let name = folder[above.len().min(folder.len())..].to_ascii_lowercase();
        let Some((_, unit)) = TRUTHS.iter().find(|(word, _)| name.contains(word)).filter(|_| is_beside) else {
            continue;
        };
        let of_truth: Vec<&str> = files.iter().map(String::as_str).filter(|file| has_ending(file, &OF_TRUTH)).collect();
        let Some(ending) = ending(&of_truth).filter(|_| of_truth.len() <= count) else { continue };
        let of_floats = matches!(ending.to_ascii_lowercase().as_str(), "pfm" | "npy");
        let (unit, more) = match (*unit, of_floats) {
            (Some("pixels"), false) => ("pixels, divide_by: 256", "or another divisor"),
            (Some("pixels"), true) => ("pixels", "of disparity"),
            (Some(_), true) => ("metres", "or millimetres"),
            (Some(_), false) => ("millimetres", "or metres; of disparity pixels"),
            (None, true) => ("metres", "or millimetres, or pixels of disparity"),
            (None, false) => ("millimetres", "or metres; of disparity `pixels, divide_by: 256`"),
        };
        lines.push(format!(
            "ground_truth: {{ files: {}, unit: {unit} }}   # {more}",
            json!(format!("{folder}/*.{ending}"))
        ));
    }
    lines
}

fn lists(root: &Path, folders: &BTreeMap<String, Vec<String>>) -> Vec<String> {
    let of_root = folders.get("").into_iter().flatten().filter(|file| has_ending(file, &["csv"]));
    let is_list = |file: &&String| {
        let Ok(file) = depthloom_graphs::regular_file::open(&root.join(file)) else { return false };
        let mut head = Vec::new();
        let read = std::io::Read::read_to_end(&mut std::io::Read::take(file, 1024), &mut head);
        let text = String::from_utf8_lossy(&head);
        let columns: Vec<&str> =
            text.lines().next().unwrap_or_default().trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
        let has = |name: &str| columns.iter().any(|column| column.trim_matches('"').eq_ignore_ascii_case(name));
        read.is_ok()
            && has("left")
            && has("right")
            && text.lines().filter(|line| !line.trim().is_empty()).nth(1).is_some()
    };
    of_root.take(MOST_LISTS).filter(is_list).cloned().collect()
}

fn ending(files: &[&str]) -> Option<String> {
    let ending = |file: &&str| file.rsplit_once('.').map(|(_, ending)| ending.to_owned());
    let first = files.first().and_then(ending)?;
    files.iter().all(|file| ending(file).as_ref() == Some(&first)).then_some(first)
}

fn has_ending(file: &str, endings: &[&str]) -> bool {
    file.rsplit_once('.').is_some_and(|(_, ending)| endings.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

fn list(folder: &Path, name: String, deep: usize, left: &mut usize, into: &mut BTreeMap<String, Vec<String>>) {
    let Ok(listing) = std::fs::read_dir(folder) else { return };
    let mut files = Vec::new();
    for entry in listing.flatten() {
        let Ok(file) = entry.file_name().into_string() else { continue };
        let Ok(kind) = entry.file_type() else { continue };
        if file.starts_with('.') || *left == 0 {
            continue;
        }
        *left -= 1;
        if !kind.is_dir() {
            files.push(file);
        } else if deep > 0 {
            let within = if name.is_empty() { file.clone() } else { format!("{name}/{file}") };
            list(&entry.path(), within, deep - 1, left, into);
        }
    }
    files.sort_unstable();
    into.insert(name, files);
}

fn calibration(root: &Path, folders: &BTreeMap<String, Vec<String>>) -> Option<Vec<String>> {
    let paths = |(folder, files): (&String, &Vec<String>)| -> Vec<String> {
        let texts = files.iter().filter(|file| has_ending(file, &CALIBRATIONS));
        texts.map(|file| if folder.is_empty() { file.clone() } else { format!("{folder}/{file}") }).collect()
    };
    // Data sets have few such files; folders of a thousand labels are something else.
    let names: Vec<String> = folders.iter().flat_map(paths).take(40).collect();
    let read = |name: &String| std::fs::read(root.join(name)).ok().filter(|bytes| bytes.len() < 1 << 20);
    let texts: Vec<(&String, Vec<u8>)> = names.iter().filter_map(|name| Some((name, read(name)?))).collect();
    let is_one = |files: &[&(&String, Vec<u8>)]| {
        let files: Vec<(&Path, &[u8])> =
            files.iter().map(|(name, bytes)| (Path::new(name.as_str()), bytes.as_slice())).collect();
        camera_files::read(&files, false)
            .is_ok_and(|pair| pair.pose.is_some() || pair.cameras.iter().all(|camera| camera.rectified.is_some()))
    };
    let found = |files: &[&(&String, Vec<u8>)]| files.iter().map(|(name, _)| (*name).clone()).collect();
    if let Some(one) = texts.iter().find(|one| is_one(&[one])) {
        return Some(found(&[one]));
    }
    // Left before right, cam0 before cam1, and of OpenCV's two in either order.
    let pairs = texts.iter().enumerate().flat_map(|(at, one)| texts[at + 1..].iter().map(move |other| [one, other]));
    pairs.into_iter().find(|pair| is_one(pair)).map(|pair| found(&pair))
}

#[cfg(test)]
mod tests {
    use super::recognise;

    #[test]
    fn the_two_sides_have_many_names() {
        let recognised = |files: &[&str]| {
            let root = tempfile::tempdir().expect("a folder");
            for file in files {
                let path = root.path().join(file);
                std::fs::create_dir_all(path.parent().expect("it has one")).expect("made");
                std::fs::write(path, "").expect("written");
            }
            let describe = |found: depthloom_graphs::contracts::Recognised| {
                format!(
                    "{} {}",
                    found.params["left"].as_str().unwrap_or(""),
                    found.params["right"].as_str().unwrap_or("")
                )
            };
            recognise(root.path()).into_iter().map(describe).collect::<Vec<_>>()
        };
        assert_eq!(
            recognised(&["mav0/cam0/data/1.png", "mav0/cam1/data/1.png"]),
            ["mav0/cam0/data/*.png mav0/cam1/data/*.png"]
        );
        assert_eq!(recognised(&["left/a.jpg", "right/b.jpg", "depth/a.png"]), ["left/*.jpg right/*.jpg"]);
        assert_eq!(recognised(&["1_left.png", "1_right.png", "2_left.png", "2_right.png"]), ["*_left.png *_right.png"]);
        assert_eq!(recognised(&["left1.png", "right1.png", "left2.png", "right2.png"]), ["left*.png right*.png"]);
        assert_eq!(recognised(&["im0.png", "im1.png", "calib.txt"]), ["im0.png im1.png"]);
        assert_eq!(recognised(&["camA/1.png", "camB/1.png", "gt/1.png"]), ["camA/*.png camB/*.png"]);
        assert_eq!(recognised(&["L1.png", "R1.png", "L2.png", "R2.png"]), ["L*.png R*.png"]);
        let karlsruhe = ["I1_000000.png", "I1_000001.png", "I2_000000.png", "I2_000001.png", "calib.txt"];
        assert_eq!(recognised(&karlsruhe), ["I1_*.png I2_*.png"]);
        assert_eq!(recognised(&["1_l.png", "1_r.png", "2_l.png", "2_r.png"]), ["*_l.png *_r.png"]);
        assert_eq!(recognised(&["x/L/1.jpg", "x/R/1.jpg"]), ["x/L/*.jpg x/R/*.jpg"]);
        assert_eq!(recognised(&["cam1/1.png", "cam2/1.png"]), ["cam1/*.png cam2/*.png"]);
        let four = ["image_0/1.png", "image_1/1.png", "image_2/1.png", "image_3/1.png"];
        assert_eq!(recognised(&four), ["image_0/*.png image_1/*.png", "image_2/*.png image_3/*.png"]);
        assert_eq!(recognised(&["left/a.jpg", "left/b.png", "right/a.jpg", "right/b.png"]), ["left/* right/*"]);
        assert_eq!(recognised(&["LEFT/1.png", "RIGHT/1.png"]), ["LEFT/*.png RIGHT/*.png"]);
        assert!(recognised(&["a.png", "b.png", "left.png"]).is_empty());
        // Frames of one camera, and of two drives.
        assert!(recognised(&["im0.png", "im1.png", "im2.png", "im3.png"]).is_empty());
        assert!(recognised(&["a/1.png", "b/1.png", "run_0/1.png", "run_1/1.png"]).is_empty());
        assert!(recognised(&[]).is_empty());
    }

    #[test]
    fn images_of_a_single_camera_are_recognised_by_their_ground_truth() {
        let root = tempfile::tempdir().expect("a folder");
        for file in
            ["scene/rgb/1.png", "scene/rgb/2.png", "scene/depth/1.png", "scene/depth/2.png", "scene/notes/a.png"]
        {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().expect("it has one")).expect("made");
            std::fs::write(path, "").expect("written");
        }
        let found = recognise(root.path());
        let described: Vec<(&str, &str)> = found
            .iter()
            .map(|one| (one.params["left"].as_str().unwrap_or(""), one.alternatives.last().map_or("", String::as_str)))
            .collect();
        let truth =
            "ground_truth: { files: \"scene/depth/*.png\", unit: millimetres }   # or metres; of disparity pixels";
        assert_eq!(described, [("scene/rgb/*.png", truth)]);
    }

    #[test]
    fn ground_truth_and_lists_are_offered() {
        let root = tempfile::tempdir().expect("a folder");
        for file in ["camA/1.png", "camB/1.png", "gt/1.png", "disp/1.pfm", "notes/1.png"] {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().expect("it has one")).expect("made");
            std::fs::write(path, "").expect("written");
        }
        std::fs::write(root.path().join("pairs.csv"), "left,right\ncamA/1.png,camB/1.png\n").expect("written");
        std::fs::write(root.path().join("other.csv"), "time,left\n1,2\n").expect("written");
        let found = recognise(root.path());
        let expected = [
            "calibration: { focal_px: 700, baseline_m: 0.12 }   # yours, of a rectified pair; or { files: [left.yaml, right.yaml] }",
            "ground_truth: { files: \"disp/*.pfm\", unit: pixels }   # of disparity",
            "ground_truth: { files: \"gt/*.png\", unit: millimetres }   # or metres; of disparity `pixels, divide_by: 256`",
            "list: \"pairs.csv\"   # in place of left and right",
        ];
        assert_eq!(found[0].alternatives, expected);
        std::fs::remove_dir_all(root.path().join("camB")).expect("removed");
        assert_eq!(recognise(root.path())[0].params["list"], "pairs.csv");
    }
}
