//! The left border matched by virtual columns: images whose first column is repeated before it.

use super::{Params, View};
use crate::memory::{self, TooMuch};

/// Both images extended, and their maps.
#[derive(Debug, Default)]
pub(super) struct ExtendScratch {
    pub images: [Vec<u8>; 2],
    pub disparity: Vec<i16>,
    pub right: Vec<i16>,
    pub ambiguity: Vec<f32>,
}

/// Virtual columns: as many as the search leaves out at the left border.
pub(super) fn virtual_columns(params: &Params) -> usize {
    if params.extend_left { (params.min_disparity + params.disparities).max(0) as usize } else { 0 }
}

/// The image behind `columns` copies of its first column, as by `cv::copyMakeBorder` with `BORDER_REPLICATE`.
pub(super) fn extended<'a>(view: &View<'_>, columns: usize, data: &'a mut Vec<u8>) -> Result<View<'a>, TooMuch> {
    let View { width, height, channels, .. } = *view;
    data.clear();
    memory::reserve(data, (width + columns) * height * channels)?;
    for y in 0..height {
        let row = view.row(y);
        for _ in 0..columns {
            data.extend_from_slice(&row[..channels]);
        }
        data.extend_from_slice(row);
    }
    Ok(View { data, width: width + columns, height, channels })
}

/// Cuts the virtual columns off a map of an extended image; `out` has rows of `width`.
pub(super) fn cut<T: Copy>(map: &[T], columns: usize, width: usize, out: &mut [T]) {
    for (row, out) in map.chunks_exact(width + columns).zip(out.chunks_exact_mut(width)) {
        out.copy_from_slice(&row[columns..]);
    }
}

#[cfg(test)]
mod tests {
    use super::{cut, extended};
    use crate::stereo::sgbm::View;

    #[test]
    fn the_first_column_is_repeated_and_cut_off_again() {
        let mut data = vec![9; 3];
        let grey = View { data: &[1, 2, 3, 4], width: 2, height: 2, channels: 1 };
        let wide = extended(&grey, 2, &mut data).unwrap();
        assert_eq!((wide.data, wide.width), (&[1, 1, 1, 2, 3, 3, 3, 4][..], 4));
        let mut back = [0; 4];
        cut(wide.data, 2, 2, &mut back);
        assert_eq!(back, [1, 2, 3, 4]);
        let colour = View { data: &[1, 2, 3, 4, 5, 6], width: 2, height: 1, channels: 3 };
        assert_eq!(extended(&colour, 1, &mut data).unwrap().data, [1, 2, 3, 1, 2, 3, 4, 5, 6]);
    }
}
