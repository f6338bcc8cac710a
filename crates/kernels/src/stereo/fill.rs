//! Filling of invalid pixels from the adjacent background, as KITTI's evaluation does before it counts errors.
//!
//! Source: `DisparityImage::interpolateBackground` of KITTI's stereo and scene flow development kits (`io_disp.h`,
//! Geiger).

/// Fills invalid pixels in place: a point that the other image does not show usually belongs to the background.
///
/// In every row a run of `invalid` pixels takes the smaller of the disparities at its two ends; at the image's border,
/// the one there is. Then, in every column, invalid pixels above the first and below the last valid pixel take its
/// disparity. Rows between others without any valid pixel stay invalid: the development kit leaves them, too. Rows are
/// `width` long. Runs of more than `longest` pixels stay; the development kit has no such limit (`usize::MAX`).
/// `invalid` equals itself: it is not NaN.
///
/// # Panics
/// If `width` does not divide the map's size.
pub fn fill_background<T: Copy + PartialOrd>(map: &mut [T], width: usize, invalid: T, longest: usize) {
    if map.is_empty() {
        return;
    }
    assert!(width > 0 && map.len().is_multiple_of(width), "{} pixels are not rows of {width}", map.len());
    for row in map.chunks_exact_mut(width) {
        fill_row(row, invalid, longest);
    }
    let mut rows: Vec<usize> = (0..map.len() / width).collect();
    extend_columns(map, width, &rows, invalid, longest);
    rows.reverse();
    extend_columns(map, width, &rows, invalid, longest);
}

fn fill_row<T: Copy + PartialOrd>(row: &mut [T], invalid: T, longest: usize) {
    let mut start = 0;
    while let Some(gap) = row[start..].iter().position(|&disparity| disparity == invalid) {
        let begin = start + gap;
        let end = row[begin..].iter().position(|&disparity| disparity != invalid).map_or(row.len(), |len| begin + len);
        let neighbours = [begin.checked_sub(1), (end < row.len()).then_some(end)];
        let background =
            neighbours.into_iter().flatten().map(|x| row[x]).reduce(|one, two| if two < one { two } else { one });
        if let Some(background) = background
            && end - begin <= longest
        {
            row[begin..end].fill(background);
        }
        start = end;
    }
}

/// Copies each column's first valid disparity, in the order of `rows`, to the rows before it.
fn extend_columns<T: Copy + PartialOrd>(map: &mut [T], width: usize, rows: &[usize], invalid: T, longest: usize) {
    // Columns whose first valid disparity is still to come.
    let mut waiting: Vec<usize> = (0..width).collect();
    for (before, &y) in rows.iter().enumerate() {
        waiting.retain(|&x| {
            let disparity = map[y * width + x];
            if disparity == invalid {
                return true;
            }
            if before <= longest {
                for &y in &rows[..before] {
                    map[y * width + x] = disparity;
                }
            }
            false
        });
        if waiting.is_empty() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fill_background;

    const NO: i16 = -16;

    #[test]
    fn gaps_take_the_background_and_borders_their_only_neighbour() {
        let mut map = [
            NO, NO, NO, NO, NO, NO, //
            NO, 90, NO, NO, 40, NO, //
            NO, NO, NO, NO, NO, NO, //
            70, NO, 80, 10, NO, 10, //
            NO, NO, NO, NO, NO, NO,
        ];
        fill_background(&mut map, 6, NO, usize::MAX);
        assert_eq!(
            map,
            [
                90, 90, 40, 40, 40, 40, //
                90, 90, 40, 40, 40, 40, //
                NO, NO, NO, NO, NO, NO, //
                70, 70, 80, 10, 10, 10, //
                70, 70, 80, 10, 10, 10,
            ]
        );
    }

    #[test]
    fn floats_are_filled_as_whole_numbers_are() {
        let mut map = [-1.0_f32, 7.25, -1.0, 5.5, -1.0];
        fill_background(&mut map, 5, -1.0, usize::MAX);
        assert_eq!(map, [7.25, 7.25, 5.5, 5.5, 5.5]);
    }

    #[test]
    fn longer_gaps_than_allowed_stay() {
        let mut map = [5, NO, NO, 7, NO, NO, NO, 9, NO, 3];
        fill_background(&mut map, 10, NO, 2);
        assert_eq!(map, [5, 5, 5, 7, NO, NO, NO, 9, 3, 3]);
    }

    #[test]
    fn maps_without_valid_or_without_invalid_pixels_are_unchanged() {
        let mut empty = [NO; 12];
        fill_background(&mut empty, 4, NO, usize::MAX);
        assert_eq!(empty, [NO; 12]);
        let mut full: Vec<i16> = (0..12).collect();
        fill_background(&mut full, 4, NO, usize::MAX);
        assert_eq!(full, (0..12).collect::<Vec<i16>>());
    }
}
