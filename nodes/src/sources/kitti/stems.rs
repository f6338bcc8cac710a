//! The image folders of KITTI's stereo benchmarks: images of frames, and files that belong to none.

use std::collections::BTreeSet;
use std::path::Path;

use depthloom_graphs::Fault;

use crate::sources::dataset::folders::entries;

/// How many unread files a warning names.
const NAMED: usize = 3;

pub(crate) struct Stems {
    pub(crate) folder: &'static str,
    /// Of the first time step (`_10`), sorted.
    pub(crate) stems: BTreeSet<String>,
    /// Files of no time step, as folder/name, sorted.
    pub(crate) others: Vec<String>,
}

impl Stems {
    pub(crate) fn list(split: &Path, folder: &'static str, layout: &str) -> Result<Self, Fault> {
        let (mut stems, mut others) = (BTreeSet::new(), Vec::new());
        for path in entries(&split.join(folder), layout)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let stem = name.strip_suffix(".png").unwrap_or_default();
            match stem.split_once('_').filter(|(number, step)| is_number(number, 6) && is_number(step, 2)) {
                Some((_, "10")) => {
                    stems.insert(stem.to_owned());
                }
                // Another time step, or a desktop's own files.
                Some(_) => {}
                None if name.starts_with('.') || matches!(name.as_str(), "Thumbs.db" | "desktop.ini") => {}
                None => others.push(format!("{folder}/{name}")),
            }
        }
        others.sort_unstable();
        Ok(Self { folder, stems, others })
    }

    /// Number and stem of each frame.
    pub(crate) fn known(&self, split: &Path, layout: &str) -> Result<Vec<(u64, &str)>, Fault> {
        if self.stems.is_empty() {
            let what = format!("{} holds no image named like 000000_10.png", split.join(self.folder).display());
            return Err(Fault::new(what).remedy(layout));
        }
        let number = |stem: &str| stem[..6].parse().expect("a stem has six digits");
        Ok(self.stems.iter().map(|stem| (number(stem), stem.as_str())).collect())
    }

    pub(crate) fn without(&self, lefts: &Self) -> Vec<String> {
        let alone = self.stems.difference(&lefts.stems).map(|stem| format!("{}/{stem}.png", self.folder));
        alone.chain(self.others.iter().cloned()).collect()
    }
}

fn is_number(text: &str, digits: usize) -> bool {
    text.len() == digits && text.bytes().all(|byte| byte.is_ascii_digit())
}

pub(crate) fn unread_files(files: &[String]) -> Option<String> {
    let named = files.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    let more = match files.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let are = match files.len() {
        0 => return None,
        1 => "1 file belongs to no frame and is".to_owned(),
        many => format!("{many} files belong to no frame and are"),
    };
    Some(format!(
        "{are} not read: {named}{more} (a frame is image_2/000150_10.png, six digits and `_10`, with files of that name in the other folders)"
    ))
}
