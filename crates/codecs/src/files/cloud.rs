//! Depths as point clouds, in PLY and PCD.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Image, Pixels};

use super::floats::floats;

/// Points in the left camera's frame, metres: x to the right, y down, z forward.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// x, y and z of each point, in the order of its pixels, row by row.
    pub points: Vec<[f32; 3]>,
    /// Red, green and blue of each, if there was an image.
    pub colours: Option<Vec<[u8; 3]>>,
}

impl Cloud {
    /// The pixels of a depth, or of a disparity by `z = f B / (d + doffs)`, whose `z` is above zero and in `range_m`,
    /// both ends included: `x = (u - cx) z / f`, `y = (v - cy) z / f`. Coloured by the image.
    pub fn new(
        value: &Value,
        calibration: &Calibration,
        image: Option<&Image>,
        range_m: (f64, f64),
    ) -> Result<Self, String> {
        Self::of_each(1, value, calibration, image, range_m)
    }

    /// As [`Cloud::new`], of the first of each `step` columns and rows.
    pub fn of_each(
        step: u32,
        value: &Value,
        calibration: &Calibration,
        image: Option<&Image>,
        range_m: (f64, f64),
    ) -> Result<Self, String> {
        let is_disparity = matches!(value, Value::Disparity(_) | Value::FloatDisparity(_) | Value::TrueDisparity(_));
        let map = floats(value).filter(|_| is_disparity || matches!(value, Value::Depth(_) | Value::RelativeDepth(_)));
        let map = map.ok_or_else(|| format!("a value of type {} has no points", value.value_type()))?;
        if is_disparity && calibration.is_single_camera() {
            return Err(
                "a disparity has no points without a baseline: the calibration is that of a single camera".to_owned()
            );
        }
        let (width, height) = map.dimensions();
        let others =
            [("calibration", Some((calibration.width, calibration.height))), ("image", image.map(Image::dimensions))];
        for (what, size) in others {
            if let Some((w, h)) = size.filter(|size| *size != (width, height)) {
                return Err(format!("the {what} is for {w}x{h} pixels, and the map has {width}x{height}"));
            }
        }
        let mut cloud = Self { points: Vec::new(), colours: image.map(|_| Vec::new()) };
        let is_taken = |column: u32, row: u32| column.is_multiple_of(step) && row.is_multiple_of(step);
        for (column, row, sample) in map.enumerate_pixels().filter(|(column, row, _)| is_taken(*column, *row)) {
            let sample = f64::from(sample.0[0]);
            // A disparity of minus `doffs` is infinitely far, and one below behind the camera.
            let z = if is_disparity { calibration.depth_m(sample) } else { sample };
            if !(z.is_finite() && z > 0.0 && z >= range_m.0 && z <= range_m.1) {
                continue;
            }
            let x = (f64::from(column) - calibration.cx_px) * z / calibration.focal_px;
            let y = (f64::from(row) - calibration.cy_px) * z / calibration.focal_px;
            cloud.points.push([x as f32, y as f32, z as f32]);
            if let (Some(colours), Some(image)) = (&mut cloud.colours, image) {
                colours.push(match image.pixels() {
                    Pixels::Grey(grey) => [grey[(column, row)].0[0]; 3],
                    Pixels::Rgb(rgb) => rgb[(column, row)].0,
                });
            }
        }
        Ok(cloud)
    }

    /// Without the points at these depths: where depth is capped, everything beyond the cap is a wall at it.
    #[must_use]
    pub fn without(mut self, depths_m: &[f32]) -> Self {
        let is_kept: Vec<bool> = self.points.iter().map(|[_, _, z]| !depths_m.contains(z)).collect();
        let mut flags = is_kept.iter().copied();
        self.points.retain(|_| flags.next() == Some(true));
        if let Some(colours) = &mut self.colours {
            let mut flags = is_kept.into_iter();
            colours.retain(|_| flags.next() == Some(true));
        }
        self
    }

    /// Appends all points, each with its colour as `colour` writes it.
    fn put<const N: usize>(&self, file: &mut Vec<u8>, colour: impl Fn([u8; 3]) -> [u8; N]) {
        file.reserve(self.points.len() * (12 + N));
        for (index, point) in self.points.iter().enumerate() {
            file.extend(point.iter().flat_map(|metres| metres.to_le_bytes()));
            if let Some(colours) = &self.colours {
                file.extend(colour(colours[index]));
            }
        }
    }
}

/// A cloud as PLY: binary, little-endian; `x`, `y`, `z` as floats and, where there are colours, `red`, `green`, `blue`
/// as bytes.
#[must_use]
pub fn ply(cloud: &Cloud) -> Vec<u8> {
    let mut text = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", cloud.points.len());
    ["x", "y", "z"].iter().for_each(|axis| text.push_str(&format!("property float {axis}\n")));
    if cloud.colours.is_some() {
        ["red", "green", "blue"].iter().for_each(|colour| text.push_str(&format!("property uchar {colour}\n")));
    }
    text.push_str("end_header\n");
    let mut file = text.into_bytes();
    cloud.put(&mut file, |colour| colour);
    file
}

