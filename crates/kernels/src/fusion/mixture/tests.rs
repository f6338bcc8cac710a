use super::reliability::{CLASSES, KNOTS, Reliability, Statistics, class, knot};
use super::*;
use crate::raster::reflect101;
use crate::simd::every_level;
use proptest::prelude::*;

const NAN: f32 = f32::NAN;
const KITTI: Geometry = Geometry { focal_px: 721.5377, baseline_metres: 0.532725, doffs_px: 0.0 };
const RULES: Rules = Rules {
    consistent: 0.99,
    close: 0.8,
    inconsistent: 0.35,
    keep: 0.97,
    not_unique: 0.5,
    near_factor: 1.5,
    near: 0.02,
    unique_most: 0.9,
    support: None,
    unconfident: 1.0,
};
const LOCAL: Local = Local { sigma: 18.0, regulariser: 0.05, iterations: 4, least_spread: 0.05 };

fn mixture(alignment: Alignment) -> Mixture {
    Mixture {
        alignment,
        stereo_noise: 1.0,
        mono_spread: 0.4,
        outliers: 128_f32.ln(),
        cap: 80.0,
        prior: Prior::Rules(RULES),
    }
}

/// Alignments with every size of cells, and none.
fn alignments() -> [Alignment; 5] {
    let local = |sigma| Alignment::Local(Local { sigma, ..LOCAL });
    [Alignment::None, local(18.0), local(10.0), local(3.0), local(40.0)]
}

/// The maps of a frame.
#[derive(Clone, Debug)]
struct Maps {
    width: usize,
    height: usize,
    disparity: Vec<i16>,
    mono: Vec<f32>,
    right: Vec<i16>,
    unique: Vec<i16>,
    weights: Vec<f32>,
}

impl Maps {
    fn frame(&self) -> Frame<'_> {
        Frame {
            width: self.width,
            height: self.height,
            disparity: Disparities { sixteenths: &self.disparity, invalid: -16 },
            range_end: 64.0,
            geometry: KITTI,
            mono: &self.mono,
            mono_deviation: None,
            evidence: StereoEvidence {
                right: Some(Disparities { sixteenths: &self.right, invalid: -1040 }),
                unique: Some(Disparities { sixteenths: &self.unique, invalid: -16 }),
                ambiguity: Some(&self.weights),
                confidence: Some(&self.weights),
            },
        }
    }

    /// A slanted surface whose monocular depth is wrong by a smooth factor, with noise and outliers in stereo.
    fn street(width: usize, height: usize) -> Self {
        let mut state = 7_u32;
        let mut below = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % n
        };
        let pixels = width * height;
        let mut maps = Self {
            width,
            height,
            disparity: vec![-16; pixels],
            mono: vec![0.0; pixels],
            right: vec![-1040; pixels],
            unique: vec![-16; pixels],
            weights: (0..pixels).map(|_| below(1001) as f32 / 1000.0).collect(),
        };
        for i in 0..pixels {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let px = 8.0 + 0.4 * y + 0.05 * x;
            let true_depth = KITTI.metre_pixels() / px;
            maps.mono[i] = true_depth * (1.1 + 0.3 * libm::sinf(x / 40.0) * libm::cosf(y / 30.0));
            maps.disparity[i] = match below(12) {
                0 => -16,
                1 | 2 => below(1024) as i16,
                _ => (px * 16.0) as i16 + below(20) as i16 - 10,
            };
            if below(3) > 0 {
                maps.unique[i] = maps.disparity[i];
            }
            if below(4) > 0 {
                maps.right[i] = -((px * 16.0) as i16) - below(60) as i16;
            }
        }
        maps
    }
}

