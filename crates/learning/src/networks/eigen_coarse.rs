//! `eigen-coarse`: the network on board the paper's drone.
//!
//! The coarse scale of Eigen, Puhrsch, Fergus 2014 (their Figure 1): five convolutions and two dense layers that see
//! the whole image, without their dropout. Their map has a quarter of the image's columns and rows (74x55 of 304x228)
//! from 4096 units; the paper's on-board network is smaller (Martins et al. 2018, section V) and its sizes are not
//! published: an eighth from 256 units here. Depth up to 10 m, the range of NYU Depth V2.

use super::unet_lite::FIRST_BIAS;
use super::{Act, Builder, Conv, Size};

/// Units of the first dense layer.
const UNITS: usize = 256;

pub(super) fn eigen_coarse<B: Builder>(builder: &mut B, image: &B::Map) -> B::Map {
    let x = builder.conv("coarse1", image, Conv { kernel: 11, stride: 4, pad: 5, ..Conv::three(96) });
    let x = builder.halve(&x);
    let x = builder.conv("coarse2", &x, Conv { kernel: 5, pad: 2, ..Conv::three(256) });
    let x = builder.halve(&x);
    let x = builder.conv("coarse3", &x, Conv::three(384));
    let x = builder.conv("coarse4", &x, Conv::three(384));
    let x = builder.conv("coarse5", &x, Conv::three(256));
    let x = builder.halve(&x);
    let x = builder.dense("coarse6", &x, UNITS, Act::Relu, 0.0);
    let Size { width, height } = builder.size();
    let size = Size { width: width / 8, height: height / 8 };
    let x = builder.dense("coarse7", &x, size.width * size.height, Act::None, -FIRST_BIAS / 2.0);
    let x = builder.as_map(&x, size);
    builder.sigmoid(&x)
}
