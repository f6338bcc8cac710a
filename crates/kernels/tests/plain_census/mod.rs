//! The definition of the census matcher, stage by stage, in integers that cannot overflow.

use depthloom_kernels::census::{Census, Pair, Params};

/// Steps from one pixel of a path to the next, rows before columns.
const DIRECTIONS: [(isize, isize); 8] = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)];

pub(crate) fn compute(pair: &Pair<'_>, params: &Params, out: &mut [i16]) {
    let (width, height) = (pair.width, pair.height);
    let costs = costs(pair, params);
    let directions = params.paths as usize;
    let mut sums = vec![0; costs.len()];
    for direction in &DIRECTIONS[..directions] {
        add_path(&costs, (width, height), params, *direction, &mut sums);
    }
    let left = median(&left_map(&sums, params), width);
    let right = median(&right_map(&sums, width, params), width);
    for (index, out) in out.iter_mut().enumerate() {
        let (row, x) = (index / width, index % width);
        *out = params.invalid();
        let Some(answer) = left[index] else { continue };
        let whole = answer.div_euclid(16);
        let partner = x as i32 - whole - params.min_disparity;
        if !(0..width as i32).contains(&partner) {
            continue;
        }
        let back = right[row * width + partner as usize];
        if params.lr_max_diff < 0 || back.is_some_and(|back| (back - whole).abs() <= params.lr_max_diff) {
            *out = (answer + 16 * params.min_disparity) as i16;
        }
    }
}

/// The feature of a pixel, one bit a comparison; none at the border.
fn feature(image: &[u8], pair: &Pair<'_>, x: usize, y: usize, census: Census) -> u64 {
    if x < 4 || x + 4 >= pair.width || y < 3 || y + 3 >= pair.height {
        return 0;
    }
    let at = |dx: isize, dy: isize| image[y.strict_add_signed(dy) * pair.width + x.strict_add_signed(dx)];
    let mut feature = 0;
    for dy in -3..=3 {
        for dx in -4..=4 {
            let bit = match census {
                Census::Symmetric if (dy, dx) < (0, 0) => at(dx, dy) > at(-dx, -dy),
                Census::Full if (dy, dx) != (0, 0) => at(0, 0) > at(dx, dy),
                Census::OffAxis if dy != 0 && dx != 0 => at(0, 0) > at(dx, dy),
                _ => continue,
            };
            feature = feature << 1 | u64::from(bit);
        }
    }
    feature
}

/// What each pixel's match at each disparity costs.
fn costs(pair: &Pair<'_>, params: &Params) -> Vec<i32> {
    let mut costs = Vec::new();
    for y in 0..pair.height {
        for x in 0..pair.width {
            let left = feature(pair.left, pair, x, y, params.census);
            for d in 0..params.disparities {
                let right = match usize::try_from(x as i32 - d - params.min_disparity) {
                    Ok(column) if column < pair.width => feature(pair.right, pair, column, y, params.census),
                    _ => 0,
                };
                costs.push((left ^ right).count_ones() as i32);
            }
        }
    }
    costs
}

/// Adds the costs along all paths of one direction.
fn add_path(
    costs: &[i32],
    (width, height): (usize, usize),
    params: &Params,
    (dy, dx): (isize, isize),
    sums: &mut [i32],
) {
    let disparities = params.disparities as usize;
    let mut path = vec![0; costs.len()];
    for step in 0..width * height {
        // Against the order of rows and columns if the path goes up, or left in its row.
        let index = if (dy, dx) < (0, 0) { width * height - 1 - step } else { step };
        let before = (index / width).checked_add_signed(-dy).zip((index % width).checked_add_signed(-dx));
        let before = before.filter(|&(y, x)| y < height && x < width).map(|(y, x)| (y * width + x) * disparities);
        let before = before.map_or_else(|| vec![0; disparities], |start| path[start..start + disparities].to_vec());
        let least = before.iter().copied().fold(i32::MAX, i32::min);
        for d in 0..disparities {
            let neighbours = [d.checked_sub(1), Some(d + 1)].into_iter().flatten().filter_map(|d| before.get(d));
            let step = neighbours.map(|cost| cost + params.p1).fold(least + params.p2, i32::min);
            let at = index * disparities + d;
            path[at] = costs[at] + step.min(before[d]) - least;
            sums[at] += path[at];
        }
    }
}

/// The left image's answers in 1/16 px above the smallest disparity.
fn left_map(sums: &[i32], params: &Params) -> Vec<Option<i32>> {
    let answer = |sums: &[i32]| {
        let best = (0..sums.len()).min_by_key(|&d| sums[d])?;
        let rival =
            |(d, &sum): (usize, &i32)| d.abs_diff(best) > 1 && (100 - params.uniqueness) * sum < 100 * sums[best];
        if sums.iter().enumerate().any(rival) {
            return None;
        }
        if !params.subpixel || best == 0 || best + 1 == sums.len() {
            return Some(best as i32 * 16);
        }
        let (nearer, farther) = (sums[best - 1], sums[best + 1]);
        let curvature = nearer - 2 * sums[best] + farther;
        Some(best as i32 * 16 + (16 * (nearer - farther) + curvature) / (2 * curvature))
    };
    sums.chunks_exact(params.disparities as usize).map(answer).collect()
}

/// The right image's answers in whole px above the smallest disparity.
fn right_map(sums: &[i32], width: usize, params: &Params) -> Vec<Option<i32>> {
    let disparities = params.disparities as usize;
    let answer = |index: usize| {
        let (row, column) = (index / width, (index % width) as i32);
        let partner = |d: i32| usize::try_from(column + d + params.min_disparity).ok().filter(|&x| x < width);
        let cost = |d: i32| partner(d).map(|x| sums[(row * width + x) * disparities + d as usize]);
        (0..params.disparities).filter(|&d| cost(d).is_some()).min_by_key(|&d| cost(d))
    };
    (0..sums.len() / disparities).map(answer).collect()
}

/// The median of each 3x3 neighbourhood; no answer counts as the largest.
fn median(map: &[Option<i32>], width: usize) -> Vec<Option<i32>> {
    let last = (map.len() / width - 1, width - 1);
    let at = |index: usize| {
        let (y, x) = (index / width, index % width);
        let mut nine = Vec::new();
        for y in [y.saturating_sub(1), y, (y + 1).min(last.0)] {
            for x in [x.saturating_sub(1), x, (x + 1).min(last.1)] {
                nine.push(map[y * width + x].unwrap_or(i32::MAX));
            }
        }
        nine.sort_unstable();
        Some(nine[4]).filter(|&answer| answer != i32::MAX)
    };
    (0..map.len()).map(at).collect()
}
