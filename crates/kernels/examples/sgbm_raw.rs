//! Matches raw images named on standard input, one job a line, and prints the milliseconds each took, or why it was
//! refused.
//!
//! A line: `LEFT RIGHT OUT WIDTH HEIGHT CHANNELS MODE PATH THREADS`, then `minDisparity numDisparities blockSize P1 P2
//! disp12MaxDiff preFilterCap uniquenessRatio speckleWindowSize speckleRange`, and 1 where the left border is extended
//! (`Params::extend_left`; may be left out). Images are raw bytes, the output raw little-endian 16-bit disparities; PATH
//! is `best` or the name of an implementation (`plain`, ...). What `tests/sgbm_against_opencv.py` and `bench/stereo.sh`
//! drive.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::sgbm::{Mode, Params, Path, SgbmScratch, View, compute_on};
use depthloom_threads::Budget;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = SgbmScratch::default();
    let mut out = Vec::new();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let [left, right, target, size @ .., mode, path, threads] = &words[..9.min(words.len())] else {
            return Err(format!("line holds {} words, expected 19: {line}", words.len()).into());
        };
        let size = size.iter().map(|word| word.parse()).collect::<Result<Vec<usize>, _>>()?;
        let numbers = words[9..].iter().map(|word| word.parse()).collect::<Result<Vec<i32>, _>>()?;
        let (
            &[width, height, channels],
            &[min_disparity, disparities, block, p1, p2, diff, cap, uniqueness, window, range, ref extend @ ..],
        ) = (&size[..], &numbers[..])
        else {
            return Err(format!("line holds {} words, expected 19: {line}", words.len()).into());
        };
        let params = Params {
            min_disparity,
            disparities,
            block,
            p1,
            p2,
            disp12_max_diff: diff,
            prefilter_cap: cap,
            uniqueness,
            speckle_window: window,
            speckle_range: range,
            mode: match *mode {
                "sgbm" => Mode::Sgbm,
                "hh" => Mode::Hh,
                "3way" => Mode::ThreeWay,
                "hh4" => Mode::Hh4,
                other => return Err(format!("unknown mode {other}").into()),
            },
            extend_left: extend == [1],
        };
        let path =
            Path::named(path).ok_or_else(|| format!("no implementation {path} here: {:?}", Path::available()))?;
        let (left, right) = (std::fs::read(left)?, std::fs::read(right)?);
        let [left, right] = [&left, &right].map(|data| View { data, width, height, channels });
        out.resize(width * height, 0);
        let budget = Budget::new(threads.parse()?);
        let _own = budget.permit();
        let start = Instant::now();
        if let Err(error) = compute_on(path, &left, &right, &params, &mut scratch, &budget, &mut out) {
            println!("refused: {error}");
            continue;
        }
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        if *target != "-" {
            std::fs::write(target, out.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())?;
        }
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
