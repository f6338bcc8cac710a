//! Adam (Kingma, Ba 2015).

use rayon::prelude::*;

const DECAYS: [f32; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-8;

/// Values that one thread changes at a time.
const SHARE: usize = 1 << 14;

/// One step, the `time`-th from 1 on, of one parameter with its moments, first and second.
pub(super) fn step(rate: f64, time: u64, values: &mut [f32], gradient: &[f32], [first, second]: &mut [Vec<f32>; 2]) {
    first.resize(values.len(), 0.0);
    second.resize(values.len(), 0.0);
    let time = i32::try_from(time).unwrap_or(i32::MAX);
    let root = (1.0 - DECAYS[1].powi(time)).sqrt();
    let (factor, epsilon, rate) = (root / (1.0 - DECAYS[0].powi(time)), EPSILON * root, rate as f32);
    let parts = values.par_chunks_mut(SHARE).zip(gradient.par_chunks(SHARE));
    let moments = first.par_chunks_mut(SHARE).zip(second.par_chunks_mut(SHARE));
    parts.zip(moments).for_each(|((values, gradient), (first, second))| {
        let moments = first.iter_mut().zip(second);
        for ((value, &gradient), (first, second)) in values.iter_mut().zip(gradient).zip(moments) {
            *first = *first * DECAYS[0] + gradient * (1.0 - DECAYS[0]);
            *second = *second * DECAYS[1] + gradient * gradient * (1.0 - DECAYS[1]);
            *value -= *first * factor / (second.sqrt() + epsilon) * rate;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::step;

    #[test]
    fn steps_are_those_of_the_paper() {
        // Algorithm 1 of the paper, in f64.
        let gradients = [[0.5_f64, -2.0], [0.1, 3.0], [-0.7, 0.01]];
        let (mut expected, mut m, mut v) = ([1.0_f64, -1.0], [0.0_f64; 2], [0.0_f64; 2]);
        let (mut values, mut moments) = ([1.0_f32, -1.0], [Vec::new(), Vec::new()]);
        for (step_index, gradient) in gradients.iter().enumerate() {
            let time = step_index as i32 + 1;
            for i in 0..2 {
                m[i] = 0.9 * m[i] + 0.1 * gradient[i];
                v[i] = 0.999 * v[i] + 0.001 * gradient[i] * gradient[i];
                let (m_hat, v_hat) = (m[i] / (1.0 - 0.9_f64.powi(time)), v[i] / (1.0 - 0.999_f64.powi(time)));
                expected[i] -= 0.01 * m_hat / (v_hat.sqrt() + 1e-8);
            }
            step(0.01, time as u64, &mut values, &gradient.map(|g| g as f32), &mut moments);
            for (value, expected) in values.iter().zip(expected) {
                assert!((f64::from(*value) - expected).abs() < 1e-5, "step {time}: {value} for {expected}");
            }
        }
    }
}
