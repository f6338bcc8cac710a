//! The optional inputs of every score that say which zones a pixel is in.

use depthloom_graphs::values::{Image, Mask};
use depthloom_graphs::{Fault, Inputs, Port, ValueType};
use depthloom_scores::Clues;

use crate::grey::grey;
use crate::shape::same_size;

pub(super) fn ports() -> Vec<Port> {
    let image = "The truth's image: scores of the zones `edges` and `textureless` besides.";
    let occluded =
        "What the right camera does not see of the truth: scores of the zones `visible` and `occluded` besides.";
    let objects = "KITTI's object map, set on objects: scores of the zones `background` and `foreground` besides.";
    vec![
        Port::frame("image", ValueType::Image, image).optional(),
        Port::frame("occluded", ValueType::Mask, occluded).optional(),
        Port::frame("obj_map", ValueType::Mask, objects).optional(),
    ]
}

pub(super) fn read<'a>(inputs: &Inputs<'a>, truth: (u32, u32)) -> Result<Clues<'a>, Fault> {
    let mask = |port: &'static str| -> Result<Option<&'a [u8]>, Fault> {
        let Some(mask) = inputs.optional::<Mask>(port)? else { return Ok(None) };
        same_size((port, mask.set.dimensions()), ("truth", truth))?;
        Ok(Some(mask.set.as_raw()))
    };
    let mut clues = Clues { grey: None, occluded: mask("occluded")?, objects: mask("obj_map")? };
    if let Some(image) = inputs.optional::<Image>("image")? {
        same_size(("image", image.dimensions()), ("truth", truth))?;
        clues.grey = Some(grey(image).as_raw());
    }
    Ok(clues)
}
