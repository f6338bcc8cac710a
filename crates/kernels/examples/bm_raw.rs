//! Matches and filters raw images named on standard input, one job a line, and prints the milliseconds each took, or
//! why it was refused. What `tests/bm_against_opencv.py` and `tests/bm_filters_against_references.py` drive.
//!
//! `bm LEFT RIGHT OUT WIDTH HEIGHT THREADS` and then `preFilterType preFilterSize preFilterCap blockSize minDisparity
//! numDisparities textureThreshold uniquenessRatio speckleWindowSize speckleRange disp12MaxDiff`. Images are raw bytes,
//! disparities raw little-endian 16 bits.
//!
//! `fill IN OUT WIDTH INVALID LONGEST`, `speckle IN OUT WIDTH INVALID WINDOW RANGE` and `left-right LEFT RIGHT OUT
//! WIDTH INVALID_LEFT INVALID_RIGHT MAX_DIFFERENCE` filter such disparities.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::bm::{BmScratch, Params, Prefilter, compute};
use depthloom_kernels::fill::fill_background;
use depthloom_kernels::left_right;
use depthloom_kernels::sgbm::{SpeckleScratch, filter_speckles};
use depthloom_threads::Budget;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = BmScratch::default();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match &words[..] {
            ["bm", left, right, out, numbers @ ..] => matched([left, right, out], numbers, &mut scratch)?,
            ["fill", from, out, numbers @ ..] => {
                let [width, invalid, longest] = parsed(numbers)?;
                filtered([from, out], |map| fill_background(map, width as usize, invalid as i16, longest as usize))?
            }
            ["speckle", from, out, numbers @ ..] => {
                let [width, invalid, window, range] = parsed(numbers)?;
                let scratch = &mut SpeckleScratch::default();
                filtered([from, out], |map| {
                    filter_speckles(map, width as usize, invalid as i16, window as usize, range, scratch);
                })?
            }
            ["left-right", left, right, out, numbers @ ..] => {
                let [width, invalid_left, invalid_right, max] = parsed(numbers)?;
                let (right, invalid) = (disparities(right)?, (invalid_left as i16, invalid_right as i16));
                filtered([left, out], |map| left_right::check(map, &right, width as usize, invalid, max))?
            }
            _ => return Err(format!("no such job: {line}").into()),
        };
        println!("{answer}");
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn parsed<const N: usize>(words: &[&str]) -> Result<[i32; N], Box<dyn std::error::Error>> {
    let numbers = words.iter().map(|word| word.parse()).collect::<Result<Vec<i32>, _>>()?;
    numbers.try_into().map_err(|numbers: Vec<_>| format!("a job holds {} numbers, expected {N}", numbers.len()).into())
}

fn disparities(file: &str) -> std::io::Result<Vec<i16>> {
    Ok(std::fs::read(file)?.as_chunks().0.iter().map(|&bytes| i16::from_le_bytes(bytes)).collect())
}

fn write(file: &str, disparities: &[i16]) -> std::io::Result<()> {
    std::fs::write(file, disparities.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())
}

fn filtered([from, out]: [&str; 2], filter: impl FnOnce(&mut [i16])) -> std::io::Result<String> {
    let mut map = disparities(from)?;
    let start = Instant::now();
    filter(&mut map);
    let milliseconds = start.elapsed().as_secs_f64() * 1e3;
    write(out, &map)?;
    Ok(milliseconds.to_string())
}

fn matched(
    [left, right, out]: [&str; 3],
    numbers: &[&str],
    scratch: &mut BmScratch,
) -> Result<String, Box<dyn std::error::Error>> {
    let [width, height, threads, kind, size, cap, block, min, count, texture, unique, window, range, diff] =
        parsed(numbers)?;
    let params = Params {
        min_disparity: min,
        disparities: count,
        block,
        prefilter: if kind == 0 { Prefilter::NormalizedResponse } else { Prefilter::Xsobel },
        prefilter_size: size,
        prefilter_cap: cap,
        texture_threshold: texture,
        uniqueness: unique,
        disp12_max_diff: diff,
        speckle_window: window,
        speckle_range: range,
    };
    let (width, height) = (width as usize, height as usize);
    let (left, right) = (std::fs::read(left)?, std::fs::read(right)?);
    let mut disparity = vec![0; width * height];
    let budget = Budget::new(threads as usize);
    let _own = budget.permit();
    let start = Instant::now();
    Ok(match compute(&left, &right, width, height, &params, scratch, &budget, &mut disparity) {
        Err(error) => format!("refused: {error}"),
        Ok(()) => {
            let milliseconds = start.elapsed().as_secs_f64() * 1e3;
            write(out, &disparity)?;
            milliseconds.to_string()
        }
    })
}
