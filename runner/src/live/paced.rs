//! A seekable source at the rate of a camera.

use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{
    Context, Fault, Frame, InlineHost, NextFrame, Scratch, StreamFrame, StreamingSource,
};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Key, Outputs, Source, SourceOutputs, counted};

use crate::interrupt::Interrupt;

/// When frames are due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// This number of frames per second.
    Rate(f64),
    /// At their time stamps, counted from the first frame.
    TimeStamps,
}

/// How a seekable source is played.
#[derive(Clone, Debug)]
pub struct Playback {
    /// When frames are due.
    pub pace: Pace,
    /// How many frames are read into memory before the first one is due, so that reading them takes no time later.
    pub preload: usize,
    /// Whether the frames are repeated when all were played. Repeated frames get new ids and indices.
    pub repeat: bool,
    /// Whether a frame that is read too late is played late, instead of being skipped.
    pub no_drop: bool,
    /// Outputs that are left out, such as ground truth, which a camera does not have.
    pub hidden: Vec<&'static str>,
}

/// A longer gap between time stamps is not waited for.
const LONGEST_GAP: Duration = Duration::from_secs(60);

/// A seekable source as a stream. Each frame is read before it is due. A frame that is still being read when the next
/// one is due is late; frames that are due meanwhile are lost by the source.
pub struct Paced {
    source: Box<dyn Source>,
    playback: Playback,
    /// By frame, when it is due after the first one.
    due: Vec<Duration>,
    /// From the first frame of a pass to that of the next, as played; and by the clock of the source, nanoseconds.
    pass: Duration,
    pass_ns: u64,
    /// `None` for a frame that cannot be read.
    loaded: Vec<Option<SourceOutputs>>,
    start: Option<Instant>,
    /// The number of the next frame, over all passes.
    next: usize,
    ready: Option<(Frame, SourceOutputs)>,
    missed: u64,
    /// Frames in succession that could not be read.
    failed: usize,
    warnings: Vec<String>,
    scratch: Scratch,
}

impl Paced {
    /// Plays a source. Reads the frames to preload, unless it is interrupted.
    ///
    /// # Errors
    /// If it is interrupted, or the source has no frame.
    pub fn new(source: Box<dyn Source>, playback: Playback, interrupt: &Interrupt) -> Result<Self, Fault> {
        let frames = source.frames();
        if frames.is_empty() {
            return Err(Fault::new("the source has no frames"));
        }
        let (due, gaps) = due_times(frames, playback.pace);
        let stamps = frames.iter().map(|frame| frame.time_ns);
        let span_ns = stamps.clone().max().unwrap_or(0) - stamps.min().unwrap_or(0);
        let gap_ns = span_ns.checked_div(frames.len() as u64 - 1).unwrap_or(100_000_000);
        let pass_ns = span_ns.saturating_add(gap_ns);
        let pass = match playback.pace {
            Pace::Rate(rate) => seconds(frames.len() as f64 / rate),
            Pace::TimeStamps => due[due.len() - 1] + Duration::from_nanos(gap_ns),
        };
        let warnings = (gaps > 0).then(|| {
            let gaps = counted(gaps, "gap");
            format!("{gaps} between time stamps of more than 60 s: the frames after them are played at once")
        });
        let mut paced = Self {
            source,
            playback,
            due,
            pass,
            pass_ns,
            loaded: Vec::new(),
            start: None,
            next: 0,
            ready: None,
            missed: 0,
            failed: 0,
            warnings: warnings.into_iter().collect(),
            scratch: Scratch::default(),
        };
        for position in 0..paced.playback.preload.min(paced.source.frames().len()) {
            if interrupt.stops_admission() {
                return Err(Fault::Cancelled);
            }
            // A frame that cannot be read is reported when it is due.
            let read = paced.read(position).ok();
            paced.loaded.push(read);
        }
        Ok(paced)
    }

