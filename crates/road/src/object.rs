//! Solids of the street.

use crate::camera::Ray;
use crate::shape::{Bounds, Shape};
use crate::surfaces::material::Material;

/// A solid with its skin.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub shape: Shape,
    pub bounds: Bounds,
    pub material: Material,
}

impl Object {
    /// Depth of the first surface that is there between `after` and `before`.
    pub(crate) fn meets(&self, ray: &Ray, after: f32, before: f32) -> Option<f32> {
        if !self.material.has_holes() {
            return self.shape.entry(&self.bounds, ray, after, before);
        }
        let is_solid = |depth: &f32| self.material.is_solid(ray.at(*depth));
        let near = self.shape.entry(&self.bounds, ray, after, before).filter(is_solid);
        near.or_else(|| self.shape.exit(&self.bounds, ray, after, before).filter(is_solid))
    }
}
