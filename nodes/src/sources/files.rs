//! Files of one frame: images, maps of numbers, calibration texts.

pub(crate) mod float_file;
pub(crate) mod image_file;
pub(crate) mod named_lines;

/// At most 40 characters of a text, for a message.
pub(crate) fn shortened(text: &str) -> String {
    if text.chars().count() <= 40 { text.to_owned() } else { text.chars().take(40).chain("...".chars()).collect() }
}
