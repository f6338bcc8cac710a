//! The little of 3x3 matrices that rectification needs.

/// A 3x3 matrix, row-major.
pub type Matrix = [[f64; 3]; 3];

pub(super) const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub(super) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum()))
}

pub(super) fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| a[column][row]))
}

/// The inverse, by cofactors, as OpenCV's `invert` has it of 3x3; not finite where there is no inverse.
pub(super) fn inverse(a: &Matrix) -> Matrix {
    let minor = |[r, s]: [usize; 2], [c, d]: [usize; 2]| a[r][c] * a[s][d] - a[r][d] * a[s][c];
    let determinant =
        a[0][0] * minor([1, 2], [1, 2]) - a[0][1] * minor([1, 2], [0, 2]) + a[0][2] * minor([1, 2], [0, 1]);
    let scale = 1.0 / determinant;
    let others = |of: usize| [[1, 2], [0, 2], [0, 1]][of];
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let sign = if (row + column) % 2 == 0 { scale } else { -scale };
            minor(others(column), others(row)) * sign
        })
    })
}

pub(super) fn times(a: &Matrix, v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|row| (0..3).map(|k| a[row][k] * v[k]).sum())
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The rotation about a vector by its length, radians.
pub(super) fn rotation_about(vector: [f64; 3]) -> Matrix {
    let angle = norm(vector);
    if angle < f64::EPSILON {
        return IDENTITY;
    }
    let [x, y, z] = vector.map(|component| component / angle);
    let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
    let axis = [x, y, z];
    let turned = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            cosine * IDENTITY[row][column] + (1.0 - cosine) * axis[row] * axis[column] + sine * turned[row][column]
        })
    })
}

/// The vector of a rotation: the inverse of [`rotation_about`]. A very small rotation is zero, as in OpenCV's
/// `Rodrigues`.
pub(super) fn vector_of(rotation: &Matrix) -> [f64; 3] {
    let r = nearest_rotation(rotation);
    let twice_sine = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
    let sine = 0.5 * norm(twice_sine);
    let cosine = (0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0)).clamp(-1.0, 1.0);
    if sine < 1e-5 {
        return if cosine > 0.0 { [0.0; 3] } else { half_turn(&r) };
    }
    let scale = libm::acos(cosine) / (2.0 * sine);
    twice_sine.map(|component| component * scale)
}

/// The vector of half a turn, whose axis is the column space of `R + I`, with the signs that OpenCV's `Rodrigues`
/// takes.
fn half_turn(r: &Matrix) -> [f64; 3] {
    let side = |k: usize| (0.5 * (r[k][k] + 1.0)).max(0.0).sqrt();
    let signed = |size: f64, of: f64| if of < 0.0 { -size } else { size };
    let [x, y, mut z] = [side(0), signed(side(1), r[0][1]), signed(side(2), r[0][2])];
    if x < y.abs() && x < z.abs() && (r[1][2] > 0.0) != (y * z > 0.0) {
        z = -z;
    }
    let axis = [x, y, z];
    axis.map(|component| component * core::f64::consts::PI / norm(axis))
}

/// The rotation nearest to a matrix that nearly is one: what a file's few digits leave of it (its polar factor, by
/// Newton's iteration).
fn nearest_rotation(matrix: &Matrix) -> Matrix {
    let mut r = *matrix;
    for _ in 0..8 {
        let rows = [cross(r[1], r[2]), cross(r[2], r[0]), cross(r[0], r[1])];
        let determinant: f64 = (0..3).map(|k| r[0][k] * rows[0][k]).sum();
        // The cofactors over the determinant are the transposed inverse.
        r = std::array::from_fn(|i| std::array::from_fn(|k| 0.5 * (r[i][k] + rows[i][k] / determinant)));
    }
    r
}

#[cfg(test)]
mod tests {
    use super::{IDENTITY, inverse, norm, product, rotation_about, vector_of};

    #[test]
    fn a_matrix_times_its_inverse_is_the_identity() {
        let matrix = [[700.0, 3.0, 610.5], [-2.0, 710.0, 180.25], [0.01, -0.02, 1.0]];
        let found = product(&matrix, &inverse(&matrix));
        for (found, expected) in found.as_flattened().iter().zip(IDENTITY.as_flattened()) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn a_rotation_and_its_vector_are_each_others() {
        for vector in [[0.3, -0.2, 0.1], [0.0, 1e-3, 0.0], [2.0, 1.0, -1.5], [0.0, 0.0, 0.0]] {
            let back = vector_of(&rotation_about(vector));
            assert!(norm([0, 1, 2].map(|k| back[k] - vector[k])) < 1e-12, "{vector:?} {back:?}");
        }
        // Half a turn about an axis is one about its opposite too.
        let half = core::f64::consts::PI;
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [0.0, 0.6, -0.8]] {
            let rotation = rotation_about(axis.map(|component| component * half));
            let back = rotation_about(vector_of(&rotation));
            for (found, expected) in back.as_flattened().iter().zip(rotation.as_flattened()) {
                assert!((found - expected).abs() < 1e-9, "{axis:?}: {back:?}");
            }
        }
    }

    #[test]
    fn digits_that_a_file_left_out_do_not_matter() {
        let vector = [0.03, -0.2, 0.01];
        let written = rotation_about(vector).map(|row| row.map(|x| (x * 1e6).round() / 1e6));
        let back = vector_of(&written);
        assert!(norm([0, 1, 2].map(|k| back[k] - vector[k])) < 1e-6);
    }
}
