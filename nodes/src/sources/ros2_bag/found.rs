//! Which messages of a bag make a frame.

use std::collections::{BTreeMap, HashSet};

use depthloom_bags::pace::Pace;
use depthloom_bags::stamps::{Stamped, by_header, by_log, seconds};
use depthloom_bags::{Bag, Message, Topic, pairs};
use depthloom_graphs::Fault;
use depthloom_graphs::contracts::{Fact, Frame};

use crate::sources::ros2_bag::chosen::Chosen;
use crate::sources::ros2_bag::frame::Part;
use crate::sources::ros2_bag::params::{BagClock, Ros2BagParams};

/// Partners may be recorded this much outside the requested range.
const MARGIN_NS: u64 = 1_000_000_000;

pub(super) struct MatchedFrames {
    pub frames: Vec<Frame>,
    pub messages: Vec<Vec<(Part, Message)>>,
    pub warnings: Vec<String>,
    pub facts: Vec<Fact>,
}

impl MatchedFrames {
    pub(super) fn find(bag: &Bag, chosen: &Chosen<'_>, params: &Ros2BagParams) -> Result<Self, Fault> {
        let names: Vec<&Topic> = chosen.0.iter().map(|(_, topic, _)| *topic).collect();
        let mut all = bag.messages(&names)?;
        if let Some(empty) = all.iter().position(Vec::is_empty) {
            return Err(Fault::new(format!("{} has no message of {}", bag.path().display(), names[empty].name))
                .remedy("was the recorder stopped at once, or the bag cut off?"));
        }
        let range = Range::new(all[0][0].log_ns.min(all[1][0].log_ns), params);
        let last = all[0].last().map_or(0, |message| message.log_ns);
        for ((part, _, _), messages) in chosen.0.iter().zip(&mut all) {
            match part {
                Part::Left => messages.retain(|message| range.holds(message)),
                Part::LeftInfo | Part::RightInfo => {
                    // Camera infos may have been published once, long before.
                    let before = messages.partition_point(|message| message.log_ns < range.start_ns);
                    let last = messages[before.saturating_sub(1)];
                    messages.retain(|message| range.is_near(message));
                    if messages.is_empty() {
                        messages.push(last);
                    }
                }
                Part::Right | Part::Depth | Part::Points => messages.retain(|message| range.is_near(message)),
            }
        }
        let mut warnings = [bag.warnings(), bag.losses()].concat();
        if all[0].is_empty() {
            let length = seconds(last.saturating_sub(range.origin_ns));
            let what = format!("{} has no image of {} between start_s and end_s", bag.path().display(), names[0].name);
            return Err(
                Fault::new(what).remedy(format!("its last image was recorded {length} s after the first of all"))
            );
        }
        let stamped = stamp(bag, chosen, &all, &params.clock, &mut warnings)?;
        let times: Vec<Vec<u64>> =
            stamped.iter().map(|topic| topic.iter().map(|message| message.stamp_ns).collect()).collect();
        let tolerance_ns = (params.tolerance_ms * 1e6).round() as u64;
        let found = pairs::pairs(&times[0], &times[1], tolerance_ns);
        if found.is_empty() {
            return Err(nothing_near(bag, [names[0], names[1]], [&times[0], &times[1]], params));
        }
        let paired: HashSet<usize> = found.iter().map(|(_, right)| *right).collect();
        let in_range: Vec<bool> = stamped[1].iter().map(|right| range.holds(&right.message)).collect();
        let rights = in_range.iter().filter(|is_in| **is_in).count();
        let alone = in_range.iter().enumerate().filter(|(at, is_in)| **is_in && !paired.contains(at)).count();
        let lefts = times[0].len();
        if lefts > found.len() || alone > 0 {
            warnings.push(format!(
                "{} of {lefts} left images and {alone} of {rights} right ones have no partner within {} ms: they are left out",
                lefts - found.len(),
                params.tolerance_ms
            ));
        }
        let facts = facts(chosen, &times, &found, &params.clock, [lefts - found.len(), alone]);
        let ids: Vec<(u64, String)> = (0..).zip(found.iter().map(|(left, _)| times[0][*left].to_string())).collect();
        let known: Vec<(u64, &str)> = ids
            .iter()
            .filter(|(index, _)| index.is_multiple_of(params.every.max(1)))
            .map(|(index, id)| (*index, id.as_str()))
            .collect();
        let taken = params.frames.select(&known)?;
        warnings.extend(params.frames.left_out(&known));
        let mut without_truth = BTreeMap::new();
        let (mut frames, mut messages) = (Vec::with_capacity(taken.len()), Vec::with_capacity(taken.len()));
        for at in taken {
            let (index, id) = known[at];
            let (left, right) = found[usize::try_from(index).expect("it counts pairs")];
            let time_ns = times[0][left];
            frames.push(Frame { id: id.into(), index, time_ns });
            let mut of_frame = vec![(Part::Left, stamped[0][left].message), (Part::Right, stamped[1][right].message)];
            for part in [Part::LeftInfo, Part::RightInfo, Part::Depth, Part::Points] {
                let Some(which) = chosen.position(part) else { continue };
                let nearest = pairs::nearest(&times[which], time_ns);
                let is_near = |at: &usize| part.is_camera() || times[which][*at].abs_diff(time_ns) <= tolerance_ns;
                match nearest.filter(is_near) {
                    Some(at) => of_frame.push((part, stamped[which][at].message)),
                    None => *without_truth.entry(names[which].name.as_str()).or_insert(0_usize) += 1,
                }
            }
            messages.push(of_frame);
        }
        for (topic, count) in without_truth {
            let (all, within) = (frames.len(), params.tolerance_ms);
            warnings.push(format!(
                "{count} of {all} frames have no message of {topic} within {within} ms, and so no ground truth"
            ));
        }
        Ok(Self { frames, messages, warnings, facts })
    }
}

