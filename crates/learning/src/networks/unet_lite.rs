//! `unet-lite`: a small U-Net (Ronneberger, Fischer, Brox 2015) with transposed convolutions back to the image's size.

use super::{Act, Builder, Conv};

/// Channels of the levels, finest first.
pub(super) const LEVELS: [usize; 5] = [8, 16, 32, 64, 96];
/// Channels at the bottom.
pub(super) const BOTTOM: usize = 128;
/// The bias of the last convolution at the start: the sigmoid then begins near 0.12, about the mean of real scenes in
/// tenths of the width. From zero, learning sinks into a constant map first.
pub(super) const FIRST_BIAS: f32 = -2.0;

/// Two 3x3 convolutions a level, the maximum of 2x2 between them; upwards a transposed convolution, the level's own map
/// beside it (not on the finest level, where it would cost most) and one convolution.
///
/// Returns the features of the last level.
pub(super) fn unet_lite<B: Builder>(builder: &mut B, image: &B::Map) -> B::Map {
    unet(builder, image, LEVELS, BOTTOM)
}

/// The same with these channels: of the levels, finest first, and at the bottom.
pub(super) fn unet<B: Builder>(builder: &mut B, image: &B::Map, channels: [usize; 5], bottom: usize) -> B::Map {
    let mut levels = Vec::new();
    let mut x = image.clone();
    for (level, &channels) in channels.iter().enumerate() {
        x = twice(builder, &format!("down{level}"), &x, channels);
        levels.push(x.clone());
        x = builder.halve(&x);
    }
    x = twice(builder, "bottom", &x, bottom);
    for (level, &channels) in channels.iter().enumerate().rev() {
        x = builder.double(&format!("up{level}.double"), &x, channels);
        if level > 0 {
            x = builder.join(&x, &levels[level]);
            x = builder.conv(&format!("up{level}.conv"), &x, Conv::three(channels));
        }
    }
    x
}

pub(super) fn twice<B: Builder>(builder: &mut B, name: &str, x: &B::Map, channels: usize) -> B::Map {
    let x = builder.conv(&format!("{name}.first"), x, Conv::three(channels));
    builder.conv(&format!("{name}.second"), &x, Conv::three(channels))
}

/// One channel in [0, 1].
pub(super) fn last<B: Builder>(builder: &mut B, name: &str, x: &B::Map, bias: f32) -> B::Map {
    let x = builder.conv(name, x, Conv { act: Act::None, bias, ..Conv::three(1) });
    builder.sigmoid(&x)
}
