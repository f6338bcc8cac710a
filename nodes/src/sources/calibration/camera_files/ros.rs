//! ROS' `camera_info` YAML (`camera_calibration_parsers`), one file per camera, or a printed `sensor_msgs/CameraInfo`.

use depthloom_graphs::Fault;

use crate::sources::calibration::camera_files::camera::{CalibratedCamera, CameraPair, FORMS, camera, lens, view};
use crate::sources::calibration::camera_files::document::Document;

const MATRIX: [&str; 3] = ["camera_matrix", "k", "K"];
const COEFFICIENTS: [&str; 3] = ["distortion_coefficients", "d", "D"];
const ROTATION: [&str; 3] = ["rectification_matrix", "r", "R"];
const PROJECTION: [&str; 3] = ["projection_matrix", "p", "P"];

pub(super) fn is(file: &Document<'_>) -> bool {
    file.has(&MATRIX) && file.has(&PROJECTION)
}

pub(super) fn missing(file: &Document<'_>) -> String {
    let names = [MATRIX, COEFFICIENTS, ROTATION, PROJECTION];
    let missing: Vec<String> =
        names.iter().filter(|names| !file.has(*names)).map(|names| format!("`{}`", names[0])).collect();
    format!("there is no {}", missing.join(" and no "))
}

pub(super) fn read(files: [&Document<'_>; 2]) -> Result<CameraPair, Fault> {
    let [left, right] = files.map(|file| -> Result<CalibratedCamera, Fault> {
        let missing = |name: &str| file.fault(format!("there is no `{name}`")).remedy(FORMS);
        let k = file.matrix::<9>(&MATRIX)?.ok_or_else(|| missing(MATRIX[0]))?;
        let p = file.matrix::<12>(&PROJECTION)?.ok_or_else(|| missing(PROJECTION[0]))?;
        let r = file.matrix::<9>(&ROTATION)?.ok_or_else(|| missing(ROTATION[0]))?;
        let model = file.text(&["distortion_model"]).unwrap_or_default();
        let lens = lens(model, &file.list(&COEFFICIENTS)?.unwrap_or_default())
            .map_err(|what| file.fault(what).remedy("rectify the images with image_proc, and set `rectified: true`"))?;
        let size = file.size(&["image_width", "width"], &["image_height", "height"])?;
        Ok(CalibratedCamera { size, camera: camera(&k, lens), rectified: Some(view(&r, &p)) })
    });
    Ok(CameraPair { cameras: [left?, right?], pose: None, in_metres: true })
}
