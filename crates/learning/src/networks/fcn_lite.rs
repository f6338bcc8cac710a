//! `fcn-lite`: `unet-lite` without its skips, to see what they are worth.

use super::unet_lite::{BOTTOM, LEVELS, twice};
use super::{Builder, Conv};

/// Everything the map knows has passed the bottom. Returns the features of the last level.
pub(super) fn fcn_lite<B: Builder>(builder: &mut B, image: &B::Map) -> B::Map {
    let mut x = image.clone();
    for (level, &channels) in LEVELS.iter().enumerate() {
        x = twice(builder, &format!("down{level}"), &x, channels);
        x = builder.halve(&x);
    }
    x = twice(builder, "bottom", &x, BOTTOM);
    for (level, &channels) in LEVELS.iter().enumerate().rev() {
        x = builder.double(&format!("up{level}.double"), &x, channels);
        if level > 0 {
            x = builder.conv(&format!("up{level}.conv"), &x, Conv::three(channels));
        }
    }
    x
}
