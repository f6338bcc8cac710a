//! Matches raw grey images named on standard input by census costs, one job a line, and prints the milliseconds each
//! took, or why it was refused.
//!
//! A line: `LEFT RIGHT OUT WIDTH HEIGHT CENSUS PATHS LEVEL THREADS`, then `min_disparity disparities p1 p2 uniqueness
//! subpixel lr_max_diff`. Images are raw bytes, the output raw little-endian 16-bit disparities (`-`: none written);
//! CENSUS is `symmetric`, `full` or `off-axis`, PATHS 4 or 8, LEVEL `best` or the name of an instruction set
//! (`portable`, ...), subpixel 0 or 1. What `tests/census_against_numpy.py` drives.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::census::{Census, CensusScratch, Pair, Params, compute_at};
use depthloom_kernels::simd::Level;
use depthloom_threads::Budget;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = CensusScratch::default();
    let mut out = Vec::new();
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[left, right, target, width, height, census, paths, level, threads, ref numbers @ ..] = &words[..] else {
            return Err(format!("line holds {} words, expected 16: {line}", words.len()).into());
        };
        let numbers = numbers.iter().map(|word| word.parse()).collect::<Result<Vec<i32>, _>>()?;
        let &[min_disparity, disparities, p1, p2, uniqueness, subpixel, lr_max_diff] = &numbers[..] else {
            return Err(format!("line holds {} words, expected 16: {line}", words.len()).into());
        };
        let params = Params {
            min_disparity,
            disparities,
            p1,
            p2,
            uniqueness,
            subpixel: subpixel != 0,
            lr_max_diff,
            census: match census {
                "symmetric" => Census::Symmetric,
                "full" => Census::Full,
                "off-axis" => Census::OffAxis,
                other => return Err(format!("unknown census {other}").into()),
            },
            paths: paths.parse()?,
        };
        let level =
            Level::named(level).ok_or_else(|| format!("no instruction set {level} here: {:?}", Level::available()))?;
        let (left, right) = (std::fs::read(left)?, std::fs::read(right)?);
        let pair = Pair { left: &left, right: &right, width: width.parse()?, height: height.parse()? };
        out.resize(pair.width * pair.height, 0);
        let budget = Budget::new(threads.parse()?);
        let _own = budget.permit();
        let start = Instant::now();
        match compute_at(level, &pair, &params, &mut scratch, &budget, &mut out) {
            Ok(()) => {
                let milliseconds = start.elapsed().as_secs_f64() * 1e3;
                if target != "-" {
                    std::fs::write(target, out.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>())?;
                }
                println!("{milliseconds}");
            }
            Err(error) => println!("refused: {error}"),
        }
        std::io::stdout().flush()?;
    }
    Ok(())
}
