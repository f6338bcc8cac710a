//! KITTI's timestamps: `2011-09-26 13:02:44.317412775`, a line a frame.

use std::path::Path;

use depthloom_graphs::contracts::Frame;
use depthloom_graphs::{Fault, regular_file};

/// Bytes: a day at 30 Hz.
const MOST_BYTES: u64 = 128 << 20;

/// Nanoseconds since 1970 by frame number; may be more than there are frames.
pub(super) fn read(path: &Path) -> Result<Vec<u64>, Fault> {
    let failed = |error: std::io::Error| Fault::new(format!("failed to read {}", path.display())).because(error);
    let bytes = regular_file::read(path, MOST_BYTES).map_err(failed)?;
    let text = String::from_utf8_lossy(&bytes);
    let time = |(index, line): (usize, &str)| {
        time_ns(line).ok_or_else(|| {
            let line: String = line.chars().take(40).collect();
            Fault::new(format!("{}:{}: `{line}` is no time", path.display(), index + 1))
                .remedy("a line is `2011-09-26 13:02:44.317412775`; without the file frames come at 10 Hz")
        })
    };
    text.trim_end().lines().enumerate().map(time).collect()
}

/// 10 Hz without any times. A missing time is an error, because two clocks would mix.
pub(super) fn frame(id: &str, index: u64, line: Option<usize>, times: &[u64], clock: &Path) -> Result<Frame, Fault> {
    if times.is_empty() {
        return Ok(Frame::at_10_hz(id, index));
    }
    let time_ns = line.and_then(|line| times.get(line)).copied().ok_or_else(|| {
        Fault::new(format!("{} has {} times, and none of frame {id}", clock.display(), times.len()))
            .remedy("copy or unpack it again; without the file frames come at 10 Hz")
    })?;
    Ok(Frame { id: id.into(), index, time_ns })
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
