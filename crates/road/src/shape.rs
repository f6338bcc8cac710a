//! The solids the street is built of, and where a ray enters them.

use crate::camera::Ray;
use crate::vector::{Vec3, vec3};

/// A half space: the side of the plane `normal · p = offset` that the normal points away from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub normal: Vec3,
    pub offset: f32,
}

/// A solid. Cameras are never inside one.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Block,
    /// The part of its bounds inside all these half spaces: car bodies, roofs.
    Convex(Vec<Plane>),
    /// An upright cylinder as wide as its bounds.
    Column,
    /// The ellipsoid that fills its bounds.
    Ellipsoid,
}

/// A solid's place: the corners of the box around it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub low: Vec3,
    pub high: Vec3,
}

impl Bounds {
    pub(crate) fn centre(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    pub(crate) fn corners(&self) -> [Vec3; 8] {
        let (l, h) = (self.low, self.high);
        std::array::from_fn(|i| {
            vec3(
                if i & 1 == 0 { l.x } else { h.x },
                if i & 2 == 0 { l.y } else { h.y },
                if i & 4 == 0 { l.z } else { h.z },
            )
        })
    }

    /// Where the ray is inside: entry and exit.
    fn span(&self, ray: &Ray) -> (f32, f32) {
        let slab = |low: f32, high: f32, origin: f32, inverse: f32| {
            let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
            if a < b { (a, b) } else { (b, a) }
        };
        let (x0, x1) = slab(self.low.x, self.high.x, ray.origin.x, ray.inverse.x);
        let (y0, y1) = slab(self.low.y, self.high.y, ray.origin.y, ray.inverse.y);
        let (z0, z1) = slab(self.low.z, self.high.z, ray.origin.z, ray.inverse.z);
        (x0.max(y0).max(z0), x1.min(y1).min(z1))
    }

    /// The outward normal of the face that a ray entered at `entry`.
    fn normal(&self, ray: &Ray, entry: f32) -> Vec3 {
        let d = ray.direction;
        let face = |low: f32, high: f32, origin: f32, direction: f32, inverse: f32| {
            let near = if direction > 0.0 { low } else { high };
            (near - origin) * inverse >= entry
        };
        if face(self.low.x, self.high.x, ray.origin.x, d.x, ray.inverse.x) {
            vec3(-d.x.signum(), 0.0, 0.0)
        } else if face(self.low.y, self.high.y, ray.origin.y, d.y, ray.inverse.y) {
            vec3(0.0, -d.y.signum(), 0.0)
        } else {
            vec3(0.0, 0.0, -d.z.signum())
        }
    }
}

impl Shape {
    /// Where a ray first enters the solid, if that is after `after` and before `before`.
    pub(crate) fn entry(&self, bounds: &Bounds, ray: &Ray, after: f32, before: f32) -> Option<f32> {
        let entry = match self {
            Self::Block => {
                let (entry, exit) = bounds.span(ray);
                if entry > exit {
                    return None;
                }
                entry
            }
            Self::Convex(planes) => convex(planes, bounds, ray)?,
            Self::Column => column(bounds, ray)?,
            Self::Ellipsoid => ellipsoid(bounds, ray)?.0,
        };
        (entry > after && entry < before).then_some(entry)
    }

    /// Where a ray leaves an ellipsoid: foliage is seen through the holes of its near side. Other solids have no far
    /// side.
    pub(crate) fn exit(&self, bounds: &Bounds, ray: &Ray, after: f32, before: f32) -> Option<f32> {
        let Self::Ellipsoid = self else { return None };
        ellipsoid(bounds, ray).map(|(_, exit)| exit).filter(|exit| *exit > after && *exit < before)
    }

