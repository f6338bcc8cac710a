//! `fusion-unet`: a U-Net that fuses stereo with a monocular estimate.

use depthloom_kernels::learned::{MAPS, PLANES};

use super::unet_lite::twice;
use super::{Act, Architecture, Builder, Conv, Interface, NetworkOutput};

/// Channels of the levels, finest first.
const LEVELS: [usize; 4] = [8, 16, 24, 32];
/// Channels at the bottom.
const BOTTOM: usize = 48;

/// The network of `learn/fusion`: it sees the planes of `depthloom_kernels::learned`, and its maps are an `Opinion`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FusionUnet;

impl FusionUnet {
    /// Rows and columns must be multiples of this.
    pub(crate) const MULTIPLE: usize = 1 << LEVELS.len();
}

impl Architecture for FusionUnet {
    fn name(self) -> &'static str {
        "fusion-unet"
    }

    fn interface(self) -> Interface {
        let normalisation = "RGB in [0,1]; ln stereo/mono; coverage; ln mono; consistency; confidence; area resized";
        let outputs = vec![NetworkOutput { name: "fusion", scale: 1.0 }];
        Interface { input: "planes", planes: PLANES, normalisation, outputs }
    }

    /// As `unet-lite`, but the finest level has a skip: which of two depths is right changes from pixel to pixel.
    fn build<B: Builder>(self, builder: &mut B, planes: &B::Map) -> Vec<B::Map> {
        let (mut levels, mut x) = (Vec::new(), planes.clone());
        for (level, &channels) in LEVELS.iter().enumerate() {
            x = twice(builder, &format!("down{level}"), &x, channels);
            levels.push(x.clone());
            x = builder.halve(&x);
        }
        x = twice(builder, "bottom", &x, BOTTOM);
        for (level, &channels) in LEVELS.iter().enumerate().rev() {
            x = builder.double(&format!("up{level}.double"), &x, channels);
            x = builder.join(&x, &levels[level]);
            x = builder.conv(&format!("up{level}.conv"), &x, Conv::three(channels));
        }
        // From zero: half of stereo, no residual, a spread of 10 % of depth.
        let x = builder.conv("last", &x, Conv { act: Act::None, ..Conv::three(MAPS) });
        vec![builder.sigmoid(&x)]
    }
}
