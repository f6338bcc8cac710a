//! The thread that captures frames.

use std::time::{Duration, Instant};

use depthloom_graphs::contracts::{Fault, NextFrame, StreamingSource};
use depthloom_threads::caught;

use super::LiveOptions;
use super::mailbox::Mailbox;
use crate::interrupt::Interrupt;

/// The longest wait before the thread looks whether it has to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// Captures frames into the mailbox until the stream or its duration ends, or the run ends.
pub(crate) fn capture(
    stream: &mut dyn StreamingSource,
    mailbox: &Mailbox,
    options: &LiveOptions,
    interrupt: &Interrupt,
) {
    let (mut ends, mut is_first) = (None, true);
    let stops = || mailbox.is_closed() || interrupt.stops_admission();
    let fault = loop {
        if stops() || ends.is_some_and(|ends| Instant::now() >= ends) {
            break None;
        }
        let patience = Instant::now() + PATIENCE;
        let next = caught(|| stream.next(ends.map_or(patience, |ends: Instant| ends.min(patience))));
        mailbox.warn(stream.take_warnings());
        match next {
            Ok(Ok(NextFrame::Captured(frame))) => {
                mailbox.put(frame);
                if std::mem::take(&mut is_first) {
                    mailbox.wait_until_warm(stops);
                    stream.skip_to_now();
                    // Programs, devices and networks take a while to start.
                    ends = options.duration.and_then(|duration| Instant::now().checked_add(duration));
                } else if options.no_drop {
                    mailbox.wait_until_taken(stops);
                }
            }
            Ok(Ok(NextFrame::TimedOut)) => {}
            Ok(Ok(NextFrame::Ended)) => break None,
            Ok(Err(fault)) => break Some(fault),
            Err(panic) => break Some(Fault::new(format!("panicked: {}", panic.0))),
        }
    };
    mailbox.end(fault);
}
