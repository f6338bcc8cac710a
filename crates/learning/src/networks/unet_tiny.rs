//! `unet-tiny`: `unet-lite` with fewer channels, for a file that is small enough to keep beside an experiment.

use super::Builder;
use super::unet_lite::unet;

/// Channels of the levels, finest first.
const LEVELS: [usize; 5] = [6, 8, 12, 16, 24];
/// Channels at the bottom.
const BOTTOM: usize = 28;

pub(super) fn unet_tiny<B: Builder>(builder: &mut B, image: &B::Map) -> B::Map {
    unet(builder, image, LEVELS, BOTTOM)
}
