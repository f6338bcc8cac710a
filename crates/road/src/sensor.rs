//! From light to bytes: exposure, tone curve, noise that grows with the signal, quantisation.

use crate::hash::Draws;
use crate::vector::Vec3;
use depthloom_random::mix;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sensor {
    gain: f32,
    offset: f32,
    key: u64,
}

/// Standard deviation of the noise, in grey levels: at black, and its growth up to white.
const NOISE_FLOOR: f32 = 1.7;
const NOISE_GROWTH: f32 = 1.7;

impl Sensor {
    /// `eye` is 0 for the left camera, 1 for the right one; the right one's exposure strays by a few percent.
    pub(crate) fn new(seed: u64, frame: u64, eye: u64) -> Self {
        let mut draws = Draws::new(seed ^ 0x5e45_0e00, eye, frame.cast_signed());
        let stray = eye as f32;
        let shared = Draws::new(seed ^ 0x5e45_0e01, 9, frame.cast_signed()).between(-0.05, 0.05);
        Self {
            gain: (1.0 + shared) * (1.0 + stray * draws.between(-0.06, 0.06)),
            offset: stray * draws.between(-1.5, 1.5),
            key: mix(mix(seed ^ frame.rotate_left(32)) ^ eye),
        }
    }

    pub(crate) fn expose(&self, radiance: Vec3, pixel: usize) -> [u8; 3] {
        let noise = mix(self.key ^ (pixel as u64).wrapping_mul(0xd6e8_feb8_6659_fd93));
        // Three bytes of the hash make one nearly Gaussian number of unit variance.
        let gaussian = |lane: u32| {
            let part = (noise >> (21 * lane)) as u32;
            let sum = (part & 127) + ((part >> 7) & 127) + ((part >> 14) & 127);
            (sum as f32 - 190.5) * (2.0 / 128.0)
        };
        let level = |linear: f32, lane: u32| {
            // A square root is close to the usual display curve, and exact on every machine.
            let signal = (linear.max(0.0) * self.gain).sqrt();
            let clean = 255.0 * signal + self.offset;
            let sigma = NOISE_FLOOR + NOISE_GROWTH * signal.min(1.0);
            (clean + sigma * gaussian(lane) + 0.5).clamp(0.0, 255.0) as u8
        };
        [level(radiance.x, 0), level(radiance.y, 1), level(radiance.z, 2)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::vec3;

    fn levels(sensor: &Sensor, linear: f32) -> (f64, f64) {
        let values: Vec<f64> =
            (0..4000).flat_map(|pixel| sensor.expose(vec3(linear, linear, linear), pixel)).map(f64::from).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / values.len() as f64;
        (mean, variance.sqrt())
    }

    #[test]
    fn noise_is_unbiased_and_grows_with_the_signal() {
        let sensor = Sensor { gain: 1.0, offset: 0.0, key: 9 };
        let (dark_mean, dark) = levels(&sensor, 0.01);
        let (bright_mean, bright) = levels(&sensor, 0.64);
        assert!((dark_mean - 25.5).abs() < 0.15 && (bright_mean - 204.0).abs() < 0.2, "{dark_mean} {bright_mean}");
        assert!((dark - f64::from(NOISE_FLOOR + 0.1 * NOISE_GROWTH)).abs() < 0.15, "{dark}");
        assert!((bright - f64::from(NOISE_FLOOR + 0.8 * NOISE_GROWTH)).abs() < 0.15, "{bright}");
    }

    #[test]
    fn frames_and_cameras_have_their_own_noise() {
        let grey = vec3(0.2, 0.2, 0.2);
        let row = |frame, eye| -> Vec<[u8; 3]> {
            let sensor = Sensor { gain: 1.0, offset: 0.0, ..Sensor::new(1, frame, eye) };
            (0..64).map(|pixel| sensor.expose(grey, pixel)).collect()
        };
        assert_eq!(row(0, 0), row(0, 0));
        assert_ne!(row(0, 0), row(1, 0));
        assert_ne!(row(0, 0), row(0, 1));
    }
}