/// Depth, deviation, inlier probability and aligned depth, of every level.
fn fused(mixture: &Mixture, frame: &Frame<'_>) -> [Vec<f32>; 4] {
    let bits = every_level(|level| {
        let mut maps = [(); 4].map(|()| vec![-7.0; frame.mono.len()]);
        let [depth, deviation, inlier, aligned] = &mut maps;
        let mut out = Fused { depth, deviation, inlier, aligned };
        // The second call meets the buffers of the first.
        let mut scratch = MixtureScratch::default();
        fuse_at(level, mixture, frame, &mut scratch, &mut out);
        fuse_at(level, mixture, frame, &mut scratch, &mut out);
        maps.map(|map| map.into_iter().map(f32::to_bits).collect::<Vec<_>>())
    });
    bits.map(|map| map.into_iter().map(f32::from_bits).collect())
}

/// The definition, in `f64` at every pixel: depth before the median, the standard deviation of its logarithm, the
/// inlier probability, aligned depth.
fn expected(mixture: &Mixture, rules: &Rules, frame: &Frame<'_>) -> Vec<[f64; 4]> {
    let (width, height) = (frame.width, frame.height);
    let pixels = width * height;
    let metre_pixels = 721.5377 * 0.532725;
    let cap = f64::from(mixture.cap);
    let valid: Vec<bool> = frame.disparity.sixteenths.iter().map(|&d| d > 0).collect();
    let px: Vec<f64> = frame.disparity.sixteenths.iter().map(|&d| f64::from(d.max(1)) / 16.0).collect();
    let z_s: Vec<f64> = px.iter().map(|px| libm::log((metre_pixels / px).min(cap))).collect();
    let s_s: Vec<f64> = px.iter().map(|px| (f64::from(mixture.stereo_noise) / px).max(1e-3)).collect();
    let z_0: Vec<f64> = frame.mono.iter().map(|&mono| libm::log(f64::from(mono))).collect();
    let evidence = &frame.evidence;
    let right_apart = |i: usize, right: &Disparities<'_>| {
        let column = ((i % width) as f64 - px[i]).round_ties_even().clamp(0.0, (width - 1) as f64);
        let other = right.sixteenths[i / width * width + column as usize];
        if other == right.invalid { f64::INFINITY } else { (f64::from(other) / 16.0 + px[i]).abs() }
    };
    let unique = |i: usize| {
        evidence.unique.is_none_or(|unique| unique.sixteenths[i] > 0)
            && evidence.ambiguity.is_none_or(|ambiguity| ambiguity[i] <= rules.unique_most)
    };
    let trusted: Vec<bool> = (0..pixels)
        .map(|i| valid[i] && unique(i) && evidence.right.is_none_or(|right| right_apart(i, &right) <= 1.0))
        .collect();
    let support = |i: usize| {
        let Some(support) = &rules.support else { return 1.0 };
        let near = |a: usize, b: usize| a.abs_diff(b) <= support.radius;
        let window = || (0..pixels).filter(|&j| near(i % width, j % width) && near(i / width, j / width));
        let share = window().filter(|&j| trusted[j]).count() as f64 / window().count() as f64;
        let (low, high) = (f64::from(support.low), f64::from(support.high));
        ((share - low) / (high - low)).clamp(f64::from(support.floor), 1.0)
    };
    let support: Vec<f64> = (0..pixels).map(support).collect();
    let prior = |i: usize| {
        let mut prior = f64::from(rules.keep);
        prior *= match evidence.right {
            None => f64::from(rules.consistent),
            Some(right) => {
                let apart = right_apart(i, &right);
                f64::from(match apart {
                    0.0..=1.0 => rules.consistent,
                    1.0..=3.0 => rules.close,
                    _ => rules.inconsistent,
                })
            }
        };
        prior *= support[i];
        if evidence.unique.is_some_and(|unique| unique.sixteenths[i] <= 0) {
            prior *= f64::from(rules.not_unique);
        }
        if f64::from(frame.mono[i]) < f64::from(rules.near_factor) * metre_pixels / f64::from(frame.range_end) {
            prior *= f64::from(rules.near);
        }
        if let Some(ambiguity) = evidence.ambiguity {
            prior *= if ambiguity[i] > rules.unique_most { f64::from(rules.not_unique) } else { 1.0 };
        }
        if let Some(confidence) = evidence.confidence {
            prior *= 1.0 - f64::from(1.0 - confidence[i]) * f64::from(1.0 - rules.unconfident);
        }
        prior
    };
    let most: Vec<f64> = (0..pixels).map(|i| spread(mixture, frame, i)).collect();
    let (mut z_m, mut s_m) = (z_0.clone(), most.clone());
    let posterior = |i: usize, z_m: f64, s_m: f64| {
        let variance = s_s[i] * s_s[i] + s_m * s_m;
        let density = libm::exp(-0.5 * (z_s[i] - z_m) * (z_s[i] - z_m) / variance)
            / (2.0 * std::f64::consts::PI * variance).sqrt();
        let inlier = prior(i) * density;
        if valid[i] { inlier / (inlier + (1.0 - prior(i)) / f64::from(mixture.outliers)) } else { 0.0 }
    };
    if let Alignment::Local(local) = &mixture.alignment {
        let least = f64::from(local.least_spread);
        for _ in 0..local.iterations {
            let mut maps = [(); 3].map(|()| vec![0.0; pixels]);
            for i in 0..pixels {
                let weight = posterior(i, z_m[i], s_m[i]) * (least / s_s[i]).powi(2).min(1.0);
                let apart = if valid[i] { z_s[i] - z_0[i] } else { 0.0 };
                (maps[0][i], maps[1][i], maps[2][i]) = (weight, weight * apart, weight * apart * apart);
            }
            let [weight, first, second] = maps.map(|map| gaussian(&map, width, height, local.sigma));
            for i in 0..pixels {
                let (mean, regular) = (first[i] / (weight[i] + 1e-6), weight[i] + f64::from(local.regulariser));
                let spread = (second[i] / (weight[i] + 1e-6) - mean * mean).max(0.0).sqrt();
                let share = weight[i] / regular;
                z_m[i] = z_0[i] + first[i] / regular;
                s_m[i] = (share * spread.max(least) + (1.0 - share) * most[i]).max(least).min(most[i]);
            }
        }
    }
    let mut out = Vec::new();
    for i in 0..pixels {
        let q = posterior(i, z_m[i], s_m[i]);
        let (stereo, mono) = (1.0 / (s_s[i] * s_s[i]), 1.0 / (s_m[i] * s_m[i]));
        let mean = (z_s[i] * stereo + z_m[i] * mono) / (stereo + mono);
        let z = if valid[i] { q * mean + (1.0 - q) * z_m[i] } else { z_m[i] };
        let variance =
            q * (1.0 / (stereo + mono) + (mean - z).powi(2)) + (1.0 - q) * (s_m[i] * s_m[i] + (z_m[i] - z).powi(2));
        out.push([libm::exp(z).min(cap), variance.sqrt(), q, libm::exp(z_m[i]).min(cap)]);
    }
    out
}

