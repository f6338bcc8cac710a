//! Matches raw images named on standard input, one job a line, and prints the milliseconds each took, or why it was
//! refused.
//!
//! A line: `LEFT RIGHT OUT WIDTH HEIGHT CHANNELS MODE PATH THREADS`, then `minDisparity numDisparities blockSize P1 P2
//! disp12MaxDiff preFilterCap uniquenessRatio speckleWindowSize speckleRange`, then a sum of options, which may be
//! left out: 1 extends the left border, 2 computes the right view (`OUT.right`), 4 the ambiguity (`OUT.ambiguity`).
//! Images are raw bytes, disparities raw little-endian 16-bit numbers, the ambiguity 32-bit ones; PATH is `best` or
//! the name of an implementation (`plain`, ...). What `tests/sgbm_against_opencv.py` and `bench/stereo.sh` drive.

use std::io::{BufRead, Write};
use std::time::Instant;

use depthloom_kernels::sgbm::{Maps, Mode, Params, Path, SgbmScratch, View, compute_maps};
use depthloom_threads::Budget;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scratch = SgbmScratch::default();
    let (mut out, mut right_view, mut ambiguity) = (Vec::new(), Vec::new(), Vec::new());
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
            &[min_disparity, disparities, block, p1, p2, diff, cap, uniqueness, window, range, ref options @ ..],
        ) = (&size[..], &numbers[..])
        else {
            return Err(format!("line holds {} words, expected 19: {line}", words.len()).into());
        };
        let options = options.first().copied().unwrap_or(0);
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
            extend_left: options & 1 != 0,
        };
        let path =
            Path::named(path).ok_or_else(|| format!("no implementation {path} here: {:?}", Path::available()))?;
        let (left, right) = (std::fs::read(left)?, std::fs::read(right)?);
        let [left, right] = [&left, &right].map(|data| View { data, width, height, channels });
        out.resize(width * height, 0);
        right_view.resize(width * height, 0);
        ambiguity.resize(width * height, 0.0);
        let budget = Budget::new(threads.parse()?);
        let _own = budget.permit();
        let maps = Maps {
            disparity: &mut out,
            right: (options & 2 != 0).then_some(&mut right_view),
            ambiguity: (options & 4 != 0).then_some(&mut ambiguity),
        };
        let start = Instant::now();
        if let Err(error) = compute_maps(path, &left, &right, &params, &mut scratch, &budget, maps) {
            println!("refused: {error}");
            continue;
        }
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        if *target != "-" {
            let little_endian = |map: &[i16]| map.iter().flat_map(|d| d.to_le_bytes()).collect::<Vec<u8>>();
            std::fs::write(target, little_endian(&out))?;
            if options & 2 != 0 {
                std::fs::write(format!("{target}.right"), little_endian(&right_view))?;
            }
            if options & 4 != 0 {
                let bytes = ambiguity.iter().flat_map(|share: &f32| share.to_le_bytes());
                std::fs::write(format!("{target}.ambiguity"), bytes.collect::<Vec<u8>>())?;
            }
        }
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
