//! Zones: parts of the image that are scored separately, in addition to the whole.
//!
//! Zones may overlap, and need not cover the image. Zones that depend on a map exist only if the map does.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The parts of the image that are scored separately. The whole image is always scored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(inline)]
pub struct ZoneParams {
    /// Bounds of bands of ground-truth distance, metres, ascending: `[0, 10, 20, 30, 50, 80]` gives the zones `0..10`
    /// to `50..80`, each with its lower bound and without its upper one.
    #[schemars(inner(range(min = 0)))]
    pub distance_m: Vec<f64>,
    /// The number of bands of rows, top first: 3 gives `row_1_of_3` to `row_3_of_3`; 0: none.
    #[schemars(range(max = 64))]
    pub rows: u32,
    /// The number of bands of columns, left first: 3 gives `column_1_of_3` to `column_3_of_3`; 0:
    /// none.
    #[schemars(range(max = 64))]
    pub columns: u32,
    /// The zone `edges`, where `image` is wired: pixels whose grey changes by more than this, grey levels per pixel
    /// (the 3x3 Sobel gradient's length, divided by 8: 12.5 is 100 in OpenCV's units).
    #[schemars(range(min = 0))]
    pub edge_gradient: f64,
    /// The zone `textureless`, where `image` is wired: pixels around which grey changes along the row by less than
    /// this, grey levels per pixel (root of the mean square of the central difference over 3x3 pixels: 2 is the
    /// threshold 4 of Scharstein and Szeliski 2002).
    #[schemars(range(min = 0))]
    pub flat_gradient: f64,
}

impl Default for ZoneParams {
    fn default() -> Self {
        Self { distance_m: Vec::new(), rows: 0, columns: 0, edge_gradient: 12.5, flat_gradient: 2.0 }
    }
}

/// Maps that state which zones a pixel is in, row-major, of the size of the ground truth; 0 means none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clues<'a> {
    /// The image, grey: zones `edges` and `textureless`.
    pub grey: Option<&'a [u8]>,
    /// Pixels that the right camera does not see: zones `visible` and `occluded`.
    pub occluded: Option<&'a [u8]>,
    /// Objects (KITTI's `obj_map`): zones `background` and `foreground`.
    pub objects: Option<&'a [u8]>,
}

/// A part of the image.
#[derive(Clone, Debug)]
pub(crate) struct Zone<'a> {
    pub(crate) name: String,
    kind: Kind<'a>,
}

#[derive(Clone, Debug)]
enum Kind<'a> {
    /// Ground-truth distances from, below, metres.
    Distance(f64, f64),
    /// Positions from, below.
    Rows(usize, usize),
    /// Columns from, below; columns of the image.
    Columns(usize, usize, usize),
    /// Where a mask is set, or not.
    Mask(&'a [u8], bool),
    Computed(Vec<bool>),
}

impl Zone<'_> {
    /// Whether a pixel is in it: its row-major position, and its ground-truth distance, metres.
    pub(crate) fn has(&self, at: usize, ground_truth_m: f64) -> bool {
        match &self.kind {
            Kind::Distance(from, below) => (*from..*below).contains(&ground_truth_m),
            Kind::Rows(from, below) => (*from..*below).contains(&at),
            Kind::Columns(from, below, width) => (*from..*below).contains(&(at % width)),
            Kind::Mask(mask, set) => (mask[at] > 0) == *set,
            Kind::Computed(mask) => mask[at],
        }
    }
}

impl ZoneParams {
    /// Whether these zones can be cut.
    ///
    /// # Errors
    /// What is wrong, and the remedy.
    pub fn check(&self) -> Result<(), String> {
        if let Some(bound) = self.distance_m.iter().find(|bound| !(bound.is_finite() && **bound >= 0.0)) {
            return Err(format!("distance_m has {bound}: a bound is a distance in metres, 0 or more"));
        }
        if let [bound] = self.distance_m[..] {
            return Err(format!("distance_m has {bound} alone: a band has two bounds"));
        }
        if let Some(pair) = self.distance_m.windows(2).find(|pair| pair[0] >= pair[1]) {
            return Err(format!("distance_m has {} after {}: each bound is above the one before it", pair[1], pair[0]));
        }
        for (name, bands) in [("rows", self.rows), ("columns", self.columns)] {
            if bands > 64 {
                return Err(format!("{name} is {bands}, which is more than 64 bands"));
            }
        }
        let gradients = [("edge_gradient", self.edge_gradient), ("flat_gradient", self.flat_gradient)];
        match gradients.iter().find(|(_, levels)| !(levels.is_finite() && *levels >= 0.0)) {
            Some((name, levels)) => {
                Err(format!("{name} is {levels}: a threshold in grey levels per pixel is 0 or more"))
            }
            None => Ok(()),
        }
    }

