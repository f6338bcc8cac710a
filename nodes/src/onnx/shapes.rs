//! Interprets the shapes of a network's inputs and outputs: batch, channels, rows, columns; one map or several.

use depthloom_graphs::Fault;

use super::binding::{Element, OutputTensor};
use super::fit::Sizes;
use super::model::Outlet;
use super::params::TensorLayout;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Axes {
    pub element: Element,
    /// `None` if the network leaves it open.
    pub batch: Option<usize>,
    /// 1 without such an axis; `None` if the network leaves it open.
    pub channels: Option<usize>,
    /// px; `None` if the network leaves it open.
    pub height: Option<usize>,
    /// px; `None` if the network leaves it open.
    pub width: Option<usize>,
    rank: usize,
    layout: TensorLayout,
}

/// Accepts 2 to 4 axes: rows and columns, batch before them, channels according to the layout.
pub(crate) fn planes(input: &Outlet, layout: TensorLayout) -> Result<Axes, Fault> {
    let name = &input.name;
    let Some((element, shape)) = &input.tensor else {
        return Err(Fault::new(format!("input `{name}` of the network is not a tensor")));
    };
    let Some(element) = Element::from_ort(*element) else {
        return Err(Fault::new(format!("input `{name}` of the network holds {element}, expected f32, f16 or u8"))
            .remedy("export the model with an input of f32 values"));
    };
    let wrong = || {
        let order = layout.axes();
        Fault::new(format!("input `{name}` of the network has the shape {}, which is not {order}", shape_text(shape)))
            .remedy("`layout` is nchw or nhwc; maps may leave out channels, and batch")
    };
    let (batch, channels, height, width) = match (&shape[..], layout) {
        (&[height, width], _) => (1, 1, height, width),
        (&[batch, height, width], _) => (batch, 1, height, width),
        (&[batch, channels, height, width], TensorLayout::Nchw)
        | (&[batch, height, width, channels], TensorLayout::Nhwc) => (batch, channels, height, width),
        _ => return Err(wrong()),
    };
    // The number of channels is open, and rows or columns are 1 or 3: the model has the other layout.
    let is_other = shape.len() == 4 && channels == -1 && [height, width].iter().any(|side| (1..=6).contains(side));
    if is_other || [batch, channels, height, width].contains(&0) {
        return Err(wrong());
    }
    let side = |side: i64| usize::try_from(side).ok();
    let (batch, channels, height, width) = (side(batch), side(channels), side(height), side(width));
    Ok(Axes { element, batch, channels, height, width, rank: shape.len(), layout })
}

impl Axes {
    pub(crate) fn shape(&self, batch: usize, channels: usize, (width, height): (usize, usize)) -> Vec<usize> {
        match (self.rank, self.layout) {
            (2, _) => vec![height, width],
            (3, _) => vec![batch, height, width],
            (_, TensorLayout::Nchw) => vec![batch, channels, height, width],
            (_, TensorLayout::Nhwc) => vec![batch, height, width, channels],
        }
    }

    pub(crate) fn laid_out(&self, planes: &[Vec<f32>], tensor: &mut Vec<f32>) {
        match (self.rank, self.layout) {
            (4, TensorLayout::Nhwc) if planes.len() > 1 => {
                let pixels = planes.first().map_or(0, Vec::len);
                for pixel in 0..pixels {
                    tensor.extend(planes.iter().map(|plane| plane[pixel]));
                }
            }
            _ => planes.iter().for_each(|plane| tensor.extend_from_slice(plane)),
        }
    }
}

/// The inputs decide, then the experiment, then the multiple.
pub(crate) fn sizes(inputs: &[(&str, Axes)], requested: Option<[u32; 2]>, multiple: u32) -> Result<Sizes, Fault> {
    let side = |what: &str, of: fn(&Axes) -> Option<usize>, requested: Option<u32>| {
        let mut found = requested.map(|side| side as usize).map(|side| ("`size`", side));
        for (name, axes) in inputs {
            match (of(axes), found) {
                (Some(fixed), Some((other, side))) if side != fixed => {
                    return Err(Fault::new(format!(
                        "{other} has {side} {what}, and input `{name}` of the network takes {fixed}"
                    ))
                    .remedy("remove `size`: the network fixes it"));
                }
                (Some(fixed), _) => found = Some((name, fixed)),
                (None, _) => {}
            }
        }
        Ok(found.map(|(_, side)| side))
    };
    Ok(Sizes {
        width: side("columns", |axes| axes.width, requested.map(|size| size[0]))?,
        height: side("rows", |axes| axes.height, requested.map(|size| size[1]))?,
        multiple: multiple as usize,
        side: None,
    })
}