/// A cloud as PCD 0.7, binary: `x y z` and, where there are colours, `rgb`, the bits 0x00RRGGBB of a float, as PCL has
/// it. <https://pointclouds.org/documentation/tutorials/pcd_file_format.html>
#[must_use]
pub fn pcd(cloud: &Cloud) -> Vec<u8> {
    let (count, fields) = (cloud.points.len(), 3 + usize::from(cloud.colours.is_some()));
    let names = ["x", "y", "z", "rgb"][..fields].join(" ");
    let each = |word: &str| vec![word; fields].join(" ");
    let (sizes, types, counts) = (each("4"), each("F"), each("1"));
    let text = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {names}\nSIZE {sizes}\nTYPE {types}\nCOUNT {counts}\n\
         WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    );
    let mut file = text.into_bytes();
    cloud.put(&mut file, |[red, green, blue]| [blue, green, red, 0]);
    file
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Value;
    use depthloom_graphs::values::{Calibration, Depth, Disparity, Image, Pixels, Raster};
    use image::RgbImage;

    use super::{Cloud, pcd, ply};

    const CALIBRATION: Calibration =
        Calibration { width: 3, height: 2, focal_px: 2.0, cx_px: 1.0, cy_px: 0.5, baseline_m: 0.5, doffs_px: 0.0 };
    const ALL: (f64, f64) = (0.0, f64::INFINITY);

    fn depth() -> Value {
        let metres = vec![2.0, f32::NAN, 4.0, -1.0, f32::INFINITY, 80.0];
        Depth { metres: Raster::from_raw(3, 2, metres).unwrap() }.into()
    }

    fn image() -> Image {
        Image::new(Pixels::Rgb(RgbImage::from_raw(3, 2, (0..18).collect()).unwrap()))
    }

    #[test]
    fn valid_pixels_are_points_in_front_of_the_camera() {
        let cloud = Cloud::new(&depth(), &CALIBRATION, Some(&image()), ALL).unwrap();
        assert_eq!(cloud.points, [[-1.0, -0.5, 2.0], [2.0, -1.0, 4.0], [40.0, 20.0, 80.0]]);
        assert_eq!(cloud.colours, Some(vec![[0, 1, 2], [6, 7, 8], [15, 16, 17]]));
        let first = cloud.points[0][2];
        let without = cloud.clone().without(&[first]);
        assert!(!without.points.is_empty() && without.points.iter().all(|point| point[2] != first), "fault 69");
        assert_eq!(without.colours.map(|colours| colours.len()), Some(without.points.len()));
        let near = Cloud::new(&depth(), &CALIBRATION, None, (2.0, 4.0)).unwrap();
        assert_eq!((near.points.as_slice(), near.colours), (&cloud.points[..2], None));
        // f B = 1: a disparity of half a pixel is two metres away; none, zero and less are nowhere.
        let sixteenths_px = Raster::from_raw(3, 2, vec![8, -32, 4, 0, -5, -32]).unwrap();
        let disparity = Value::from(Disparity { sixteenths_px, min_disparity_px: -1 });
        let of_disparity = Cloud::new(&disparity, &CALIBRATION, None, ALL).unwrap();
        assert_eq!(of_disparity.points, cloud.points[..2]);
        // With the principal points a quarter of a pixel apart, a quarter of a pixel is two metres.
        let apart = Calibration { doffs_px: 0.25, ..CALIBRATION };
        let sixteenths_px = Raster::from_raw(3, 2, vec![4, -32, 0, -4, -5, -32]).unwrap();
        let disparity = Value::from(Disparity { sixteenths_px, min_disparity_px: -1 });
        assert_eq!(Cloud::new(&disparity, &apart, None, ALL).unwrap().points, cloud.points[..2]);
    }

    #[test]
    fn values_of_another_size_are_refused() {
        let small = Calibration { width: 2, ..CALIBRATION };
        let refused = Cloud::new(&depth(), &small, None, ALL).unwrap_err();
        assert_eq!(refused, "the calibration is for 2x2 pixels, and the map has 3x2");
        assert!(Cloud::new(&image().into(), &CALIBRATION, None, ALL).is_err());
    }

    #[test]
    fn both_formats_say_how_many_points_there_are_and_hold_them() {
        let cloud = Cloud::new(&depth(), &CALIBRATION, Some(&image()), ALL).unwrap();
        let (ply, pcd) = (ply(&cloud), pcd(&cloud));
        let body = |file: &[u8], end: &str| {
            let text = String::from_utf8_lossy(file).into_owned();
            let at = text.find(end).unwrap() + end.len();
            (text[..at].to_owned(), file[at..].to_vec())
        };
        let (head, points) = body(&ply, "end_header\n");
        assert!(
            head.starts_with("ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"),
            "{head}"
        );
        assert_eq!(points.len(), 3 * 15);
        assert_eq!(points[..15], [&[-1.0_f32, -0.5, 2.0].map(f32::to_le_bytes).concat()[..], &[0, 1, 2]].concat());
        let (head, points) = body(&pcd, "DATA binary\n");
        assert!(head.contains("\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\n"), "{head}");
        assert_eq!(points.len(), 3 * 16);
        assert_eq!(points[12..16], 0x0000_0102_u32.to_le_bytes());
    }
}