/// The standard deviation of monocular log depth before alignment.
fn spread(mixture: &Mixture, frame: &Frame<'_>, i: usize) -> f64 {
    let deviation = frame.mono_deviation.map_or(NAN, |deviation| deviation[i]);
    let relative = f64::from(deviation) / f64::from(frame.mono[i]);
    if relative > 0.0 { relative } else { f64::from(mixture.mono_spread) }
}

/// OpenCV's `GaussianBlur` of 32-bit float images.
fn gaussian(map: &[f64], width: usize, height: usize, sigma: f64) -> Vec<f64> {
    let radius = ((8.0 * sigma + 1.0).round() as usize | 1) as isize / 2;
    let raw: Vec<f64> = (-radius..=radius).map(|x| libm::exp(-0.5 * (x * x) as f64 / (sigma * sigma))).collect();
    let total: f64 = raw.iter().sum();
    let along = |from: &dyn Fn(isize) -> f64| -> f64 {
        raw.iter().zip(-radius..=radius).map(|(tap, offset)| tap / total * from(offset)).sum()
    };
    let at = |x: usize, offset: isize, len: usize| reflect101(x as isize + offset, len);
    let rows: Vec<f64> =
        (0..map.len()).map(|i| along(&|offset| map[i / width * width + at(i % width, offset, width)])).collect();
    (0..map.len()).map(|i| along(&|offset| rows[at(i / width, offset, height) * width + i % width])).collect()
}

