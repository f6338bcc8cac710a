//! How people call left and right cameras in the names of folders and files.

/// Anywhere in a name: `leftImg8bit`, `cam_left`.
const ANYWHERE: [[&str; 2]; 4] = [["left", "right"], ["Left", "Right"], ["LEFT", "RIGHT"], ["infra1", "infra2"]];

/// As words of their own: `L1`, `000_l`.
const ALONE: [[&str; 2]; 2] = [["l", "r"], ["L", "R"]];

/// Behind a camera's word: `camA`, `cam0`, `image_02`. Earlier pairs win.
const NUMBERED: [[&str; 2]; 8] =
    [["0", "1"], ["00", "01"], ["2", "3"], ["02", "03"], ["a", "b"], ["A", "B"], ["1", "2"], ["01", "02"]];

/// Words that number cameras and their images. A drive or a run is not a camera.
const CAMERAS: [&str; 10] = ["cam", "camera", "image", "im", "img", "view", "sensor", "eye", "video", "i"];

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Other {
    /// Byte offset in the left name.
    pub at: usize,
    pub left_word: String,
    pub right_word: String,
    pub right: String,
    /// Names that would make this a longer series (`cam0` before `cam1`), in which the two are not a pair.
    unless: Vec<String>,
}

impl Other {
    pub(super) fn follows(&self, is_there: &impl Fn(&str) -> bool) -> bool {
        self.unless.iter().any(|name| is_there(name))
    }
}

pub(super) fn others(name: &str) -> Vec<Other> {
    let mut found = Vec::new();
    let mut add = |at: usize, left: &str, right: &str, unless: &[&str]| {
        let with = |word: &str| format!("{}{word}{}", &name[..at], &name[at + left.len()..]);
        found.push(Other {
            at,
            left_word: left.to_owned(),
            right_word: right.to_owned(),
            right: with(right),
            unless: unless.iter().map(|word| with(word)).collect(),
        });
    };
    for [left, right] in ANYWHERE {
        if let Some(at) = name.rfind(left) {
            add(at, left, right, &[]);
        }
    }
    let words = words(name);
    for (which, (at, word)) in words.iter().enumerate().rev() {
        for [left, right] in ALONE {
            if *word == left {
                add(*at, left, right, &[]);
            }
        }
        let is_camera = which > 0 && CAMERAS.contains(&words[which - 1].1.to_ascii_lowercase().as_str());
        for [left, right] in NUMBERED.into_iter().filter(|[left, _]| is_camera && left == word) {
            // `im0`, `im1`, `im2` are frames; but KITTI has four cameras.
            let unless: &[&str] = match left {
                "1" => &["0", "3"],
                "01" => &["00", "03"],
                "2" if words[which - 1].1 == "im" => &["1", "4"],
                "2" | "02" => &[],
                "0" if words[which - 1].1.starts_with("im") && !words[which - 1].1.starts_with("image") => &["2"],
                _ => &[],
            };
            add(*at, left, right, unless);
        }
    }
    found
}

/// Runs of small letters with a leading capital, of capitals, or of digits, with their offsets.
fn words(name: &str) -> Vec<(usize, &str)> {
    #[derive(PartialEq, Clone, Copy)]
    enum Class {
        Small,
        Capital,
        Digit,
        Other,
    }
    let class = |c: char| match c {
        c if c.is_ascii_digit() => Class::Digit,
        c if c.is_uppercase() => Class::Capital,
        c if c.is_alphabetic() => Class::Small,
        _ => Class::Other,
    };
    let letters: Vec<(usize, Class)> = name.char_indices().map(|(at, c)| (at, class(c))).collect();
    let mut found = Vec::new();
    let mut start = 0;
    for end in 1..=letters.len() {
        let goes_on = end < letters.len() && {
            let (one, next) = (letters[end - 1].1, letters[end].1);
            one == next || one == Class::Capital && next == Class::Small && end - start == 1
        };
        if !goes_on {
            let to = letters.get(end).map_or(name.len(), |(at, _)| *at);
            if letters[start].1 != Class::Other {
                found.push((letters[start].0, &name[letters[start].0..to]));
            }
            start = end;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::{others, words};

    fn rights(name: &str) -> Vec<String> {
        others(name).into_iter().map(|other| other.right).collect()
    }

    #[test]
    fn a_name_has_words() {
        let texts = |name| words(name).into_iter().map(|(_, word)| word).collect::<Vec<_>>();
        assert_eq!(texts("camA"), ["cam", "A"]);
        assert_eq!(texts("leftImg8bit_02"), ["left", "Img", "8", "bit", "02"]);
        assert_eq!(texts("L1.png"), ["L", "1", "png"]);
        assert_eq!(texts("_ä-ß"), ["ä", "ß"]);
        assert!(texts("").is_empty());
    }

    #[test]
    fn the_other_side_has_the_same_name_except_for_one_word() {
        assert_eq!(rights("run1/camA/data"), ["run1/camB/data"]);
        assert_eq!(rights("L12.png"), ["R12.png"]);
        assert_eq!(rights("000_l.png"), ["000_r.png"]);
        assert_eq!(rights("image_02"), ["image_03"]);
        assert_eq!(rights("I1_000012.png"), ["I2_000012.png"]);
        assert_eq!(rights("my_left_camera/left"), ["my_left_camera/right"]);
        assert!(rights("seq_0").is_empty() && rights("a").is_empty() && rights("alpha/beta").is_empty());
    }
}