/// Number of `images` in one run: all, if every input and the output leave the batch open or fix it at that number;
/// otherwise one.
pub(crate) fn batch(inputs: &[(&str, Axes)], output: &Outlet, images: usize) -> Result<usize, Fault> {
    let of_output = output.tensor.as_ref().filter(|(_, shape)| shape.len() > 2).map(|(_, shape)| shape[0]);
    let mut batch = if of_output.is_some_and(|first| first == -1 || first == images as i64) { images } else { 1 };
    for (name, axes) in inputs {
        match axes.batch {
            None => {}
            Some(1) => batch = 1,
            Some(fixed) if fixed == images => batch = images,
            Some(fixed) => {
                return Err(Fault::new(format!("input `{name}` of the network takes {fixed} images at once"))
                    .remedy("export the model with a batch of 1, or an open one"));
            }
        }
    }
    Ok(batch)
}

/// Largest stride of known networks: pixels of the image per pixel of a map, along an axis.
const LARGEST_STRIDE: usize = 32;

const fn is_side(side: usize, of_image: usize) -> bool {
    // Strides may round down. A file declares any side up to 2^63 - 1.
    (side >= 2 || of_image == side) && side.saturating_add(1).saturating_mul(LARGEST_STRIDE) > of_image
}

/// Both are (columns, rows). A vector, such as a pose, is not a map.
pub(super) const fn is_map_size(size: (usize, usize), of_image: (usize, usize)) -> bool {
    is_side(size.0, of_image.0) && is_side(size.1, of_image.1)
}

/// Whether an output may hold maps; -1 is an open side. `of_image`: columns and rows of the network's image, where
/// known.
pub(super) fn may_be_map(shape: &[i64], of_image: (Option<usize>, Option<usize>)) -> bool {
    // Where no shape is declared everything is open.
    if shape.is_empty() {
        return true;
    }
    let is = |side: i64, of_image: Option<usize>| {
        usize::try_from(side).ok().is_none_or(|side| is_side(side, of_image.unwrap_or(2)))
    };
    let are = |height: i64, width: i64| is(height, of_image.1) && is(width, of_image.0);
    match *shape {
        // Of two open axes the first is the batch of a vector more often than the rows of a map.
        [-1, -1] => false,
        [.., height, width] if are(height, width) => true,
        // Channels last.
        [_, height, width, _] => are(height, width),
        _ => false,
    }
}

/// The output of that name, or the first whose shape may be a map's.
pub(crate) fn map_output<'a>(
    outputs: &'a [Outlet],
    name: Option<&str>,
    of_image: (Option<usize>, Option<usize>),
) -> Result<&'a Outlet, Fault> {
    let shape = |output: &'a Outlet| output.tensor.as_ref().map_or(&[][..], |(_, shape)| shape.as_slice());
    let is_open =
        |output: &&Outlet| output.tensor.as_ref().is_some_and(|(_, shape)| shape.iter().all(|side| *side == -1));
    let is_number = |output: &&Outlet| {
        use ort::value::TensorElementType::{Float16, Float32, Float64};
        output.tensor.as_ref().is_some_and(|(element, _)| matches!(element, Float16 | Float32 | Float64))
    };
    let first = || outputs.iter().filter(is_number).find(|output| may_be_map(shape(output), of_image));
    match (name, outputs) {
        (None, [_, ..]) => first().or_else(|| outputs.iter().find(is_open)).ok_or_else(|| {
            let described = |output: &'a Outlet| match &output.tensor {
                Some((element, shape)) => format!("{} ({element} {})", output.name, shape_text(shape)),
                None => format!("{} (no tensor)", output.name),
            };
            let names: Vec<String> = outputs.iter().map(described).collect();
            Fault::new(format!("the network has no output that can be a map of its image; it has {}", names.join(", ")))
                .remedy("a map has rows and columns of f32, f16 or f64: name one by `output_name`, or export the model with one")
        }),
        _ => outlet("output", outputs, name),
    }
}

/// One map per image of a batch.
pub(crate) struct Maps {
    /// Row-major, one map after the other.
    pub values: Vec<f32>,
    /// Columns and rows of a map.
    pub size: (usize, usize),
}

pub(super) struct Place {
    /// Columns and rows of a map.
    size: (usize, usize),
    /// Maps per image, and the one that is used.
    heads: usize,
    chosen: usize,
    /// Maps that are interleaved pixel by pixel (channels last).
    trail: usize,
}

