//! The mosaic of a colour sensor (`bayer_rggb8` and its like), as OpenCV's bilinear `demosaicing` fills it in.
//! <https://docs.opencv.org/4.x/de/d25/imgproc_color_conversions.html#color_convert_bayer>

use depthloom_graphs::ErrorMessage;

/// Which of the four places of a mosaic's upper left square are red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mosaic {
    /// Column and row of red in the square; blue is diagonally opposite.
    red: (usize, usize),
    /// Bytes of a sample.
    pub bytes: usize,
}

impl Mosaic {
    /// The mosaic that an encoding of ROS 2 or Foxglove names; `None` if it names none.
    pub(crate) fn named(encoding: &str) -> Option<Self> {
        let (order, bits) = encoding.strip_prefix("bayer_")?.split_at_checked(4)?;
        let red = match order {
            "rggb" => (0, 0),
            "grbg" => (1, 0),
            "gbrg" => (0, 1),
            "bggr" => (1, 1),
            _ => return None,
        };
        let bytes = match bits {
            "8" => 1,
            "16" => 2,
            _ => return None,
        };
        Some(Self { red, bytes })
    }

    /// Red, green and blue of each pixel, row by row, from one sample per pixel. The missing two are means of the
    /// nearest samples, rounded half up; the outermost rows and columns repeat their inner neighbours.
    pub(crate) fn colours(self, samples: &[u16], width: u32, height: u32) -> Result<Vec<u16>, ErrorMessage> {
        if width < 3 || height < 3 {
            return Err(ErrorMessage::new(format!(
                "its mosaic is {width}x{height}, and at least 3x3 pixels are needed"
            )));
        }
        let (width, height) = (width as usize, height as usize);
        let mut rgb = Vec::with_capacity(3 * samples.len());
        for y in 0..height {
            // The nearest pixel that has neighbours on all sides.
            let row = y.clamp(1, height - 2);
            for x in 0..width {
                let column = x.clamp(1, width - 2);
                let at = |dx: isize, dy: isize| {
                    let place = row.wrapping_add_signed(dy) * width + column.wrapping_add_signed(dx);
                    u32::from(samples[place])
                };
                let own = at(0, 0);
                let across = || (at(-1, 0) + at(1, 0)).div_ceil(2);
                let along = || (at(0, -1) + at(0, 1)).div_ceil(2);
                let cross = || (at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1) + 2) / 4;
                let corners = || (at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1) + 2) / 4;
                let (is_red_column, is_red_row) = (column % 2 == self.red.0, row % 2 == self.red.1);
                let colour = match (is_red_column, is_red_row) {
                    (true, true) => [own, cross(), corners()],
                    (false, false) => [corners(), cross(), own],
                    (false, true) => [across(), own, along()],
                    (true, false) => [along(), own, across()],
                };
                rgb.extend(colour.map(|sample| sample as u16));
            }
        }
        Ok(rgb)
    }
}
