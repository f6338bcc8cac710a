//! The inputs that show how good stereo is, shared by `fusion/mixture` and `learn/reliability`.

use depthloom_graphs::values::{Depth, Disparity, Weight};
use depthloom_graphs::{Fault, Inputs, Port, ValueType};
use depthloom_kernels::mixture::{Disparities, Frame, StereoEvidence};
use std::sync::Arc;

use crate::disparity::invalid;
use crate::geometry::{geometry, pair_calibration};
use crate::shape::same_size;

/// The ports that [`frame`] reads.
pub(super) fn ports() -> Vec<Port> {
    vec![
        Port::frame("disparity", ValueType::Disparity, "Disparity of the left image, rounded to 1/16 px."),
        Port::frame("mono", ValueType::Depth, "Monocular depth, metres, NaN = invalid; size of `disparity`."),
        Port::frame("calibration", ValueType::Calibration, "Focal length, baseline and principal points of the pair."),
        Port::frame("right", ValueType::Disparity, "Disparity of the right image's pixels, negative, 1/16 px.")
            .optional(),
        Port::frame(
            "unique",
            ValueType::Disparity,
            "A disparity that is valid only where the match is unique; 0 px is not valid.",
        )
        .optional(),
        Port::frame(
            "ambiguity",
            ValueType::Weight,
            "Cost of the best disparity as a share of the second best's, in [0, 1].",
        )
        .optional(),
    ]
}

fn disparities(map: &Disparity) -> Result<Disparities<'_>, Fault> {
    Ok(Disparities { sixteenths: &map.sixteenths_px, invalid: invalid(map)? })
}

/// A frame of a matcher that searched `searched` disparities.
pub(super) fn frame<'a>(inputs: &'a Inputs<'_>, searched: u32) -> Result<Frame<'a>, Fault> {
    let (map, mono) = (inputs.get::<Disparity>("disparity")?, &inputs.get::<Depth>("mono")?.metres);
    let geometry = geometry(pair_calibration(inputs)?);
    let size = map.sixteenths_px.dimensions();
    same_size(("disparity", size), ("mono", mono.dimensions()))?;
    let optional = |port: &'static str| -> Result<Option<Disparities<'_>>, Fault> {
        let Some(other) = inputs.optional::<Disparity>(port)? else { return Ok(None) };
        same_size(("disparity", size), (port, other.sixteenths_px.dimensions()))?;
        disparities(other).map(Some)
    };
    let range_end = f64::from(map.min_disparity_px) + f64::from(searched);
    let largest = f64::from(map.sixteenths_px.iter().copied().max().unwrap_or(i16::MIN)) / 16.0;
    if largest > range_end {
        return Err(Fault::new(format!(
            "`disparity` has {largest} px, but `disparities: {searched}` ends the search at {range_end} px"
        ))
        .remedy("give the matcher and this node the same `disparities`"));
    }
    Ok(Frame {
        width: size.0 as usize,
        height: size.1 as usize,
        disparity: disparities(map)?,
        range_end: range_end as f32,
        geometry,
        mono,
        mono_deviation: None,
        evidence: StereoEvidence {
            right: optional("right")?,
            unique: optional("unique")?,
            ambiguity: weight(inputs, "ambiguity", size)?,
            confidence: None,
        },
    })
}

/// An optional weight of the frame's size.
pub(super) fn weight<'a>(
    inputs: &'a Inputs<'_>,
    port: &'static str,
    size: (u32, u32),
) -> Result<Option<&'a [f32]>, Fault> {
    let Some(weight): Option<&Arc<Weight>> = inputs.optional(port)? else { return Ok(None) };
    same_size(("disparity", size), (port, weight.share.dimensions()))?;
    Ok(Some(&weight.share))
}