/// Finds the map of each of `batch` images. `head` selects one of several maps per image, from 0, or from the last with
/// -1.
pub(super) fn check_map(
    shape: &[i64],
    name: &str,
    (batch, of_image): (usize, (usize, usize)),
    head: Option<i64>,
    layout: TensorLayout,
) -> Result<Place, Fault> {
    let wrong = |why: String| {
        Err(Fault::new(format!("output `{name}` of the network has the shape {}, {why}", shape_text(shape))).remedy(
            "name another output, choose of several maps by `head`, or export the model with an output of 1x1xHxW",
        ))
    };
    let sides: Vec<usize> = shape.iter().map(|&side| usize::try_from(side).unwrap_or(0)).collect();
    let in_last = layout == TensorLayout::Nhwc && sides.len() == 4;
    let (lead, height, width, trail) = match sides[..] {
        [ref lead @ .., height, width, trail] if in_last || trail == 1 && lead.len() == 1 => {
            (lead, height, width, trail)
        }
        [ref lead @ .., height, width] => (lead, height, width, 1),
        _ => return wrong("which is not a map".to_owned()),
    };
    let of_all = lead.iter().product::<usize>() * trail;
    if height == 0 || width == 0 || of_all == 0 || of_all % batch != 0 || batch > 1 && lead.first() != Some(&batch) {
        return wrong(format!("which is not a map for each of {batch} images"));
    }
    if !is_map_size((width, height), of_image) {
        return wrong(format!("which is not a map of an image of {}x{}", of_image.0, of_image.1));
    }
    let heads = of_all / batch;
    let chosen = match head {
        None if heads == 1 => 0,
        None => return wrong(format!("which is {heads} maps for one image")),
        Some(head) => {
            let from_first = if head < 0 { head + heads as i64 } else { head };
            match usize::try_from(from_first).ok().filter(|head| *head < heads) {
                Some(head) => head,
                None => return wrong(format!("which has no head {head}: it holds {heads}")),
            }
        }
    };
    // Channels lie together: the lead is the batch.
    if trail > 1 && heads != trail {
        return wrong("which holds maps on two axes".to_owned());
    }
    Ok(Place { size: (width, height), heads, chosen, trail })
}

pub(crate) fn map_of(
    given: OutputTensor,
    name: &str,
    (batch, of_image): (usize, (usize, usize)),
    head: Option<i64>,
    layout: TensorLayout,
) -> Result<Maps, Fault> {
    let Place { size, heads, chosen, trail } = check_map(&given.shape, name, (batch, of_image), head, layout)?;
    let pixels = size.0 * size.1;
    let values = if heads == 1 {
        given.values
    } else if trail > 1 {
        given.values.iter().skip(chosen).step_by(trail).copied().collect()
    } else {
        let of_image = |image: usize| &given.values[(image * heads + chosen) * pixels..][..pixels];
        (0..batch).flat_map(of_image).copied().collect()
    };
    Ok(Maps { values, size })
}

pub(crate) fn count_non_finite(values: &[f32]) -> usize {
    values.iter().filter(|value| !value.is_finite()).count()
}

pub(crate) fn outlet<'a>(what: &str, outlets: &'a [Outlet], name: Option<&str>) -> Result<&'a Outlet, Fault> {
    let named = |wanted: &str| outlets.iter().find(|outlet| outlet.name == wanted);
    let found = name.map_or(outlets.first(), named);
    found.ok_or_else(|| {
        let names: Vec<&str> = outlets.iter().map(|outlet| outlet.name.as_str()).collect();
        let wanted = name.map_or_else(|| format!("no {what}"), |name| format!("no {what} `{name}`"));
        Fault::new(format!("the network has {wanted}; it has {}", names.join(", ")))
            .remedy(format!("correct `{what}_name`, or leave it out to take the first"))
    })
}

/// A shape as text: `1x3x?x?`.
pub fn shape_text(shape: &[i64]) -> String {
    let side = |&side: &i64| if side < 0 { "?".to_owned() } else { side.to_string() };
    shape.iter().map(side).collect::<Vec<_>>().join("x")
}

#[cfg(test)]
mod tests {
    use super::super::binding::OutputTensor;
    use super::super::model::Outlet;
    use super::super::params::TensorLayout::{Nchw, Nhwc};
    use super::{map_of, map_output, may_be_map, shape_text};

    fn given(shape: &[i64]) -> OutputTensor {
        let count: i64 = shape.iter().product();
        OutputTensor { shape: shape.to_vec(), values: (0..count).map(|value| value as f32).collect() }
    }

    #[test]
    fn open_sides_are_shown_as_such() {
        assert_eq!(shape_text(&[1, 3, -1, 320]), "1x3x?x320");
    }