/// The messages of each topic with their times. Of several with one time the first recorded is used.
fn stamp(
    bag: &Bag,
    chosen: &Chosen<'_>,
    messages: &[Vec<Message>],
    clock: &BagClock,
    warnings: &mut Vec<String>,
) -> Result<Vec<Vec<Stamped>>, Fault> {
    let mut stamped = Vec::with_capacity(messages.len());
    for ((part, topic, form), messages) in chosen.0.iter().zip(messages) {
        let (times, repeated) = match clock {
            BagClock::Header => by_header(bag, topic, *form, messages)?,
            BagClock::Log => by_log(messages),
        };
        let name = &topic.name;
        if repeated > 0 {
            let what = "repeat the time of another: the one recorded first is taken";
            warnings.push(format!("{repeated} messages of {name} {what}"));
        }
        let is_unset = times.first().is_some_and(|first| first.stamp_ns == 0) && times.len() + repeated > 1;
        if is_unset && !part.is_camera() {
            let what = format!("{}: messages of {name} have no time in their headers (0)", bag.path().display());
            return Err(Fault::new(what).remedy("use `clock: log`, the time when they were recorded"));
        }
        stamped.push(times);
    }
    Ok(stamped)
}

fn facts(
    chosen: &Chosen<'_>,
    times: &[Vec<u64>],
    found: &[(usize, usize)],
    clock: &BagClock,
    [left_alone, right_alone]: [usize; 2],
) -> Vec<Fact> {
    let by = match clock {
        BagClock::Header => "by the stamps in their headers",
        BagClock::Log => "by the time of recording",
    };
    let ticks = |at: usize, label: &'static str| {
        let text = format!("{}: {}, {by}", chosen.0[at].1.name, Pace::from_times(&times[at]));
        Fact { label, text }
    };
    let mut apart: Vec<u64> = found.iter().map(|(left, right)| times[0][*left].abs_diff(times[1][*right])).collect();
    apart.sort_unstable();
    let ms = |ns: Option<&u64>| ns.map_or(0.0, |ns| *ns as f64 / 1e6);
    let text = format!(
        "{}, {:.3} ms apart by median and {:.3} ms at most; {left_alone} left and {right_alone} right images have no partner",
        found.len(),
        ms(apart.get(apart.len() / 2)),
        ms(apart.last()),
    );
    vec![ticks(0, "left"), ticks(1, "right"), Fact { label: "pairs", text }]
}

fn nothing_near(bag: &Bag, [left, right]: [&Topic; 2], [lefts, rights]: [&[u64]; 2], params: &Ros2BagParams) -> Fault {
    let what = format!(
        "{}: no image of {} has one of {} within {} ms",
        bag.path().display(),
        left.name,
        right.name,
        params.tolerance_ms
    );
    let apart = lefts.iter().filter_map(|time| Some(rights[pairs::nearest(rights, *time)?].abs_diff(*time))).min();
    let remedy = match apart {
        Some(ns) if ns < 1_000_000_000 => {
            format!(
                "the nearest two are {:.3} ms apart; increase `tolerance_ms` if the scene does not move",
                ns as f64 / 1e6
            )
        }
        Some(ns) => format!(
            "the nearest two are {} s apart: check that both cameras use one clock, or use `clock: log`, the time of recording",
            seconds(ns)
        ),
        None => "there is no image of the right camera in the range".to_owned(),
    };
    Fault::new(what).remedy(remedy)
}

struct Range {
    origin_ns: u64,
    start_ns: u64,
    end_ns: u64,
}

impl Range {
    fn new(origin_ns: u64, params: &Ros2BagParams) -> Self {
        let after = |s: f64| origin_ns.saturating_add((s * 1e9) as u64);
        Self { origin_ns, start_ns: after(params.start_s), end_ns: params.end_s.map_or(u64::MAX, after) }
    }

    fn holds(&self, message: &Message) -> bool {
        (self.start_ns..self.end_ns).contains(&message.log_ns)
            || self.end_ns == u64::MAX && message.log_ns >= self.start_ns
    }

    fn is_near(&self, message: &Message) -> bool {
        let (from, to) = (self.start_ns.saturating_sub(MARGIN_NS), self.end_ns.saturating_add(MARGIN_NS));
        (from..=to).contains(&message.log_ns)
    }
}