    fn read(&mut self, position: usize) -> Result<SourceOutputs, Fault> {
        if let Some(Some(read)) = self.loaded.get(position) {
            return Ok(read.clone());
        }
        let SourceOutputs { outputs, key } =
            self.source.read(FrameIndex(position), &mut Context::new(&InlineHost, &mut self.scratch))?;
        let (mut shown, mut hidden) = (Outputs::none(), Vec::new());
        for (port, value) in outputs.entries() {
            if self.playback.hidden.contains(&port) {
                hidden.push(port);
            } else {
                shown = shown.with(port, value.clone());
            }
        }
        // Under the key of the complete frame, other runs would find that it has no ground truth.
        let key = if hidden.is_empty() {
            key
        } else {
            hidden.iter().fold(Key::build("frame without").key(&key), |key, port| key.text(port)).finish()
        };
        Ok(SourceOutputs { outputs: shown, key })
    }

    /// Of the frames that are due by now, a camera would have the last one. Frames that are due at the same time are
    /// all played.
    fn skip_late_frames(&mut self) {
        let Some(start) = self.start.filter(|_| !self.playback.no_drop) else { return };
        let now = Instant::now();
        while self.has(self.next + 1)
            && start + self.due(self.next + 1) <= now
            && self.due(self.next + 1) > self.due(self.next)
        {
            (self.next, self.missed) = (self.next + 1, self.missed + 1);
        }
    }

    /// Reads the next frame that can be read; `None` if there are no more. The others are reported, and count as lost
    /// by the source.
    fn read_next(&mut self) -> Result<Option<(Frame, SourceOutputs)>, Fault> {
        while self.has(self.next) {
            let frame = self.frame(self.next);
            match self.read(self.next % self.count()) {
                Ok(read) => {
                    self.failed = 0;
                    return Ok(Some((frame, read)));
                }
                Err(fault) => {
                    self.failed += 1;
                    if self.failed >= self.count() {
                        return Err(fault);
                    }
                    self.warnings.push(format!("frame {} cannot be read: {}", frame.id, fault.chain()));
                    (self.next, self.missed) = (self.next + 1, self.missed + 1);
                }
            }
        }
        Ok(None)
    }

    /// Whether there is a frame of that number.
    fn has(&self, number: usize) -> bool {
        self.playback.repeat || number < self.count()
    }

    fn count(&self) -> usize {
        self.source.frames().len()
    }

    fn due(&self, number: usize) -> Duration {
        let passes = u32::try_from(number / self.count()).unwrap_or(u32::MAX);
        self.pass.saturating_mul(passes) + self.due[number % self.count()]
    }

    /// The frame of that number: in later passes with another id and index.
    fn frame(&self, number: usize) -> Frame {
        let frames = self.source.frames();
        let frame = &frames[number % self.count()];
        let pass = (number / self.count()) as u64;
        if pass == 0 {
            return frame.clone();
        }
        let span = frames.iter().map(|frame| frame.index.saturating_add(1)).max().unwrap_or(0);
        Frame {
            id: format!("{}+{pass}", frame.id).into(),
            index: frame.index.saturating_add(span.saturating_mul(pass)),
            time_ns: frame.time_ns.saturating_add(self.pass_ns.saturating_mul(pass)),
        }
    }
}

impl StreamingSource for Paced {
    fn next(&mut self, deadline: Instant) -> Result<NextFrame, Fault> {
        let (frame, read) = match self.ready.take() {
            Some(ready) => ready,
            None => {
                self.skip_late_frames();
                match self.read_next()? {
                    Some(ready) => ready,
                    None => return Ok(NextFrame::Ended),
                }
            }
        };
        let start = *self.start.get_or_insert_with(Instant::now);
        let due = start + self.due(self.next);
        let now = Instant::now();
        if due > now {
            if due > deadline {
                self.ready = Some((frame, read));
                std::thread::sleep(deadline.saturating_duration_since(now));
                return Ok(NextFrame::TimedOut);
            }
            std::thread::sleep(due - now);
        }
        let captured = Instant::now();
        self.next += 1;
        if self.playback.no_drop {
            // Later frames keep their distance to this one.
            self.start = Some(start + captured.saturating_duration_since(due));
        }
        let missed = std::mem::take(&mut self.missed);
        Ok(NextFrame::Captured(Box::new(StreamFrame { frame, read, captured, missed })))
    }