/// The medians that end the fusion, of the definition.
fn median(expected: &[[f64; 4]], frame: &Frame<'_>) -> Vec<f32> {
    let depth: Vec<f32> = expected.iter().map(|pixel| pixel[0] as f32).collect();
    let mut out = vec![0.0; depth.len()];
    median5_of_valid(&depth, frame.width, frame.height, &mut out);
    out
}

#[test]
fn every_alignment_is_the_definition() {
    let maps = Maps::street(171, 74);
    let support = Some(Support { radius: 4, low: 0.1, high: 0.5, floor: 0.2 });
    let rules = Rules { unique_most: 0.6, unconfident: 0.7, support, ..RULES };
    // Some pixels have no deviation of their own, and some are surer than any alignment.
    let deviation = |(i, mono): (usize, &f32)| if i % 5 == 0 { NAN } else { mono * (0.02 + 0.1 * (i % 7) as f32) };
    let deviation: Vec<f32> = maps.mono.iter().enumerate().map(deviation).collect();
    for (alignment, mono_deviation) in
        alignments().into_iter().flat_map(|one| [None, Some(&deviation[..])].map(|own| (one.clone(), own)))
    {
        let mixture = Mixture { prior: Prior::Rules(rules.clone()), ..mixture(alignment) };
        let frame = Frame { mono_deviation, ..maps.frame() };
        let [depth, deviation, inlier, aligned] = fused(&mixture, &frame);
        let expected = expected(&mixture, &rules, &frame);
        let filtered = median(&expected, &frame);
        let mut worst = [0.0_f64; 4];
        for (i, [_, spread, q, mono]) in expected.iter().enumerate() {
            let off = [
                f64::from(depth[i]) / f64::from(filtered[i]) - 1.0,
                f64::from(deviation[i] / depth[i]) / spread - 1.0,
                f64::from(inlier[i]) - q,
                f64::from(aligned[i]) / mono - 1.0,
            ];
            worst.iter_mut().zip(off).for_each(|(worst, off)| *worst = worst.max(off.abs()));
        }
        println!("{:?}: off by at most {worst:?}", mixture.alignment);
        let most = if mixture.alignment == Alignment::None { 2e-6 } else { 1e-3 };
        assert!(worst.iter().all(|&off| off < most), "{:?}: {worst:?}", mixture.alignment);
    }
}

#[test]
fn without_evidence_stereo_is_consistent_and_unique() {
    let maps = Maps::street(70, 9);
    let frame = Frame { evidence: StereoEvidence::default(), ..maps.frame() };
    let mixture = mixture(Alignment::None);
    let inlier = &fused(&mixture, &frame)[2];
    for (inlier, expected) in inlier.iter().zip(expected(&mixture, &RULES, &frame)) {
        assert!((f64::from(*inlier) - expected[2]).abs() < 1e-5);
    }
}

