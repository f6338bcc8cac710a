//! Writing frames in the layout of KITTI stereo 2015, for any tool that reads that benchmark.
//!
//! `<out>/training` receives `image_2`, `image_3`, `disp_occ_0`, `disp_noc_0`, `obj_map` and `calib_cam_to_cam`; the
//! source `kitti/stereo2015`
//! reads it back: the same images, and true disparities to half of 1/256 px.

use std::fmt::Write as _;
use std::fs;
use std::io::{self, Cursor, Write as _};
use std::path::{Path, PathBuf};

use depthloom_graphs::contracts::Frame;
use depthloom_graphs::values::{Calibration, Image, Mask, Pixels, TrueDisparity};
use depthloom_graphs::{Fault, Host};
use image::ImageFormat;

use depthloom_nodes::sources::{Road, SyntheticRoadParams};

/// Renders the frames of `params` into `<out>/training`; returns how many. `params.ground_truth` has no effect: both
/// kinds of ground truth are written.
///
/// The folder is written under the name `<out>.partial` and renamed when complete; an unfinished one of an earlier try
/// is removed.
///
/// # Errors
/// If `out` exists and is not empty, if the host cancels, or if a file cannot be written.
pub fn write(out: &Path, params: &SyntheticRoadParams, host: &dyn Host) -> Result<u64, Fault> {
    let road = Road::new(params);
    let frames = Road::frames(&params.frames)?;
    let mut layout = KittiFolders::create(out)?;
    let total = frames.len() as u64;
    for (done, frame) in (0..).zip(&frames) {
        if host.cancelled() {
            return Err(Fault::Cancelled);
        }
        host.progress(done, total, &frame.id);
        let view = road.frame(frame.index, host);
        layout.image("image_2", frame, &view.left)?;
        layout.image("image_3", frame, &view.right)?;
        layout.disparity("disp_occ_0", frame, &view.disparity(&view.sparse))?;
        layout.disparity("disp_noc_0", frame, &view.disparity(&view.sparse_visible))?;
        layout.objects("obj_map", frame, &view.cars)?;
        layout.calibration(frame, &view.calibration)?;
    }
    host.progress(total, total, "done");
    layout.finish()?;
    Ok(total)
}

const FOLDERS: [&str; 6] = ["image_2", "image_3", "disp_occ_0", "disp_noc_0", "obj_map", "calib_cam_to_cam"];

/// Whether a folder holds only what an interrupted run of this command leaves.
fn is_unfinished(partial: &Path) -> bool {
    let has_only = |folder: &Path, names: &[&str]| {
        fs::symlink_metadata(folder).is_ok_and(|metadata| metadata.is_dir())
            && fs::read_dir(folder).is_ok_and(|mut entries| {
                entries.all(|entry| entry.is_ok_and(|entry| names.iter().any(|name| entry.file_name() == *name)))
            })
    };
    has_only(partial, &["training"]) && has_only(&partial.join("training"), &FOLDERS)
}

struct KittiFolders {
    partial: PathBuf,
    out: PathBuf,
}

impl KittiFolders {
    fn create(out: &Path) -> Result<Self, Fault> {
        let occupied = match fs::read_dir(out) {
            Ok(mut entries) => entries.next().is_some(),
            Err(_) => out.exists(),
        };
        if occupied {
            return Err(
                Fault::new(format!("{} exists already", out.display())).remedy("name a new folder, or remove it")
            );
        }
        if out.file_name().is_none() {
            return Err(Fault::new(format!("{} names no folder", out.display())));
        }
        let partial = depthloom_durable::partial_name(out);
        if fs::symlink_metadata(&partial).is_ok() {
            if !is_unfinished(&partial) {
                return Err(Fault::new(format!(
                    "{} exists already and is not an unfinished data set",
                    partial.display()
                ))
                .remedy("name another folder, or remove it"));
            }
            fs::remove_dir_all(&partial).map_err(|error| unwritable(&partial, error))?;
        }
        if let Some(parent) = partial.parent() {
            fs::create_dir_all(parent).map_err(|error| unwritable(parent, error))?;
        }
        let training = partial.join("training");
        let folders = FOLDERS.iter().map(|folder| training.join(folder));
        for folder in [partial.clone(), training.clone()].into_iter().chain(folders) {
            depthloom_durable::create_folder(&folder).map_err(|error| unwritable(&folder, error))?;
        }
        Ok(Self { partial, out: out.to_owned() })
    }

    fn path(&self, folder: &str, file: String) -> PathBuf {
        self.partial.join("training").join(folder).join(file)
    }

    fn image(&mut self, folder: &str, frame: &Frame, image: &Image) -> Result<(), Fault> {
        let path = self.path(folder, format!("{}.png", frame.id));
        let mut bytes = Cursor::new(Vec::new());
        let encoded = match image.pixels() {
            Pixels::Grey(grey) => grey.write_to(&mut bytes, ImageFormat::Png),
            Pixels::Rgb(rgb) => rgb.write_to(&mut bytes, ImageFormat::Png),
        };
        encoded.map_err(|error| unwritable(&path, error))?;
        write_new(&path, &bytes.into_inner()).map_err(|error| unwritable(&path, error))
    }

    /// KITTI's disparity: 16 bit, 1/256 px, 0 = unknown.
    fn disparity(&mut self, folder: &str, frame: &Frame, truth: &TrueDisparity) -> Result<(), Fault> {
        let path = self.path(folder, format!("{}.png", frame.id));
        let mut bytes = Cursor::new(Vec::new());
        let px_256 = truth.px_256().ok_or_else(|| {
            Fault::new(format!(
                "{} would hold disparities that are not multiples of 1/256 px, which are 1 to 65535",
                path.display()
            ))
        })?;
        px_256.write_to(&mut bytes, ImageFormat::Png).map_err(|error| unwritable(&path, error))?;
        write_new(&path, &bytes.into_inner()).map_err(|error| unwritable(&path, error))
    }

    /// KITTI numbers the objects; here all have the number 255.
    fn objects(&mut self, folder: &str, frame: &Frame, objects: &Mask) -> Result<(), Fault> {
        self.image(folder, frame, &Image::new(Pixels::Grey(objects.set.clone())))
    }

    fn calibration(&mut self, frame: &Frame, calibration: &Calibration) -> Result<(), Fault> {
        let path = self.path("calib_cam_to_cam", format!("{:06}.txt", frame.index));
        let mut text = String::from("calib_time: synthetic\n");
        for (camera, p) in [("02", calibration.p()), ("03", calibration.p_right())] {
            let (width, height) = (calibration.width, calibration.height);
            let p: Vec<String> = p.iter().map(|number| format!("{number:e}")).collect();
            let written = writeln!(text, "S_rect_{camera}: {width} {height}\nP_rect_{camera}: {}", p.join(" "));
            written.expect("a String takes what is written");
        }
        write_new(&path, text.as_bytes()).map_err(|error| unwritable(&path, error))
    }

    fn finish(self) -> Result<(), Fault> {
        // An empty folder of that name may be there; renaming over it fails on some systems.
        let cleared = if self.out.is_dir() { fs::remove_dir(&self.out) } else { Ok(()) };
        cleared
            .and_then(|()| depthloom_durable::sync_tree(&self.partial))
            .and_then(|()| depthloom_durable::rename(&self.partial, &self.out))
            .map_err(|error| unwritable(&self.out, error))
    }
}

fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    depthloom_durable::create_new(path)?.write_all(bytes)
}

fn unwritable(path: &Path, error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Fault {
    Fault::new(format!("failed to write {}", path.display())).because(error)
}