    #[test]
    fn a_map_is_found_in_any_usual_shape() {
        for shape in [&[2, 3][..], &[1, 2, 3], &[1, 1, 2, 3], &[1, 2, 3, 1], &[1, 1, 1, 2, 3]] {
            let maps = map_of(given(shape), "out", (1, (3, 2)), None, Nchw);
            let maps = maps.unwrap_or_else(|fault| panic!("{shape:?}: {fault}"));
            assert_eq!((maps.size, maps.values.len()), ((3, 2), 6), "{shape:?}");
        }
        for shape in [&[3][..], &[], &[1, 2, 2, 3], &[2, 1, 2, 3], &[1, 1, 0, 3]] {
            assert!(map_of(given(shape), "out", (1, (3, 2)), None, Nchw).is_err(), "{shape:?}");
        }
    }

    #[test]
    fn fault_51_a_vector_is_not_a_map() {
        for shape in [&[1, 16][..], &[1, 8], &[16, 1], &[1, 16, 1, 1], &[1, 1, 1, 16], &[1, 1, 4, 4]] {
            let maps = map_of(given(shape), "pose", (1, (640, 192)), Some(0), Nchw);
            let what = maps.map(|_| ()).expect_err("it is refused").to_string();
            assert!(what.contains("not a map of an image of 640x192"), "{shape:?}: {what}");
        }
        // A stride of 32 that rounds down.
        assert!(map_of(given(&[1, 1, 11, 38]), "depth", (1, (1242, 375)), None, Nchw).is_ok());
        // Sides that a damaged file declares: no sum or product overflows.
        assert!(
            may_be_map(&[1, 1, i64::MIN, 96, i64::MAX], (None, None)),
            "its sides are open, as far as one can tell"
        );
        assert!(may_be_map(&[1, i64::MAX, i64::MAX], (Some(640), Some(192))));
    }

    #[test]
    fn fault_51_the_usual_output_is_the_first_that_can_be_a_map() {
        let outlet = |name: &str, shape: &[i64]| Outlet {
            name: name.to_owned(),
            tensor: Some((ort::value::TensorElementType::Float32, shape.to_vec())),
        };
        let of_image = (Some(640), Some(192));
        let chosen = |pose: &[i64], name: Option<&str>| {
            let outputs = [outlet("pose", pose), outlet("depth", &[-1, 1, -1, -1])];
            map_output(&outputs, name, of_image).map(|output| output.name.clone()).map_err(|fault| fault.to_string())
        };
        for pose in [&[1, 16][..], &[-1, 6], &[-1, -1], &[1, 16, 1, 1], &[1, 8], &[1, 4, 4]] {
            assert_eq!(chosen(pose, None).as_deref(), Ok("depth"), "{pose:?}");
        }
        assert_eq!(chosen(&[1, 192, 640], None).as_deref(), Ok("pose"));
        assert_eq!(chosen(&[1, 16], Some("pose")).as_deref(), Ok("pose"), "who names one gets it, and its fault");
        let none = map_output(&[outlet("pose", &[1, 16])], None, of_image).map(|_| ()).expect_err("no map");
        assert!(none.to_string().contains("it has pose (f32 1x16)"), "{none}");
        let open = [outlet("only", &[-1, -1])];
        assert!(map_output(&open, None, of_image).is_ok_and(|output| output.name == "only"));
    }

    #[test]
    fn head_selects_one_of_several_maps() {
        let first = |shape: &[i64], batch, image, head, layout| {
            map_of(given(shape), "out", (batch, image), Some(head), layout)
                .map(|maps| maps.values)
                .map_err(|fault| fault.to_string())
        };
        assert_eq!(first(&[1, 2, 1, 3], 1, (3, 1), 1, Nchw), Ok(vec![3.0, 4.0, 5.0]));
        assert_eq!(first(&[4, 1, 1, 1, 2], 1, (2, 1), -1, Nchw), Ok(vec![6.0, 7.0]), "steps of refinement");
        assert_eq!(first(&[1, 1, 3, 2], 1, (3, 1), 0, Nhwc), Ok(vec![0.0, 2.0, 4.0]));
        assert_eq!(first(&[2, 2, 1, 2], 2, (2, 1), 1, Nchw), Ok(vec![2.0, 3.0, 6.0, 7.0]), "one for each image");
        assert!(first(&[1, 2, 1, 3], 1, (3, 1), 2, Nchw).is_err_and(|told| told.contains("no head 2: it holds 2")));
        assert!(first(&[1, 2, 1, 3], 1, (3, 1), -3, Nchw).is_err());
    }
}