    /// The outward normal where [`Shape::entry`] or [`Shape::exit`] found the surface.
    pub(crate) fn normal(&self, bounds: &Bounds, ray: &Ray, depth: f32) -> Vec3 {
        let point = ray.at(depth);
        let centre = bounds.centre();
        match self {
            Self::Block => bounds.normal(ray, bounds.span(ray).0),
            Self::Convex(planes) => entered(planes, bounds, ray),
            Self::Column => vec3(point.x - centre.x, 0.0, point.z - centre.z).normalised(),
            Self::Ellipsoid => {
                let radii = (bounds.high - bounds.low) * 0.5;
                let offset = point - centre;
                vec3(offset.x / (radii.x * radii.x), offset.y / (radii.y * radii.y), offset.z / (radii.z * radii.z))
                    .normalised()
            }
        }
    }
}

fn convex(planes: &[Plane], bounds: &Bounds, ray: &Ray) -> Option<f32> {
    let (mut entry, mut exit) = bounds.span(ray);
    if entry > exit {
        return None;
    }
    for plane in planes {
        let (distance, slope) = (plane.offset - plane.normal.dot(ray.origin), plane.normal.dot(ray.direction));
        if slope < -1e-9 {
            entry = entry.max(distance / slope);
        } else if slope > 1e-9 {
            exit = exit.min(distance / slope);
        } else if distance < 0.0 {
            return None;
        }
    }
    (entry <= exit).then_some(entry)
}

/// The normal of the plane through which a ray came in last.
fn entered(planes: &[Plane], bounds: &Bounds, ray: &Ray) -> Vec3 {
    let mut entry = bounds.span(ray).0;
    let mut normal = None;
    for plane in planes {
        let (distance, slope) = (plane.offset - plane.normal.dot(ray.origin), plane.normal.dot(ray.direction));
        if slope < -1e-9 && distance / slope > entry {
            entry = distance / slope;
            normal = Some(plane.normal);
        }
    }
    normal.unwrap_or_else(|| bounds.normal(ray, entry))
}

fn column(bounds: &Bounds, ray: &Ray) -> Option<f32> {
    let centre = bounds.centre();
    let radius = 0.5 * (bounds.high.x - bounds.low.x);
    let (dx, dz) = (ray.direction.x, ray.direction.z);
    let (ox, oz) = (ray.origin.x - centre.x, ray.origin.z - centre.z);
    let a = dx * dx + dz * dz;
    let b = ox * dx + oz * dz;
    let c = ox * ox + oz * oz - radius * radius;
    let discriminant = b * b - a * c;
    if discriminant <= 0.0 {
        return None;
    }
    let depth = (-b - discriminant.sqrt()) / a;
    let height = ray.origin.y + depth * ray.direction.y;
    (height >= bounds.low.y && height <= bounds.high.y).then_some(depth)
}

fn ellipsoid(bounds: &Bounds, ray: &Ray) -> Option<(f32, f32)> {
    let radii = (bounds.high - bounds.low) * 0.5;
    let shrink = vec3(1.0 / radii.x, 1.0 / radii.y, 1.0 / radii.z);
    let o = (ray.origin - bounds.centre()).times(shrink);
    let d = ray.direction.times(shrink);
    let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - 1.0);
    let discriminant = b * b - a * c;
    if discriminant <= 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    Some(((-root - b) / a, (root - b) / a))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_bounds() -> Bounds {
        Bounds { low: vec3(-1.0, -1.0, 9.0), high: vec3(1.0, 1.0, 11.0) }
    }

    #[test]
    fn solids_are_entered_where_geometry_says() {
        let ahead = Ray::new(vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
        let slant = Plane { normal: vec3(0.0, 1.0, -1.0).normalised(), offset: -10.0 / 2.0_f32.sqrt() };
        for (shape, depth) in
            [(Shape::Block, 9.0), (Shape::Column, 9.0), (Shape::Ellipsoid, 9.0), (Shape::Convex(vec![slant]), 10.0)]
        {
            let hit = shape.entry(&unit_bounds(), &ahead, 0.0, 1e9).expect("straight ahead");
            assert!((hit - depth).abs() < 1e-4, "{shape:?}: {hit}");
            let normal = shape.normal(&unit_bounds(), &ahead, hit);
            assert!(normal.z < 0.0 && (normal.dot(normal) - 1.0).abs() < 1e-5, "{shape:?} faces the camera");
        }
    }

    #[test]
    fn rays_that_pass_by_or_point_away_miss() {
        for shape in [Shape::Block, Shape::Column, Shape::Ellipsoid, Shape::Convex(Vec::new())] {
            for direction in [vec3(0.3, 0.0, 1.0), vec3(0.0, 0.0, -1.0)] {
                let ray = Ray::new(vec3(0.0, 0.0, 0.0), direction);
                assert!(shape.entry(&unit_bounds(), &ray, 0.0, 1e9).is_none(), "{shape:?}");
            }
        }
    }

    #[test]
    fn an_ellipsoid_is_left_behind_its_centre() {
        let ray = Ray::new(vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
        let near = Shape::Ellipsoid.entry(&unit_bounds(), &ray, 0.0, 1e9).expect("enters");
        let far = Shape::Ellipsoid.exit(&unit_bounds(), &ray, 0.0, 1e9).expect("leaves");
        assert!((near - 9.0).abs() < 1e-4 && (far - 11.0).abs() < 1e-4, "{near} {far}");
    }
}
