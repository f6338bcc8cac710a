//! One channel of an OpenEXR file.

use std::io::Cursor;
use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_graphs::values::Raster;
use exr::prelude::{FlatSamples, ReadChannels as _, ReadLayers as _, read};

/// The first bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x76\x2f\x31\x01";

/// Most pixels of a file.
const MOST_PIXELS: usize = 1 << 27;

/// Names of channels that hold depth or disparity, in this order.
const USUAL: [&str; 8] = ["Z", "z", "depth", "Depth", "disparity", "Y", "V", "R"];

/// The channel `name`, or the only one, or one with a usual name; infinite and NaN become NaN.
pub(super) fn channel(path: &Path, bytes: &[u8], name: Option<&str>) -> Result<Raster<f32>, Fault> {
    let damaged = |what: String| {
        Fault::new(format!("failed to decode {} ({} bytes)", path.display(), bytes.len()))
            .because(what)
            .remedy("the file is not a complete OpenEXR file of plain layers: copy or download it again")
    };
    let size = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|error| damaged(error.to_string()))?
        .headers
        .first()
        .map_or(0, |header| header.layer_size.area());
    if size > MOST_PIXELS {
        return Err(damaged(format!("it states {size} pixels, and at most {MOST_PIXELS} are read")));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| damaged(error.to_string()))?;
    let (window, layer) = (image.attributes.display_window, image.layer_data);
    let position = layer.attributes.layer_position;
    if (window.size, window.position) != (layer.size, position) {
        let what = format!(
            "{} has a data window of {}x{} px at ({}, {}), which is not its display window of {}x{} px",
            path.display(),
            layer.size.width(),
            layer.size.height(),
            position.x(),
            position.y(),
            window.size.width(),
            window.size.height()
        );
        return Err(Fault::new(what).remedy("write all pixels of the image"));
    }
    let channels = &layer.channel_data.list;
    let named = |name: &str| channels.iter().find(|channel| channel.name == *name);
    let found = match (name, &channels[..]) {
        (Some(name), _) => named(name),
        (None, [only]) => Some(only),
        (None, _) => USUAL.iter().find_map(|name| named(name)),
    };
    // A picture in colour is not a map.
    if let (None, [Some(red), Some(green)]) = (name, ["R", "G"].map(named))
        && found.is_some_and(|found| std::ptr::eq(found, red))
        && red.sample_data != green.sample_data
    {
        return Err(Fault::new(format!("{} is a colour image: its channels differ", path.display()))
            .remedy("write one number per pixel, or name a channel by `array`"));
    }
    let found = found.ok_or_else(|| {
        let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        let what = match name {
            Some(name) => format!("{} has no channel `{name}`; it has {}", path.display(), names.join(", ")),
            None => format!("{} has the channels {}", path.display(), names.join(", ")),
        };
        Fault::new(what).remedy("name a channel by `array`")
    })?;
    let known = |value: f32| if value.is_finite() { value } else { f32::NAN };
    let numbers: Vec<f32> = match &found.sample_data {
        FlatSamples::F16(samples) => samples.iter().map(|sample| known(sample.to_f32())).collect(),
        FlatSamples::F32(samples) => samples.iter().map(|sample| known(*sample)).collect(),
        FlatSamples::U32(samples) => samples.iter().map(|sample| *sample as f32).collect(),
    };
    let (width, height) = (layer.size.width(), layer.size.height());
    Raster::from_raw(width as u32, height as u32, numbers)
        .ok_or_else(|| damaged("the channel has another size than the image".to_owned()))
}