    /// The zones of a frame.
    pub(crate) fn of_frame<'a>(&self, width: usize, height: usize, clues: &Clues<'a>) -> Vec<Zone<'a>> {
        let mut zones = Vec::new();
        let mut add = |name: String, kind| zones.push(Zone { name, kind });
        for band in self.distance_m.windows(2) {
            add(format!("{}..{}", band[0], band[1]), Kind::Distance(band[0], band[1]));
        }
        let share = |of: usize, band: u32, bands: u32| of * band as usize / bands as usize;
        for row in 0..self.rows {
            let (from, below) = (share(height, row, self.rows), share(height, row + 1, self.rows));
            add(format!("row_{}_of_{}", row + 1, self.rows), Kind::Rows(from * width, below * width));
        }
        for column in 0..self.columns {
            let (from, below) = (share(width, column, self.columns), share(width, column + 1, self.columns));
            add(format!("column_{}_of_{}", column + 1, self.columns), Kind::Columns(from, below, width));
        }
        if let Some(grey) = clues.grey {
            let (edges, textureless) = self.texture(grey, width, height);
            add("edges".to_owned(), Kind::Computed(edges));
            add("textureless".to_owned(), Kind::Computed(textureless));
        }
        if let Some(occluded) = clues.occluded {
            add("visible".to_owned(), Kind::Mask(occluded, false));
            add("occluded".to_owned(), Kind::Mask(occluded, true));
        }
        if let Some(objects) = clues.objects {
            add("background".to_owned(), Kind::Mask(objects, false));
            add("foreground".to_owned(), Kind::Mask(objects, true));
        }
        zones
    }

    /// Edges, and what has no texture. At the border pixels are repeated.
    fn texture(&self, grey: &[u8], width: usize, height: usize) -> (Vec<bool>, Vec<bool>) {
        let pixels = width * height;
        let (mut edges, mut squares) = (vec![false; pixels], vec![0_u32; pixels]);
        let edge_squared = (8.0 * self.edge_gradient).powi(2);
        for y in 0..height {
            let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|row| &grey[row * width..][..width]);
            for x in 0..width {
                let columns = [x.saturating_sub(1), x, (x + 1).min(width - 1)];
                let at = |row: usize, column: usize| i32::from(rows[row][columns[column]]);
                let across = |row: usize| at(row, 2) - at(row, 0);
                let along = |column: usize| at(2, column) - at(0, column);
                let dx = across(0) + 2 * across(1) + across(2);
                let dy = along(0) + 2 * along(1) + along(2);
                edges[y * width + x] = f64::from(dx * dx + dy * dy) > edge_squared;
                squares[y * width + x] = (across(1) * across(1)) as u32;
            }
        }
        // Central differences are twice the change per pixel, and there are nine of them.
        let flat_squared = 9.0 * (2.0 * self.flat_gradient).powi(2);
        let textureless = (0..pixels).map(|at| {
            let (y, x) = (at / width, at % width);
            let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
            let columns = [x.saturating_sub(1), x, (x + 1).min(width - 1)];
            let sum = |row: usize| -> u32 { columns.iter().map(|column| squares[row * width + column]).sum() };
            f64::from(rows.into_iter().map(sum).sum::<u32>()) < flat_squared
        });
        (edges, textureless.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PixelSet, ScoreParams};

    fn named<'a>(zones: &'a [Zone<'_>], name: &str) -> &'a Zone<'a> {
        zones.iter().find(|zone| zone.name == name).unwrap()
    }

    #[test]
    fn bands_of_distance_have_their_lower_bound_and_not_their_upper_one() {
        let params = ZoneParams { distance_m: vec![0.0, 10.0, 22.5], ..ZoneParams::default() };
        let zones = params.of_frame(4, 4, &Clues::default());
        assert_eq!(zones.iter().map(|zone| &*zone.name).collect::<Vec<_>>(), ["0..10", "10..22.5"]);
        let (near, far) = (&zones[0], &zones[1]);
        assert!(near.has(0, 9.999) && !near.has(0, 10.0) && far.has(0, 10.0) && !far.has(0, 22.5));
    }

    #[test]
    fn rows_and_columns_cut_the_image_without_a_gap() {
        let params = ZoneParams { rows: 3, columns: 2, ..ZoneParams::default() };
        let (width, height) = (5, 7);
        let zones = params.of_frame(width, height, &Clues::default());
        for at in 0..width * height {
            let count =
                |name: &str| zones.iter().filter(|zone| zone.name.starts_with(name) && zone.has(at, 1.0)).count();
            assert_eq!((count("row_"), count("column_")), (1, 1), "{at}");
        }
        // 7 rows in 3 bands: numpy's int(7 * [0, 1, 2, 3] / 3) = [0, 2, 4, 7].
        assert!(named(&zones, "row_1_of_3").has(2 * width - 1, 1.0) && named(&zones, "row_2_of_3").has(2 * width, 1.0));
        assert!(named(&zones, "column_1_of_2").has(1, 1.0) && named(&zones, "column_2_of_2").has(2, 1.0));
    }

    #[test]
    fn texture_is_found_in_the_image_and_masks_come_with_their_opposite() {
        // A plane of one grey, a step of 40 levels, and a plane again.
        let (width, height) = (9, 3);
        let grey: Vec<u8> = (0..width * height).map(|at| if at % width < 4 { 100 } else { 140 }).collect();
        let occluded: Vec<u8> = (0..width * height).map(|at| u8::from(at == 0)).collect();
        let clues = Clues { grey: Some(&grey), occluded: Some(&occluded), objects: None };
        let zones = ZoneParams::default().of_frame(width, height, &clues);
        let edges: Vec<bool> = (0..width).map(|at| named(&zones, "edges").has(at + width, 1.0)).collect();
        let flat: Vec<bool> = (0..width).map(|at| named(&zones, "textureless").has(at + width, 1.0)).collect();
        // Sobel's dx is 4 * 40 next to the step, which is 20 levels per pixel; the 3x3 window reaches one column
        // farther.
        assert_eq!(edges, [false, false, false, true, true, false, false, false, false]);
        assert_eq!(flat, [true, true, false, false, false, false, true, true, true]);
        assert!(named(&zones, "occluded").has(0, 1.0) && !named(&zones, "visible").has(0, 1.0));
        assert!(!zones.iter().any(|zone| zone.name == "foreground"), "no map, no zone");
    }

    #[test]
    fn zones_are_rows_behind_those_of_the_whole_image_and_add_up_to_it() {
        let zones = ZoneParams { distance_m: vec![0.0, 10.0, 80.0], ..ZoneParams::default() };
        use PixelSet::{All, Valid};
        let params = ScoreParams { sets: vec![All, Valid], zones, ..ScoreParams::default() };
        let (truth, estimate) = ([5.0, 15.0, 30.0, f32::NAN], [6.0, f32::NAN, 25.0, 3.0]);
        let rows = params.scores().unwrap().rows(&estimate, &truth, (4, 1), &Clues::default());
        let counts: Vec<_> = rows.iter().map(|row| (&*row.zone, row.set, row.pixels, row.truth, row.valid)).collect();
        assert_eq!(
            counts,
            [
                ("", All, 3, 3, 2),
                ("", Valid, 2, 3, 2),
                ("0..10", All, 1, 1, 1),
                ("0..10", Valid, 1, 1, 1),
                ("10..80", All, 2, 2, 1),
                ("10..80", Valid, 1, 2, 1),
            ]
        );
        assert_eq!((rows[2].score("abs_rel"), rows[5].score("abs_rel")), (Some(0.2), Some(5.0 / 30.0)));
    }

    #[test]
    fn bands_that_cannot_be_cut_are_refused() {
        let check =
            |distance_m: &[f64]| ZoneParams { distance_m: distance_m.to_vec(), ..ZoneParams::default() }.check();
        assert!(check(&[]).is_ok() && check(&[0.0, 80.0]).is_ok());
        for (wrong, what) in [
            (&[10.0][..], "distance_m has 10 alone: a band has two bounds"),
            (&[0.0, 0.0], "distance_m has 0 after 0: each bound is above the one before it"),
            (&[20.0, 10.0], "distance_m has 10 after 20: each bound is above the one before it"),
            (&[0.0, f64::INFINITY], "distance_m has inf: a bound is a distance in metres, 0 or more"),
            (&[-1.0, 3.0], "distance_m has -1: a bound is a distance in metres, 0 or more"),
        ] {
            assert_eq!(check(wrong).unwrap_err(), what);
        }
    }
}
