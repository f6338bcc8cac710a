//! Rasters made by kernels, and the check that two have one size.

use depthloom_graphs::Fault;
use depthloom_graphs::values::Raster;
use image::Primitive;

pub(crate) fn filled<T: Primitive>((width, height): (u32, u32), fill: impl FnOnce(&mut [T])) -> Raster<T> {
    let mut raster = Raster::new(width, height);
    fill(&mut raster);
    raster
}

pub(crate) fn same_size(first: (&str, (u32, u32)), second: (&str, (u32, u32))) -> Result<(), Fault> {
    if first.1 == second.1 {
        return Ok(());
    }
    let ((a, (aw, ah)), (b, (bw, bh))) = (first, second);
    Err(Fault::new(format!("`{a}` is {aw}x{ah} and `{b}` is {bw}x{bh}: they must have the same size")))
}
