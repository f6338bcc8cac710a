//! A laser scan seen by a camera: sparse depth.

/// How points become pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// Points in front of the camera, at the nearest pixel (half to even); the nearest point wins a pixel.
    #[default]
    Nearest,
    /// As monodepth2's `generate_depth_map`: points with x >= 0 of the scanner, one pixel less than the nearest in row
    /// and column. Of the points that have one number `row * (width - 1) + column - 1` (which the last column shares
    /// with the first of the row below) the nearest wins the first one's pixel; a pixel keeps the last point elsewhere.
    /// Negative depths are ignored.
    Monodepth2 {
        /// Depth is the scanner's x, not the camera's z.
        scanner_depth: bool,
    },
}

/// Depth in metres of points (x forward, y left, z up, reflectance), through the 3x4 projection, row-major, from the
/// scanner to the image; NaN where no point is.
///
/// # Panics
/// If `out` is not `width * height` long.
pub fn depth_from_points(
    points: impl Iterator<Item = [f32; 4]>,
    projection: &[f64; 12],
    (width, height): (usize, usize),
    rule: Rule,
    out: &mut [f32],
) {
    assert_eq!(out.len(), width * height, "one depth a pixel");
    out.fill(f32::NAN);
    match rule {
        Rule::Nearest => nearest(points, projection, (width, height), out),
        Rule::Monodepth2 { scanner_depth } => monodepth2(points, projection, (width, height), scanner_depth, out),
    }
}

fn project([x, y, z, _]: [f32; 4], p: &[f64; 12]) -> [f64; 3] {
    let [x, y, z] = [x, y, z].map(f64::from);
    [0, 4, 8].map(|row| p[row] * x + p[row + 1] * y + p[row + 2] * z + p[row + 3])
}

/// The place of a pixel, if it is inside the image.
fn place(column: f64, row: f64, (width, height): (usize, usize)) -> Option<usize> {
    let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
    inside.then(|| row as usize * width + column as usize)
}

fn nearest(points: impl Iterator<Item = [f32; 4]>, p: &[f64; 12], size: (usize, usize), out: &mut [f32]) {
    for point in points {
        let [u, v, z] = project(point, p);
        if z <= 0.0 || z.is_nan() {
            continue;
        }
        let Some(at) = place((u / z).round_ties_even(), (v / z).round_ties_even(), size) else { continue };
        let metres = z as f32;
        if out[at].is_nan() || metres < out[at] {
            out[at] = metres;
        }
    }
}

fn monodepth2(
    points: impl Iterator<Item = [f32; 4]>,
    p: &[f64; 12],
    size: (usize, usize),
    scanner_depth: bool,
    out: &mut [f32],
) {
    /// What shares a number: how many points, the first one's pixel, and the least depth.
    #[derive(Clone, Copy)]
    struct Shared {
        count: u32,
        first: u32,
        least: f64,
    }
    let (width, height) = size;
    // Numbers run from -1.
    let none = Shared { count: 0, first: 0, least: f64::INFINITY };
    let mut shared = vec![none; 1 + (width.max(1) - 1) * height + width];
    for point in points.filter(|point| point[0] >= 0.0) {
        let [u, v, z] = project(point, p);
        let (column, row) = ((u / z).round_ties_even() - 1.0, (v / z).round_ties_even() - 1.0);
        let Some(at) = place(column, row, size) else { continue };
        let depth = if scanner_depth { f64::from(point[0]) } else { z };
        out[at] = depth as f32;
        let place = &mut shared[row as usize * (width - 1) + column as usize];
        if place.count == 0 {
            place.first = at as u32;
        }
        place.count += 1;
        place.least = place.least.min(depth);
    }
    for place in shared.iter().filter(|place| place.count > 1) {
        out[place.first as usize] = place.least as f32;
    }
    // Where nothing was written, NumPy's map holds 0, as where a depth is negative.
    out.iter_mut().filter(|metres| **metres <= 0.0).for_each(|metres| *metres = f32::NAN);
}

#[cfg(test)]
mod tests {
    use super::{Rule, depth_from_points};

    /// A camera that looks along x: focal length 2 px, principal point (2, 1).
    const PROJECTION: [f64; 12] = [2.0, -2.0, 0.0, 0.0, 1.0, 0.0, -2.0, 0.0, 1.0, 0.0, 0.0, 0.0];

    fn depths(points: &[[f32; 3]], rule: Rule) -> Vec<f32> {
        let mut out = vec![0.0; 5 * 3];
        let points = points.iter().map(|[x, y, z]| [*x, *y, *z, 1.0]);
        depth_from_points(points, &PROJECTION, (5, 3), rule, &mut out);
        out
    }

    #[test]
    fn the_nearest_point_in_front_wins_its_pixel() {
        // Straight ahead: column 2, row 1.
        let map = depths(&[[9.0, 0.0, 0.0], [4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [-4.0, 0.0, 0.0]], Rule::Nearest);
        assert_eq!(map[5 + 2], 4.0);
        assert_eq!(map.iter().filter(|metres| metres.is_finite()).count(), 1);
        // One to the left at 2 m is one column.
        assert_eq!(depths(&[[2.0, 1.0, 0.0]], Rule::Nearest)[5 + 1], 2.0);
        // Between two pixels: the even one.
        assert_eq!(depths(&[[4.0, 1.0, 0.0]], Rule::Nearest)[5 + 2], 4.0);
    }

    #[test]
    fn monodepth2_shifts_by_one_and_confuses_the_last_column_with_the_next_rows_first() {
        let rule = Rule::Monodepth2 { scanner_depth: false };
        assert_eq!(depths(&[[9.0, 0.0, 0.0], [4.0, 0.0, 0.0]], rule)[1], 4.0);
        // Column 5 less one is the last, row 1 less one the first; column 1, row 2: the first column of the second row.
        let (last, below) = ([8.0, -12.0, 0.0], [2.0, 1.0, -1.0]);
        let map = depths(&[last, below], rule);
        assert_eq!((map[4], map[5]), (2.0, 2.0), "the nearest of both at the first one's pixel");
        let map = depths(&[below, last], rule);
        assert_eq!((map[4], map[5]), (8.0, 2.0));
    }
}
