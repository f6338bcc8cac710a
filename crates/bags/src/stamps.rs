//! Capture times of messages, from their headers.

use depthloom_graphs::Fault;

use crate::form::{HEAD, stamp_of};
use crate::message_fault::message_fault;
use crate::{Bag, Form, Message, Topic};

/// A message with the time that it is known by.
#[derive(Clone, Copy, Debug)]
pub struct Stamped {
    /// Nanoseconds since 1970.
    pub stamp_ns: u64,
    /// Where it is stored.
    pub message: Message,
}

/// Messages by the time of their headers, of one time the one recorded first; and how many repeat another's time, which
/// are left out.
///
/// Only their first bytes are read; of MCAP's compressed chunks all before them is decompressed, on all cores.
pub fn by_header(bag: &Bag, topic: &Topic, form: Form, messages: &[Message]) -> Result<(Vec<Stamped>, usize), Fault> {
    let mut stamped = Vec::with_capacity(messages.len());
    for (message, head) in messages.iter().zip(bag.heads(messages, HEAD)?) {
        let stamp = |bytes: &[u8], is_whole| {
            stamp_of(form.wire, bytes, is_whole).map_err(|error| {
                message_fault(error, bag.path(), &topic.name, &format!("recorded at {}", seconds(message.log_ns)))
            })
        };
        let known = match &head {
            Some(head) => stamp(head, head.len() < HEAD)?,
            None => None,
        };
        let stamp_ns = match known {
            Some(stamp_ns) => stamp_ns,
            None => stamp(&bag.read(message)?, true)?.unwrap_or(0),
        };
        stamped.push(Stamped { stamp_ns, message: *message });
    }
    Ok(in_order(stamped))
}

/// Messages by the time of recording, otherwise as [`by_header`]. Nothing of them is read.
#[must_use]
pub fn by_log(messages: &[Message]) -> (Vec<Stamped>, usize) {
    in_order(messages.iter().map(|message| Stamped { stamp_ns: message.log_ns, message: *message }).collect())
}

fn in_order(mut stamped: Vec<Stamped>) -> (Vec<Stamped>, usize) {
    stamped.sort_by_key(|of| of.stamp_ns);
    let before = stamped.len();
    stamped.dedup_by_key(|of| of.stamp_ns);
    let twice = before - stamped.len();
    (stamped, twice)
}

/// A time as people write it: seconds and nine digits.
#[must_use]
pub fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}
