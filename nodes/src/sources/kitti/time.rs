//! KITTI's files of times: one line per frame.

use std::path::PathBuf;

use depthloom_graphs::contracts::Frame;
use depthloom_graphs::{Fault, regular_file};

use crate::sources::files::shortened;

/// Bytes: a day at 30 Hz.
const MOST_BYTES: u64 = 128 << 20;

pub(super) struct Clock {
    path: PathBuf,
    /// By frame number; there may be more than frames. Empty without a file.
    times_ns: Vec<u64>,
}

impl Clock {
    /// Lines like `2011-09-26 13:02:44.317412775`.
    pub(super) fn of_dates(path: PathBuf) -> Result<Self, Fault> {
        Self::read(path, time_ns, "2011-09-26 13:02:44.317412775")
    }

    /// Lines of seconds.
    pub(super) fn of_seconds(path: PathBuf) -> Result<Self, Fault> {
        let parse = |line: &str| {
            let seconds = line.trim().parse::<f64>().ok().filter(|seconds| (0.0..1e9).contains(seconds));
            seconds.map(|seconds| (seconds * 1e9).round() as u64)
        };
        Self::read(path, parse, "1.036224e-01")
    }

    fn read(path: PathBuf, parse: impl Fn(&str) -> Option<u64>, example: &str) -> Result<Self, Fault> {
        if !path.is_file() {
            return Ok(Self { path, times_ns: Vec::new() });
        }
        let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
        let bytes = regular_file::read(&path, MOST_BYTES).map_err(failed)?;
        let time = |(line, text): (usize, &str)| {
            parse(text).ok_or_else(|| {
                Fault::new(format!("{}:{line}: `{}` is not a time", path.display(), shortened(text)))
                    .remedy(format!("a line is `{example}`; without the file frames come at 10 Hz"))
            })
        };
        let times_ns =
            (1..).zip(String::from_utf8_lossy(&bytes).trim_end().lines()).map(time).collect::<Result<_, _>>()?;
        Ok(Self { path, times_ns })
    }

    /// 10 Hz without any times. A missing time is an error, because two clocks would mix.
    pub(super) fn frame(&self, id: &str, index: u64, line: Option<usize>) -> Result<Frame, Fault> {
        if self.times_ns.is_empty() {
            return Ok(Frame::at_10_hz(id, index));
        }
        let time_ns = line.and_then(|line| self.times_ns.get(line)).copied().ok_or_else(|| {
            let what = format!("{} has {} times, and none of frame {id}", self.path.display(), self.times_ns.len());
            Fault::new(what).remedy("copy or unpack it again; without the file frames come at 10 Hz")
        })?;
        Ok(Frame { id: id.into(), index, time_ns })
    }
}

fn time_ns(line: &str) -> Option<u64> {
    let (date, time) = line.trim().split_once(' ')?;
    let numbers =
        |text: &str, by: char| text.split(by).map(|number| number.parse::<u64>().ok()).collect::<Option<Vec<_>>>();
    let [year, month, day] = numbers(date, '-')?.try_into().ok()?;
    let (time, fraction) = time.split_once('.').unwrap_or((time, ""));
    let [hour, minute, second] = numbers(time, ':')?.try_into().ok()?;
    let is_possible = (1970..2200).contains(&year)
        && (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && (hour, minute, second) < (24, 60, 61)
        && minute < 60
        && second < 61;
    if !is_possible || fraction.len() > 9 || !fraction.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let nanoseconds = format!("{fraction:0<9}").parse::<u64>().ok()?;
    let seconds = ((days(year, month, day) * 24 + hour) * 60 + minute) * 60 + second;
    Some(seconds * 1_000_000_000 + nanoseconds)
}

/// Gregorian calendar.
fn days(year: u64, month: u64, day: u64) -> u64 {
    // Years begin in March, so that the leap day is their last: months then have 30.6 days.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::time_ns;

    #[test]
    fn times_are_those_of_a_clock() {
        // `date -u -d '2011-09-26 13:02:44' +%s`
        assert_eq!(time_ns("2011-09-26 13:02:44.317412775"), Some(1_317_042_164_317_412_775));
        assert_eq!(time_ns("2000-02-29 00:00:00"), Some(951_782_400_000_000_000));
        assert_eq!(time_ns("1970-01-01 00:00:00.5"), Some(500_000_000));
        for wrong in [
            "",
            "2011-09-26",
            "2011-13-26 00:00:00",
            "2011-09-26 25:00:00",
            "2011-09-26 13:02:44.x",
            "13:02:44 2011-09-26",
        ] {
            assert_eq!(time_ns(wrong), None, "{wrong}");
        }
    }
}
