//! OpenCV's `FileStorage` of a stereo calibration, with the names of its samples (intrinsics.yml, extrinsics.yml) and
//! other
//! common ones: K1, cameraMatrix1, distCoeffs1.

use depthloom_graphs::Fault;

use crate::sources::calibration::camera_files::camera::{
    CalibratedCamera, CameraPair, FORMS, camera, lens, matrix, view,
};
use crate::sources::calibration::camera_files::document::Document;

const MATRICES: [[&str; 5]; 2] =
    [["M1", "K1", "cameraMatrix1", "camera_matrix_1", "CM1"], ["M2", "K2", "cameraMatrix2", "camera_matrix_2", "CM2"]];
const COEFFICIENTS: [[&str; 4]; 2] = [
    ["D1", "distCoeffs1", "dist_coeffs_1", "distortion_coefficients_1"],
    ["D2", "distCoeffs2", "dist_coeffs_2", "distortion_coefficients_2"],
];

/// The cameras may be spread over several files.
pub(super) fn read(files: &[Document<'_>], fisheye: bool) -> Result<CameraPair, Fault> {
    // The file that has one of the names, else the first, which lacks it.
    let with = |names: &[&str]| files.iter().find(|file| file.has(names)).unwrap_or(&files[0]);
    let size = {
        let pair = with(&["image_size", "imageSize", "size"]);
        match pair.matrix::<2>(&["image_size", "imageSize", "size"])? {
            Some(size) => Some(pair.size_of(size)?),
            None => {
                let (width, height) = (["image_width", "width"], ["image_height", "height"]);
                with(&width).size(&width, &height)?
            }
        }
    };
    let one = |side: usize| -> Result<CalibratedCamera, Fault> {
        let file = with(&MATRICES[side]);
        let Some(k) = file.matrix::<9>(&MATRICES[side])? else {
            let name = MATRICES[side][0];
            // Any of several files could have held it.
            let others: Vec<String> =
                files[1..].iter().map(|file| format!(", nor in {}", file.path().display())).collect();
            let what = format!("there is no camera matrix `{name}`{}", others.concat());
            return Err(file.fault(what).remedy(FORMS));
        };
        let of_lens = with(&COEFFICIENTS[side]);
        let coefficients = of_lens.list(&COEFFICIENTS[side])?.unwrap_or_default();
        let lens = lens(if fisheye { "fisheye" } else { "opencv" }, &coefficients).map_err(|what| {
            of_lens
                .fault(format!("`{}`: {what}", COEFFICIENTS[side][0]))
                .remedy("rectify the images with the tool that calibrated them, and set `rectified: true`")
        })?;
        let (r, p) = ([["R1"], ["R2"]][side], [["P1"], ["P2"]][side]);
        let rectified = match (with(&r).matrix::<9>(&r)?, with(&p).matrix::<12>(&p)?) {
            (Some(r), Some(p)) => Some(view(&r, &p)),
            _ => None,
        };
        Ok(CalibratedCamera { size, camera: camera(&k, lens), rectified })
    };
    let cameras = [one(0)?, one(1)?];
    let pose = match (with(&["R"]).matrix::<9>(&["R"])?, with(&["T"]).matrix::<3>(&["T"])?) {
        (Some(r), Some(t)) => Some((matrix(&r), t)),
        _ => None,
    };
    Ok(CameraPair { cameras, pose, in_metres: false })
}
