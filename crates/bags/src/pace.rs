//! How evenly the messages of a topic come.

/// In a gap longer than this many usual ones messages are missing.
const LONG: f64 = 1.5;

/// If gaps differ by more than this share of the usual one, the sender has no fixed rate, and missing messages cannot
/// be counted.
const EVEN: f64 = 0.5;

/// How evenly messages come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// How many there are.
    pub messages: usize,
    /// From the first to the last, seconds.
    pub seconds: f64,
    /// `None` of fewer than three messages, or of messages without a fixed rate.
    pub steps: Option<Steps>,
}

/// The step in which messages come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// The usual gap, seconds: the median.
    pub seconds: f64,
    /// How far from the usual nine of ten gaps are, seconds; without those in which messages are missing.
    pub jitter_s: f64,
    /// How many messages are missing, by the length of the gaps.
    pub missing: u64,
}

impl Pace {
    /// Of ascending times, nanoseconds.
    #[must_use]
    pub fn from_times(times: &[u64]) -> Self {
        let seconds = match times {
            [first, .., last] => last.saturating_sub(*first) as f64 / 1e9,
            _ => 0.0,
        };
        let gaps: Vec<f64> = times.windows(2).map(|two| two[1].saturating_sub(two[0]) as f64 / 1e9).collect();
        Self { messages: times.len(), seconds, steps: steps(gaps) }
    }
}

fn steps(mut gaps: Vec<f64>) -> Option<Steps> {
    if gaps.len() < 2 {
        return None;
    }
    gaps.sort_unstable_by(f64::total_cmp);
    let usual = gaps[(gaps.len() - 1) / 2];
    if usual <= 0.0 {
        return None;
    }
    let mut off: Vec<f64> = gaps.iter().filter(|gap| **gap < LONG * usual).map(|gap| (gap - usual).abs()).collect();
    off.sort_unstable_by(f64::total_cmp);
    let jitter_s = off[(off.len() * 9 / 10).min(off.len() - 1)];
    let missing: f64 = gaps.iter().filter(|gap| **gap >= LONG * usual).map(|gap| (gap / usual).round() - 1.0).sum();
    // What comes in bursts would lack more than there is.
    let is_even = jitter_s <= EVEN * usual && missing <= gaps.len() as f64;
    is_even.then_some(Steps { seconds: usual, jitter_s, missing: missing as u64 })
}

impl std::fmt::Display for Pace {
    /// `60 messages, 29.98 Hz, jitter 0.4 ms, 3 missing`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.messages {
            0 => return f.write_str("no message"),
            1 => return f.write_str("1 message"),
            count => write!(f, "{count} messages")?,
        }
        match self.steps {
            Some(Steps { seconds, jitter_s, missing }) => {
                write!(f, ", {:.2} Hz, jitter {:.1} ms", 1.0 / seconds, jitter_s * 1e3)?;
                match missing {
                    0 => Ok(()),
                    missing => write!(f, ", {missing} missing"),
                }
            }
            None => write!(f, " in {:.1} s", self.seconds),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Pace;

    fn text_of(times_ms: &[u64]) -> String {
        Pace::from_times(&times_ms.iter().map(|ms| ms * 1_000_000).collect::<Vec<_>>()).to_string()
    }

    #[test]
    fn dropped_frames_of_a_camera_are_reported() {
        assert_eq!(text_of(&[]), "no message");
        assert_eq!(text_of(&[5]), "1 message");
        assert_eq!(text_of(&[5, 105]), "2 messages in 0.1 s");
        assert_eq!(text_of(&[0, 100, 200, 300]), "4 messages, 10.00 Hz, jitter 0.0 ms");
        // 300 and 400, and 700, were never recorded.
        assert_eq!(text_of(&[0, 100, 200, 500, 602, 800, 900]), "7 messages, 10.00 Hz, jitter 2.0 ms, 3 missing");
    }

    #[test]
    fn irregular_times_have_no_rate() {
        assert_eq!(text_of(&[0, 0, 0, 0]), "4 messages in 0.0 s");
        assert_eq!(text_of(&[0, 10, 200, 210, 1000, 1010, 1020, 1400]), "8 messages in 1.4 s");
    }
}