#[test]
fn an_invalid_estimate_leaves_the_other() {
    // Columns: both valid, only stereo, only mono, neither. The median does not cross bands of five rows and more.
    let columns: [(i16, f32); 4] = [(160, 40.0), (160, NAN), (-16, 40.0), (-16, f32::INFINITY)];
    for alignment in alignments() {
        for (disparity, mono) in columns {
            let maps = Maps {
                width: 7,
                height: 6,
                disparity: vec![disparity; 42],
                mono: vec![mono; 42],
                right: vec![-160; 42],
                unique: vec![160; 42],
                weights: vec![1.0; 42],
            };
            let mixture = mixture(alignment.clone());
            let [depth, deviation, inlier, aligned] = fused(&mixture, &maps.frame());
            let stereo = KITTI.metre_pixels() / 10.0;
            for i in 0..42 {
                match (disparity > 0, mono.is_finite()) {
                    (true, true) => {
                        assert!(
                            depth[i] >= stereo.min(aligned[i]) * 0.9999 && depth[i] <= stereo.max(aligned[i]) * 1.0001
                        );
                        assert!(inlier[i] > 0.0 && deviation[i] > 0.0);
                    }
                    (true, false) => {
                        assert_eq!(depth[i], stereo);
                        assert!((deviation[i] - stereo / 10.0).abs() < 1e-4, "{}", deviation[i]);
                        // An ambiguity of 1 counts as not unique.
                        assert!((inlier[i] - 0.97 * 0.99 * 0.5).abs() < 1e-6, "{}", inlier[i]);
                        assert!(aligned[i].is_nan());
                    }
                    (false, true) => {
                        assert_eq!((depth[i], inlier[i]), (aligned[i], 0.0));
                        assert!((aligned[i] - 40.0).abs() < 1e-4, "{}", aligned[i]);
                        assert!((deviation[i] / depth[i] - 0.4).abs() < 1e-5);
                    }
                    (false, false) => {
                        assert!(depth[i].is_nan() && deviation[i].is_nan() && aligned[i].is_nan());
                        assert_eq!(inlier[i], 0.0);
                    }
                }
            }
        }
    }
}

#[test]
fn local_alignment_undoes_a_smooth_factor() {
    let maps = Maps::street(171, 74);
    let aligned = |alignment| fused(&mixture(alignment), &maps.frame())[3].clone();
    let off = |aligned: &[f32]| {
        let px = |i: usize| 8.0 + 0.4 * (i / 171) as f32 + 0.05 * (i % 171) as f32;
        let error = |(i, depth): (usize, &f32)| (depth / (KITTI.metre_pixels() / px(i)) - 1.0).abs();
        aligned.iter().enumerate().map(error).sum::<f32>() / aligned.len() as f32
    };
    let (before, after) = (off(&aligned(Alignment::None)), off(&aligned(Alignment::Local(LOCAL))));
    assert!(after < 0.3 * before, "a mean error of {before} became {after}");
}

#[test]
fn a_learned_prior_that_is_constant_is_the_rule_of_that_constant() {
    let maps = Maps::street(171, 74);
    let rules =
        Rules { consistent: 1.0, close: 1.0, inconsistent: 1.0, not_unique: 1.0, near: 1.0, keep: 0.75, ..RULES };
    let learned = Reliability { inlier: [0.75; CLASSES], spread: [0.4; KNOTS] };
    for alignment in alignments() {
        let with = |prior| fused(&Mixture { prior, ..mixture(alignment.clone()) }, &maps.frame());
        let bits = |maps: [Vec<f32>; 4]| maps.map(|map| map.into_iter().map(f32::to_bits).collect::<Vec<_>>());
        assert!(bits(with(Prior::Rules(rules.clone()))) == bits(with(Prior::Learned(Box::new(learned.clone())))));
    }
}