    fn skip_to_now(&mut self) {
        // The frames themselves wait: only the clock of the playback goes on.
        self.start = Instant::now().checked_sub(self.due(self.next));
    }

    fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }
}

/// By frame, when it is due after the first one; and the number of gaps that are too long.
fn due_times(frames: &[Frame], pace: Pace) -> (Vec<Duration>, u64) {
    match pace {
        Pace::Rate(rate) => ((0..frames.len()).map(|k| seconds(k as f64 / rate)).collect(), 0),
        Pace::TimeStamps => {
            let (mut due, mut gaps) = (vec![Duration::ZERO], 0);
            for pair in frames.windows(2) {
                // A time stamp that precedes the one before is reported by the run.
                let gap = Duration::from_nanos(pair[1].time_ns.saturating_sub(pair[0].time_ns));
                gaps += u64::from(gap > LONGEST_GAP);
                due.push(due[due.len() - 1] + if gap > LONGEST_GAP { Duration::ZERO } else { gap });
            }
            (due, gaps)
        }
    }
}

fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use depthloom_graphs::contracts::{Context, Fault, Frame, NextFrame, StreamingSource};
    use depthloom_graphs::plan::FrameIndex;
    use depthloom_graphs::{Key, Outputs, Source, SourceOutputs};

    use super::{Pace, Paced, Playback, due_times};
    use crate::interrupt::Interrupt;

    struct Slow {
        frames: Vec<Frame>,
        read_ms: u64,
    }

    impl Source for Slow {
        fn frames(&self) -> &[Frame] {
            &self.frames
        }
        fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
            Ok(Key::of_content(&position.0.to_le_bytes()))
        }
        fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
            std::thread::sleep(Duration::from_millis(self.read_ms));
            Ok(SourceOutputs { outputs: Outputs::none(), key: self.key(position)? })
        }
    }

    fn play(frames: u64, read_ms: u64, playback: Playback) -> (Vec<(u64, u64)>, Duration) {
        let frames = (0..frames).map(|k| Frame::at_10_hz(k.to_string(), k)).collect();
        let mut paced =
            Paced::new(Box::new(Slow { frames, read_ms }), playback, &Interrupt::default()).expect("it has frames");
        let (started, mut played) = (Instant::now(), Vec::new());
        loop {
            match paced.next(Instant::now() + Duration::from_millis(5)).expect("it can be read") {
                NextFrame::Captured(captured) => played.push((captured.frame.index, captured.missed)),
                NextFrame::TimedOut => {}
                NextFrame::Ended => return (played, started.elapsed()),
            }
            if played.len() == 8 {
                return (played, started.elapsed());
            }
        }
    }

    fn playback(pace: Pace) -> Playback {
        Playback { pace, preload: 0, repeat: false, no_drop: false, hidden: Vec::new() }
    }

    #[test]
    fn frames_are_played_when_they_are_due() {
        let no_drop = |pace| Playback { no_drop: true, ..playback(pace) };
        let (played, took) = play(5, 0, no_drop(Pace::Rate(100.0)));
        assert_eq!(played, (0..5).map(|k| (k, 0)).collect::<Vec<_>>());
        assert!(took >= Duration::from_millis(40), "{took:?}");
        let (played, took) = play(2, 0, no_drop(Pace::TimeStamps));
        assert_eq!(played.len(), 2);
        assert!(took >= Duration::from_millis(100), "{took:?}");
    }

    #[test]
    fn a_slow_source_loses_frames_unless_none_may_be_dropped() {
        let (played, _) = play(40, 30, playback(Pace::Rate(100.0)));
        assert!(played.iter().any(|(_, missed)| *missed > 0), "{played:?}");
        for pair in played.windows(2) {
            assert_eq!(pair[1].0, pair[0].0 + 1 + pair[1].1, "{played:?}");
        }
        let (played, _) = play(4, 30, Playback { no_drop: true, ..playback(Pace::Rate(100.0)) });
        assert_eq!(played, (0..4).map(|k| (k, 0)).collect::<Vec<_>>());
    }

    #[test]
    fn frames_with_equal_time_stamps_are_all_played() {
        let frames = (0..6).map(|k| Frame { id: k.to_string().into(), index: k, time_ns: 0 }).collect();
        let source = Box::new(Slow { frames, read_ms: 5 });
        let mut paced = Paced::new(source, playback(Pace::TimeStamps), &Interrupt::default()).expect("it has frames");
        let mut played = Vec::new();
        while let NextFrame::Captured(captured) = paced.next(Instant::now()).expect("it can be read") {
            played.push((captured.frame.index, captured.missed));
        }
        assert_eq!(played, (0..6).map(|k| (k, 0)).collect::<Vec<_>>());
    }

    /// Frames of which every second one is damaged, or all.
    struct Damaged(Slow, bool);

    impl Source for Damaged {
        fn frames(&self) -> &[Frame] {
            self.0.frames()
        }
        fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
            self.0.key(position)
        }
        fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
            let is_damaged = self.1 || position.0 % 2 == 1;
            if is_damaged { Err(Fault::new("the file is truncated")) } else { self.0.read(position, ctx) }
        }
    }

    #[test]
    fn a_frame_that_cannot_be_read_is_reported_and_lost() {
        let source = |all| {
            let frames = (0..5).map(|k| Frame::at_10_hz(k.to_string(), k)).collect();
            Box::new(Damaged(Slow { frames, read_ms: 0 }, all))
        };
        let preload = Playback { preload: 5, no_drop: true, ..playback(Pace::Rate(1000.0)) };
        let mut paced = Paced::new(source(false), preload.clone(), &Interrupt::default()).expect("it has frames");
        let later = || Instant::now() + Duration::from_secs(1);
        let mut played = Vec::new();
        while let NextFrame::Captured(captured) = paced.next(later()).expect("some can be read") {
            played.push((captured.frame.index, captured.missed));
        }
        assert_eq!(played, [(0, 0), (2, 1), (4, 1)]);
        assert_eq!(paced.take_warnings()[0], "frame 1 cannot be read: the file is truncated");
        let mut paced = Paced::new(source(true), preload, &Interrupt::default()).expect("it has frames");
        assert!(paced.next(later()).is_err());
        let interrupt = Interrupt::default();
        interrupt.raise();
        let preload = Playback { preload: 1, ..playback(Pace::TimeStamps) };
        assert!(matches!(Paced::new(source(false), preload, &interrupt), Err(Fault::Cancelled)));
    }

    #[test]
    fn repeated_frames_have_new_indices() {
        let (played, _) = play(3, 0, Playback { repeat: true, no_drop: true, ..playback(Pace::Rate(1000.0)) });
        assert_eq!(played.iter().map(|(index, _)| *index).collect::<Vec<_>>(), (0..8).collect::<Vec<_>>());
        let frames = (0..3).map(|k| Frame::at_10_hz(k.to_string(), k)).collect();
        let source = Box::new(Slow { frames, read_ms: 0 });
        let playback = Playback { repeat: true, ..playback(Pace::TimeStamps) };
        let paced = Paced::new(source, playback, &Interrupt::default()).expect("it has frames");
        let last = paced.frame(7);
        assert_eq!((&*last.id, last.index, last.time_ns), ("1+2", 7, 700_000_000));
        assert_eq!(paced.due(7), Duration::from_millis(700));
    }

    #[test]
    fn a_clock_that_jumps_does_not_stop_the_stream() {
        let at = |ms: u64| Frame { id: "a".into(), index: 0, time_ns: ms * 1_000_000 };
        let (due, gaps) = due_times(&[at(0), at(10), at(5), at(4_000_000), at(4_000_010)], Pace::TimeStamps);
        assert_eq!(due, [0, 10, 10, 10, 20].map(Duration::from_millis));
        assert_eq!(gaps, 1);
    }
}
