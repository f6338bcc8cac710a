//! Points: `sensor_msgs/msg/PointCloud2`.

use crate::cdr::Cdr;
use crate::form::Wire;
use crate::{Form, Header, Sort};
use depthloom_graphs::ErrorMessage;

/// A cloud of points, each x, y, z in metres of its frame.
#[derive(Debug)]
pub struct PointCloud<'a> {
    /// When and in which frame.
    pub header: Header,
    /// The rows of points, checked against the length of the message.
    rows: Vec<&'a [u8]>,
    point_step: usize,
    xyz: [Coordinate; 3],
    is_big_endian: bool,
}

/// Offset of a coordinate in a point, and whether it has 8 bytes.
#[derive(Clone, Copy, Debug)]
struct Coordinate {
    offset: usize,
    is_double: bool,
}

/// `PointField`'s numbers of floats.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Reads a message of a topic of points.
pub fn point_cloud(form: Form, message: &[u8]) -> Result<PointCloud<'_>, ErrorMessage> {
    if (form.sort, form.wire) != (Sort::PointCloud, Wire::Cdr) {
        return Err(ErrorMessage::new("it is not a point cloud"));
    }
    let mut cdr = Cdr::new(message)?;
    let header = Header::cdr(&mut cdr)?;
    let (height, width) = (cdr.u32("height")?, cdr.u32("width")?);
    let mut found = [None; 3];
    let mut names = Vec::new();
    // A name's length and zero, an offset, a type, a count.
    for _ in 0..cdr.count(16, "fields")? {
        let name = cdr.text("fields.name")?;
        let (offset, datatype, _count) =
            (cdr.u32("fields.offset")?, cdr.u8("fields.datatype")?, cdr.u32("fields.count")?);
        names.push(name);
        let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) else { continue };
        if datatype != FLOAT32 && datatype != FLOAT64 {
            return Err(ErrorMessage::new(format!(
                "`{name}` is of type {datatype}, and coordinates are floats ({FLOAT32} or {FLOAT64})"
            )));
        }
        found[axis] = Some(Coordinate { offset: offset as usize, is_double: datatype == FLOAT64 });
    }
    let [Some(x), Some(y), Some(z)] = found else {
        names.truncate(16);
        return Err(ErrorMessage::new(format!("its points have the fields {}, expected x, y, z", names.join(", "))));
    };
    let is_big_endian = cdr.u8("is_bigendian")? != 0;
    let (point_step, row_step) = (cdr.u32("point_step")? as usize, cdr.u32("row_step")? as usize);
    let data = cdr.bytes("data")?;
    let end =
        [x, y, z].map(|of| of.offset.saturating_add(if of.is_double { 8 } else { 4 })).into_iter().max().unwrap_or(0);
    if end > point_step {
        return Err(ErrorMessage::new(format!("point_step is {point_step} bytes, and x, y, z end at {end}")));
    }
    let row = (width as usize).saturating_mul(point_step);
    // With one row, its length may be missing.
    let row_step = if height == 1 { row } else { row_step };
    if row_step < row {
        return Err(ErrorMessage::new(format!(
            "row_step is {row_step} bytes, and {width} points of {point_step} have {row}"
        )));
    }
    let wanted = (row_step as u64).saturating_mul(height.into());
    if (data.len() as u64) < wanted {
        let what = format!("{height} rows of {row_step} bytes are {wanted} bytes, and `data` has {}", data.len());
        return Err(ErrorMessage::new(what));
    }
    let rows = if row == 0 {
        Vec::new()
    } else {
        data.chunks_exact(row_step).take(height as usize).map(|line| &line[..row]).collect()
    };
    Ok(PointCloud { header, rows, point_step, xyz: [x, y, z], is_big_endian })
}

impl PointCloud<'_> {
    /// The points; a coordinate that is not known is NaN.
    pub fn points(&self) -> impl Iterator<Item = [f32; 3]> {
        let points = self.rows.iter().flat_map(|row| row.chunks_exact(self.point_step));
        points.map(|point| self.xyz.map(|of| self.coordinate(point, of)))
    }

    fn coordinate(&self, point: &[u8], Coordinate { offset, is_double }: Coordinate) -> f32 {
        let bytes = &point[offset..];
        if is_double {
            let array = *bytes.first_chunk().expect("it ends within the point");
            (if self.is_big_endian { f64::from_be_bytes(array) } else { f64::from_le_bytes(array) }) as f32
        } else {
            let array = *bytes.first_chunk().expect("it ends within the point");
            if self.is_big_endian { f32::from_be_bytes(array) } else { f32::from_le_bytes(array) }
        }
    }
}
