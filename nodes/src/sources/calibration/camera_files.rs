//! Calibrations of two cameras: OpenCV's `FileStorage` (YAML, XML, JSON), ROS' `camera_info` YAML, Kalibr's camchain.

mod camera;
mod document;
mod kalibr;
mod opencv;
mod ros;

use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_kernels::rectify::{Lens, Matrix};

pub(crate) use camera::{CalibratedCamera, CameraPair, FORMS, lens};
use document::Document;

/// `fisheye`: OpenCV's coefficients are those of its `fisheye` module, which the file does not state.
pub(crate) fn read(files: &[(&Path, &[u8])], fisheye: bool) -> Result<CameraPair, Fault> {
    let documents = files.iter().map(|(path, bytes)| Document::parse(path, bytes)).collect::<Result<Vec<_>, _>>()?;
    let pair = match documents.as_slice() {
        [one] if kalibr::is(one) => kalibr::read(one),
        [left, right] if ros::is(left) && ros::is(right) => ros::read([left, right]),
        [one] if ros::is(one) => {
            Err(one.fault("it is the calibration of one camera").remedy(format!("name both: {FORMS}")))
        }
        // One of the two is ROS': the other should be, too.
        [left, right] if ros::is(left) || ros::is(right) => {
            let (other, side) = if ros::is(left) { (right, "right") } else { (left, "left") };
            let what = format!("it is not a complete calibration of the {side} camera: {}", ros::missing(other));
            Err(other.fault(what).remedy(format!("is the file cut off? {FORMS}")))
        }
        all => opencv::read(all, fisheye),
    }?;
    let determinant = |r: &Matrix| {
        r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) - r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0])
            + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0])
    };
    if pair.pose.is_some_and(|(rotation, _)| determinant(&rotation) < 0.0) {
        return Err(documents[0]
            .fault("the rotation between the cameras is a reflection: its determinant is negative".to_owned())
            .remedy(FORMS));
    }
    for (side, camera) in pair.cameras.iter().enumerate() {
        let numbers = [camera.camera.focal_px, camera.camera.centre_px].concat();
        let lens = match &camera.camera.lens {
            Lens::Polynomial(coefficients) => coefficients.as_slice(),
            Lens::Equidistant(coefficients) => coefficients.as_slice(),
        };
        let is_sound = numbers.iter().chain(lens).all(|number| number.is_finite() && number.abs() < 1e9)
            && camera.camera.focal_px.iter().all(|focal| *focal >= 1.0);
        if !is_sound {
            let side = ["left", "right"][side];
            return Err(documents[side_file(side, &documents)]
                .fault(format!("the numbers of the {side} camera are not plausible: focal lengths {:?} px, principal point {:?} px, lens {lens:?}",
                    camera.camera.focal_px, camera.camera.centre_px))
                .remedy(FORMS));
        }
    }
    Ok(pair)
}

fn side_file(side: &str, documents: &[Document<'_>]) -> usize {
    if side == "right" && documents.len() == 2 && ros::is(&documents[1]) { 1 } else { 0 }
}
