//! Static transforms: `tf2_msgs/msg/TFMessage` of `/tf_static`.

use depthloom_graphs::ErrorMessage;
use std::collections::BTreeMap;

use crate::cdr::Cdr;
use crate::form::{Wire, frame};
use crate::{Form, Header, Sort};

/// A rigid motion, 3x4, row-major: rotation and translation (metres).
pub type Motion = [f64; 12];

const MOST_FRAMES: usize = 100_000;

/// The coordinate frames of a robot, each as its parent sees it.
#[derive(Clone, Debug, Default)]
pub struct Transforms(BTreeMap<String, (String, Motion)>);

impl Transforms {
    /// Takes the transforms of a message; they replace earlier ones of the same frames.
    pub fn add(&mut self, form: Form, message: &[u8]) -> Result<(), ErrorMessage> {
        if (form.sort, form.wire) != (Sort::Transforms, Wire::Cdr) {
            return Err(ErrorMessage::new("it holds no transforms"));
        }
        let mut cdr = Cdr::new(message)?;
        // A stamp, two names, seven doubles.
        for _ in 0..cdr.count(8 + 2 * 4 + 7 * 8, "transforms")? {
            let parent = Header::cdr(&mut cdr)?.frame_id;
            let child = frame(cdr.text("child_frame_id")?);
            let [x, y, z] = cdr.f64s("translation")?;
            let quaternion: [f64; 4] = cdr.f64s("rotation")?;
            let norm = quaternion.iter().map(|of| of * of).sum::<f64>().sqrt();
            if !((norm - 1.0).abs() < 0.01 && [x, y, z].iter().all(|of| of.is_finite())) {
                return Err(ErrorMessage::new(format!(
                    "the transform of {child} in {parent} is not a rigid motion: its quaternion has length {norm}"
                )));
            }
            if self.0.len() >= MOST_FRAMES {
                return Err(ErrorMessage::new(format!("more than {MOST_FRAMES} frames are named")));
            }
            self.0.insert(child, (parent, motion([x, y, z], quaternion.map(|of| of / norm))));
        }
        Ok(())
    }

    /// From coordinates in one frame to those in another: `target_from_source`.
    pub fn between(&self, target: &str, source: &str) -> Result<Motion, String> {
        let (of_target, of_source) = (self.ancestors(target), self.ancestors(source));
        for (name, ancestor_from_source) in &of_source {
            if let Some((_, ancestor_from_target)) = of_target.iter().find(|(other, _)| other == name) {
                return Ok(compose(&inverse(ancestor_from_target), ancestor_from_source));
            }
        }
        let root = |of: &[(&str, Motion)]| of.last().map_or_else(String::new, |(name, _)| (*name).to_owned());
        Err(match self.0.is_empty() {
            true => format!("there are no static transforms, and {source} is not {target}"),
            false => format!(
                "no static transforms lead from {source} (below {}) to {target} (below {})",
                root(&of_source),
                root(&of_target)
            ),
        })
    }

    /// A frame and those above it, each with its coordinates from the frame's.
    fn ancestors<'a>(&'a self, name: &'a str) -> Vec<(&'a str, Motion)> {
        let mut chain = vec![(name, motion([0.0; 3], [0.0, 0.0, 0.0, 1.0]))];
        while let Some((parent, parent_from_child)) = chain.last().and_then(|(name, _)| self.0.get(*name)) {
            if chain.iter().any(|(known, _)| known == parent) {
                break;
            }
            let (_, child_from_name) = chain.last().expect("it begins with the frame");
            let parent_from_name = compose(parent_from_child, child_from_name);
            chain.push((parent, parent_from_name));
        }
        chain
    }
}

/// A translation and a unit quaternion (x, y, z, w).
fn motion([tx, ty, tz]: [f64; 3], [x, y, z, w]: [f64; 4]) -> Motion {
    let row = |a: [f64; 3], t: f64| [a[0], a[1], a[2], t];
    let rows = [
        row([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)], tx),
        row([2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)], ty),
        row([2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)], tz),
    ];
    let mut out = [0.0; 12];
    out.iter_mut().zip(rows.as_flattened()).for_each(|(out, of)| *out = *of);
    out
}

/// `a` after `b`; of `a` the left part may be any 3x3.
#[must_use]
pub fn compose(a: &Motion, b: &Motion) -> Motion {
    let mut out = [0.0; 12];
    for (row, column) in (0..3).flat_map(|row| (0..4).map(move |column| (row, column))) {
        let last = if column == 3 { a[4 * row + 3] } else { 0.0 };
        out[4 * row + column] = (0..3).map(|k| a[4 * row + k] * b[4 * k + column]).sum::<f64>() + last;
    }
    out
}

fn inverse(m: &Motion) -> Motion {
    let mut out = [0.0; 12];
    for row in 0..3 {
        for column in 0..3 {
            out[4 * row + column] = m[4 * column + row];
        }
        out[4 * row + 3] = -(0..3).map(|k| m[4 * k + row] * m[4 * k + 3]).sum::<f64>();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Transforms, motion};

    /// A quarter turn about z: x becomes y.
    const QUARTER: [f64; 4] = [0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2];

    fn tree(edges: &[(&str, &str, [f64; 3], [f64; 4])]) -> Transforms {
        Transforms(
            edges
                .iter()
                .map(|(child, parent, t, q)| ((*child).to_owned(), ((*parent).to_owned(), motion(*t, *q))))
                .collect(),
        )
    }

    #[test]
    fn a_point_is_transformed_through_the_common_frame() {
        let none = [0.0, 0.0, 0.0, 1.0];
        let tree = tree(&[
            ("lidar", "base", [1.0, 0.0, 2.0], QUARTER),
            ("mast", "base", [0.0, 3.0, 0.0], none),
            ("camera", "mast", [0.0, 0.0, 1.0], none),
        ]);
        let m = tree.between("camera", "lidar").unwrap();
        // (1, 0, 0) of the lidar is (0, 1, 0) turned, (1, 1, 2) in base, (1, -2, 1) of the camera.
        let at = |row: usize| m[4 * row] + m[4 * row + 3];
        assert!((at(0) - 1.0).abs() < 1e-12 && (at(1) + 2.0).abs() < 1e-12 && (at(2) - 1.0).abs() < 1e-12, "{m:?}");
        assert_eq!(tree.between("camera", "camera").unwrap(), motion([0.0; 3], none));
        assert!(
            tree.between("camera", "moon").unwrap_err().contains("lead from moon (below moon) to camera (below base)")
        );
    }

    #[test]
    fn a_ring_of_frames_ends() {
        let none = [0.0, 0.0, 0.0, 1.0];
        let ring = tree(&[("a", "b", [1.0, 0.0, 0.0], none), ("b", "a", [1.0, 0.0, 0.0], none)]);
        assert!(ring.between("c", "a").is_err());
    }
}
