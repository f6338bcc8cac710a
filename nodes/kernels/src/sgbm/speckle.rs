//! Removal of small regions, as `cv::filterSpeckles` does it.

/// Sets to `invalid` every pixel of a 4-connected region of at most `window` pixels, where neighbours belong together if
/// they differ by at most `range` (same unit as the map) and neither is `invalid`. Rows are `width` long.
pub fn filter(map: &mut [i16], width: usize, invalid: i16, window: usize, range: i32) {
    if map.is_empty() {
        return;
    }
    let mut regions = Regions { parent: (0..map.len() as u32).collect(), size: vec![1; map.len()] };
    let joined = |a: i16, b: i16| a != invalid && b != invalid && (i32::from(a) - i32::from(b)).abs() <= range;
    for (y, row) in map.chunks_exact(width).enumerate() {
        let first = y * width;
        for x in 0..width {
            if x > 0 && joined(row[x - 1], row[x]) {
                regions.join(first + x - 1, first + x);
            }
            if y > 0 && joined(map[first + x - width], row[x]) {
                regions.join(first + x - width, first + x);
            }
        }
    }
    for (index, value) in map.iter_mut().enumerate() {
        let root = regions.root(index);
        if regions.size[root] as usize <= window {
            *value = invalid;
        }
    }
}

/// Disjoint sets of pixels.
struct Regions {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl Regions {
    fn root(&mut self, mut index: usize) -> usize {
        while self.parent[index] as usize != index {
            let above = self.parent[self.parent[index] as usize];
            self.parent[index] = above;
            index = above as usize;
        }
        index
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            let (large, small) = if self.size[a] >= self.size[b] { (a, b) } else { (b, a) };
            self.parent[small] = large as u32;
            self.size[large] += self.size[small];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::filter;

    #[test]
    fn small_regions_go_and_large_ones_stay() {
        let mut map = [
            16, 16, 16, -16, 90, //
            16, 18, -16, -16, 90, //
            -16, -16, 500, -16, -16,
        ];
        filter(&mut map, 5, -16, 2, 2);
        assert_eq!(map, [16, 16, 16, -16, -16, 16, 18, -16, -16, -16, -16, -16, -16, -16, -16]);
    }

    #[test]
    fn a_step_above_the_range_parts_regions() {
        let mut map = [0, 0, 0, 3, 3, 3, 3];
        filter(&mut map, 7, -16, 3, 2);
        assert_eq!(map, [-16, -16, -16, 3, 3, 3, 3]);
    }
}
