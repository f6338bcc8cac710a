//! The left-right check of two disparity maps: each image's pixels must choose each other.
//!
//! Hirschmueller (*Stereo Processing by Semiglobal Matching and Mutual Information*, 2008, section 2.3) keeps the
//! disparity of a pixel where the other image's disparity at its partner differs by at most 1 px; so do ELAS and
//! MC-CNN.

/// Invalidates, in place, disparities of the left image that the right image does not confirm.
///
/// Both maps are fixed point, 1/16 px, rows `width` long, invalid pixels holding their map's `invalid`. A left pixel
/// `x` of disparity `d` has its partner at `x - d`; the right map holds `x_right - x_left`, which is `-d`, as of a
/// matcher with exchanged images that searches `-(smallest + count) + 1 .. -smallest`
/// (`cv::ximgproc::createRightMatcher`). Partners between two pixels are rounded down and up, and one of both is
/// enough, as in `cv::validateDisparity`. A disparity stays if its partner is inside the image, is valid, and the two
/// differ by at most `max_difference` (1/16 px).
///
/// # Panics
/// If the maps differ in size or `width` does not divide it.
pub fn check(left: &mut [i16], right: &[i16], width: usize, invalid: (i16, i16), max_difference: i32) {
    crate::raster::check_same("right disparity", right.len(), left.len());
    if left.is_empty() {
        return;
    }
    assert!(width > 0 && left.len().is_multiple_of(width), "{} pixels are not rows of {width}", left.len());
    for (left, right) in left.chunks_exact_mut(width).zip(right.chunks_exact(width)) {
        for (x, disparity) in left.iter_mut().enumerate() {
            let fixed = i32::from(*disparity);
            let confirms = |whole: i32| {
                let partner = usize::try_from(x as i32 - whole).ok().and_then(|x| right.get(x));
                partner.is_some_and(|&other| other != invalid.1 && (i32::from(other) + fixed).abs() <= max_difference)
            };
            if *disparity != invalid.0 && !confirms(fixed >> 4) && !confirms((fixed + 15) >> 4) {
                *disparity = invalid.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn only_pixels_that_choose_each_other_stay() {
        // An object of disparity 2 (columns 4..6) before a background of 0: what it hides of the background in the
        // right image, columns 2..4 on the left, has partners that show the object.
        let mut left = [0, 0, 0, 0, 32, 32, 0, 0];
        let right = [0, 0, -32, -32, 0, 0, 0, 0];
        check(&mut left, &right, 8, (-16, -1000), 16);
        assert_eq!(left, [0, 0, -16, -16, 32, 32, 0, 0]);
    }

    #[test]
    fn partners_outside_the_image_or_invalid_confirm_nothing() {
        let mut left = [16, 16, 16, -48];
        check(&mut left, &[-16, -1000, 48, 48], 4, (-64, -1000), 16);
        assert_eq!(left, [-64, 16, -64, -64]);
    }

    #[test]
    fn fractions_are_rounded_down_and_up() {
        // 1.5 px from column 3: partners are columns 2 and 1.
        for (right, kept) in [([0, -20, 99, 0], true), ([0, 99, -40, 0], true), ([0, 99, 99, 0], false)] {
            let mut left = [-16, -16, -16, 24];
            check(&mut left, &right, 4, (-16, -1000), 16);
            assert_eq!(left[3] == 24, kept, "{right:?}");
        }
    }
}
