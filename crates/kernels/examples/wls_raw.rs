//! Smooths raw disparity maps named on standard input, one job a line, and prints the milliseconds each took. What
//! `tests/wls_against_opencv.py` drives.
//!
//! `GUIDE LEFT RIGHT OUT WIDTH HEIGHT CHANNELS THREADS INVALID_LEFT INVALID_RIGHT MAX_DIFFERENCE RADIUS FILL ITERATIONS
//! LAMBDA SIGMA ATTENUATION`; the guide is raw bytes, disparities are raw little-endian 16 bits, and RIGHT is `-` if
//! there is no right view.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::weighted_least_squares::{Guide, Params, Right, Smoother, SmootherScratch};
use depthloom_threads::Budget;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = SmootherScratch::default();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let ([guide, left, right, out], numbers) = words.split_first_chunk().ok_or("a job names four files")?;
        println!("{}", smoothed([guide, left, right, out], numbers, &mut scratch)?);
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn disparities(file: &str) -> std::io::Result<Vec<i16>> {
    Ok(std::fs::read(file)?.as_chunks().0.iter().map(|&bytes| i16::from_le_bytes(bytes)).collect())
}

fn smoothed(
    [guide, left, right, out]: [&str; 4],
    numbers: &[&str],
    scratch: &mut SmootherScratch,
) -> Result<f64, Box<dyn std::error::Error>> {
    let (whole, real) = numbers.split_at_checked(10).ok_or("a job holds ten whole numbers")?;
    let whole = whole.iter().map(|word| word.parse()).collect::<Result<Vec<i32>, _>>()?;
    let real = real.iter().map(|word| word.parse()).collect::<Result<Vec<f32>, _>>()?;
    let &[width, height, channels, threads, invalid, invalid_right, max_difference, radius, fill, iterations] =
        &whole[..]
    else {
        unreachable!("ten were split off")
    };
    let &[lambda, sigma, attenuation] = &real[..] else { return Err("a job holds three real numbers".into()) };
    let smoother = Smoother::new(Params { lambda, sigma, attenuation, iterations: iterations as u32 });
    let samples = std::fs::read(guide)?;
    let guide =
        Guide { samples: &samples, width: width as usize, height: height as usize, channels: channels as usize };
    let other = if right == "-" { None } else { Some(disparities(right)?) };
    let right = other.as_deref().map(|disparity| Right {
        disparity,
        invalid: invalid_right as i16,
        max_difference,
        radius: radius as usize,
    });
    let mut map = disparities(left)?;
    let budget = Budget::new(threads as usize);
    let _own = budget.permit();
    let start = Instant::now();
    smoother.filter(&mut map, invalid as i16, &guide, right.as_ref(), fill != 0, scratch, &budget);
    let milliseconds = start.elapsed().as_secs_f64() * 1e3;
    std::fs::write(out, map.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())?;
    Ok(milliseconds)
}
