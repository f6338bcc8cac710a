//! Optional inputs of both score kinds that define zones.

use depthloom_graphs::values::{Image, Mask};
use depthloom_graphs::{Fault, Inputs, Port, ValueType};
use depthloom_scores::Clues;

use crate::grey::grey;
use crate::shape::same_size;

pub(super) fn ports() -> Vec<Port> {
    let image = "The image of the ground truth; adds the zones `edges` and `textureless`.";
    let occluded =
        "Pixels with ground truth that the right camera does not see; adds the zones `visible` and `occluded`.";
    let objects = "KITTI's object map, set on objects; adds the zones `background` and `foreground`.";
    vec![
        Port::frame("image", ValueType::Image, image).optional(),
        Port::frame("occluded", ValueType::Mask, occluded).optional(),
        Port::frame("obj_map", ValueType::Mask, objects).optional(),
    ]
}

pub(super) fn read<'a>(inputs: &Inputs<'a>, truth: (u32, u32)) -> Result<Clues<'a>, Fault> {
    let mask = |port: &'static str| -> Result<Option<&'a [u8]>, Fault> {
        let Some(mask) = inputs.optional::<Mask>(port)? else { return Ok(None) };
        same_size((port, mask.set.dimensions()), ("ground_truth", truth))?;
        Ok(Some(mask.set.as_raw()))
    };
    let mut clues = Clues { grey: None, occluded: mask("occluded")?, objects: mask("obj_map")? };
    if let Some(image) = inputs.optional::<Image>("image")? {
        same_size(("image", image.dimensions()), ("ground_truth", truth))?;
        clues.grey = Some(grey(image).as_raw());
    }
    Ok(clues)
}