#[test]
fn reliability_is_learned_from_the_trusted_pixels() {
    let mut maps = Maps::street(171, 74);
    // Nothing is wrong but two of twelve disparities, which no evidence shows; in the last 40 columns all are.
    let shown = |maps: &Maps| {
        let mut statistics = Statistics::default();
        statistics.add(&Frame { evidence: StereoEvidence::default(), ..maps.frame() }, 80.0);
        statistics.reliability(1.0).expect("trusted pixels")
    };
    let learned = shown(&maps);
    // The monocular depth is wrong by a factor of 1.1 + 0.3 sin cos: 0.1 in the mean, 0.15 around it.
    let at = |metres: f32| learned.spread[(0..KNOTS).find(|at| knot(*at) >= metres).unwrap()];
    assert!([10.0, 16.0].iter().all(|metres| (0.1..0.3).contains(&at(*metres))), "{:?}", learned.spread);
    let prior = |support, nearness| learned.inlier[class(0, true, support, nearness)];
    assert_eq!(prior(3, 0), 0.99);

    for (i, disparity) in maps.disparity.iter_mut().enumerate() {
        if i % 171 > 130 {
            // Valid in one of four pixels, so that their classes have little support.
            *disparity = if i % 4 == 0 { 900 } else { -16 };
        }
    }
    let learned = shown(&maps);
    let prior = |support, nearness| learned.inlier[class(0, true, support, nearness)];
    assert!(prior(0, 1) < 0.5, "{}", prior(0, 1));
}

#[test]
fn without_trusted_pixels_nothing_is_learned() {
    let maps = Maps { disparity: vec![-16; 90 * 30], ..Maps::street(90, 30) };
    let mut statistics = Statistics::default();
    assert!(statistics.reliability(1.0).is_none());
    statistics.add(&maps.frame(), 80.0);
    assert!(statistics.reliability(1.0).is_none() && statistics.frames() == 1 && statistics.trusted() == 0);
}

#[test]
#[should_panic(expected = "mono has 1 samples")]
fn maps_of_another_size_are_refused() {
    let maps = Maps::street(2, 1);
    let mono = [1.0];
    fused(&mixture(Alignment::None), &Frame { mono: &mono, ..maps.frame() });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_frame_of_any_size_is_between_its_estimates_on_every_level(
        maps in (1usize..90, 1usize..30).prop_flat_map(|(width, height)| {
            let pixels = width * height;
            let disparity = prop_oneof![1 => Just(-16_i16), 4 => 0_i16..1024];
            let mono = prop_oneof![1 => Just(NAN), 1 => Just(0.0), 1 => Just(1e-30), 1 => Just(1e30), 8 => 1_f32..100.0];
            let right = prop_oneof![1 => Just(-1040_i16), 4 => -1024_i16..0];
            (
                prop::collection::vec(disparity.clone(), pixels),
                prop::collection::vec(mono, pixels),
                prop::collection::vec(right, pixels),
                prop::collection::vec(disparity, pixels),
                prop::collection::vec(0_f32..=1.0, pixels),
            )
                .prop_map(move |(disparity, mono, right, unique, weights)| {
                    Maps { width, height, disparity, mono, right, unique, weights }
                })
        }),
        index in 0usize..5,
    ) {
        let alignment = alignments()[index].clone();
        let [depth, deviation, inlier, aligned] = fused(&mixture(alignment), &maps.frame());
        // The median of a window is between the least and the largest of its pixels; so it is enough to look at all.
        let (mut least, mut most) = (f32::INFINITY, 0_f32);
        for i in 0..depth.len() {
            let stereo = if maps.disparity[i] > 0 { KITTI.metre_pixels() * 16.0 / f32::from(maps.disparity[i]) } else { NAN };
            for estimate in [stereo, aligned[i]] {
                if estimate.is_finite() {
                    (least, most) = (least.min(estimate.min(80.0)), most.max(estimate.min(80.0)));
                }
            }
            let mono_valid = maps.mono[i] > 0.0;
            prop_assert_eq!(aligned[i].is_finite(), mono_valid);
            prop_assert!((0.0..=1.0).contains(&inlier[i]));
            if mono_valid || stereo.is_finite() {
                prop_assert!(depth[i].is_finite() && deviation[i] >= 0.0);
            }
        }
        for depth in depth.into_iter().filter(|depth| depth.is_finite()) {
            prop_assert!(depth >= least * 0.999 && depth <= most * 1.001, "{} is not in {}..{}", depth, least, most);
        }
    }
}
