//! Kalibr's camchain: `cam0` is the left camera, `cam1` the right one.

use depthloom_graphs::Fault;
use depthloom_kernels::rectify::Camera;

use crate::sources::calibration::camera_files::camera::{CalibratedCamera, CameraPair, FORMS, lens};
use crate::sources::calibration::camera_files::document::Document;

pub(super) fn is(file: &Document<'_>) -> bool {
    file.has(&["cam0"])
}

pub(super) fn read(file: &Document<'_>) -> Result<CameraPair, Fault> {
    let camera = |name: &str| {
        let camera = file.within(name);
        camera.ok_or_else(|| file.fault(format!("there is no camera `{name}`")).remedy(FORMS))
    };
    let (first, second) = (camera("cam0")?, camera("cam1")?);
    let one = |name: &str, file: &Document<'_>| -> Result<CalibratedCamera, Fault> {
        let missing = |what: &str| file.fault(format!("`{name}` has no `{what}`")).remedy(FORMS);
        let model = file.text(&["camera_model"]).unwrap_or("pinhole");
        if model != "pinhole" {
            let what = format!("`{name}` has the camera model `{model}`, and only `pinhole` is known");
            return Err(file.fault(what).remedy("calibrate it as pinhole-equi or pinhole-radtan"));
        }
        let [fx, fy, cx, cy] = file.matrix(&["intrinsics"])?.ok_or_else(|| missing("intrinsics"))?;
        let coefficients = file.list(&["distortion_coeffs"])?.unwrap_or_default();
        let model = file.text(&["distortion_model"]).unwrap_or_default();
        let lens = lens(model, &coefficients).map_err(|what| file.fault(format!("`{name}`: {what}")).remedy(FORMS))?;
        let size = file.matrix(&["resolution"])?.map(|size| file.size_of(size)).transpose()?;
        let camera = Camera { focal_px: [fx, fy], centre_px: [cx, cy], lens };
        Ok(CalibratedCamera { size, camera, rectified: None })
    };
    let cameras = [one("cam0", &first)?, one("cam1", &second)?];
    let Some(t) = second.matrix::<16>(&["T_cn_cnm1"])? else {
        return Err(file.fault("`cam1` has no `T_cn_cnm1`, its pose to `cam0`").remedy(FORMS));
    };
    let rotation = std::array::from_fn(|row| std::array::from_fn(|column| t[4 * row + column]));
    Ok(CameraPair { cameras, pose: Some((rotation, [t[3], t[7], t[11]])), in_metres: true })
}
