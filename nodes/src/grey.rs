//! The one grey image all nodes share.

use depthloom_graphs::values::Image;
use depthloom_kernels::grey::grey_from_rgb;
use image::GrayImage;

/// The grey image, by OpenCV's weights; computed once an image, whichever node asks first.
pub fn grey(image: &Image) -> &GrayImage {
    image.grey_with(|rgb| {
        let (width, height) = rgb.dimensions();
        let mut grey = GrayImage::new(width, height);
        grey_from_rgb(rgb.as_raw(), width as usize, height as usize, &mut grey);
        grey
    })
}
