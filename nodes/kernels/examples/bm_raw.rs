//! Matches and filters raw images named on standard input, one job a line, and prints the milliseconds each took, or why
//! it was refused. What `tests/bm_against_opencv.py` drives.
//!
//! `bm LEFT RIGHT OUT WIDTH HEIGHT THREADS` and then `preFilterType preFilterSize preFilterCap blockSize minDisparity
//! numDisparities textureThreshold uniquenessRatio speckleWindowSize speckleRange disp12MaxDiff`. Images are raw bytes,
//! disparities raw little-endian 16 bits.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::bm::{Error, Params, Prefilter, Scratch, compute};
use depthloom_kernels::tiles::{Crew, Serial, Tiles};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = Scratch::default();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match &words[..] {
            ["bm", left, right, out, numbers @ ..] => matched([left, right, out], numbers, &mut scratch)?,
            _ => return Err(format!("no such job: {line}").into()),
        };
        println!("{answer}");
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn matched(
    [left, right, out]: [&str; 3],
    numbers: &[&str],
    scratch: &mut Scratch,
) -> Result<String, Box<dyn std::error::Error>> {
    let numbers = numbers.iter().map(|word| word.parse()).collect::<Result<Vec<i32>, _>>()?;
    let &[width, height, threads, kind, size, cap, block, min, count, texture, unique, window, range, diff] =
        &numbers[..]
    else {
        return Err(format!("a job holds {} numbers, expected 14", numbers.len()).into());
    };
    let params = Params {
        min_disparity: min,
        disparities: count,
        block,
        prefilter: if kind == 0 { Prefilter::NormalizedResponse } else { Prefilter::XSobel },
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
    let mut timed = |tiles: &dyn Tiles| {
        let start = Instant::now();
        compute(&left, &right, width, height, &params, scratch, tiles, &mut disparity)?;
        Ok::<_, Error>(start.elapsed().as_secs_f64() * 1e3)
    };
    let milliseconds = if threads == 1 {
        timed(&Serial)
    } else {
        let crew = Crew::new(threads as usize);
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(|| crew.work());
            }
            let closing = crew.closing();
            let taken = timed(&crew);
            drop(closing);
            taken
        })
    };
    Ok(match milliseconds {
        Err(error) => format!("refused: {error}"),
        Ok(milliseconds) => {
            std::fs::write(out, disparity.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())?;
            milliseconds.to_string()
        }
    })
}
