//! `fcn-vgg16`: the paper's network.
//!
//! "A fully convolutional network based on VGG-16 without its dense layers", the first 8 convolutions frozen, two
//! deconvolutions back towards the image's size (Martins et al. 2018, section III). The deconvolutions' sizes are not
//! in the paper: each doubles here, so the map has a quarter of the image's rows and columns; `mono/onnx` resizes it.

use super::{Builder, Conv};

/// Channels of VGG-16's blocks and their convolutions (Simonyan, Zisserman 2015, configuration D). The last pooling
/// goes with the dense layers.
const BLOCKS: [(usize, usize); 5] = [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)];
/// Convolutions, counted from the image, whose pretrained weights are kept.
const FROZEN: usize = 8;

/// Names are torchvision's (`features.0`, `features.2`, ...), so that its files fit. Returns the features of the last
/// level.
pub(super) fn fcn_vgg16<B: Builder>(builder: &mut B, image: &B::Map) -> B::Map {
    let (mut x, mut index, mut count) = (image.clone(), 0, 0);
    for (block, &(channels, convolutions)) in BLOCKS.iter().enumerate() {
        if block > 0 {
            x = builder.halve(&x);
            index += 1;
        }
        for _ in 0..convolutions {
            let conv = Conv { frozen: count < FROZEN, ..Conv::three(channels) };
            x = builder.conv(&format!("features.{index}"), &x, conv);
            index += 2; // torchvision counts the ReLU too
            count += 1;
        }
    }
    x = builder.double("up1", &x, 128);
    builder.double("up0", &x, 32)
}
