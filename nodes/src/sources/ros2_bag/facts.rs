//! What there is to show of a bag: its topics and how evenly their messages come.

use depthloom_bags::pace::Pace;
use depthloom_bags::{Bag, Topic};
use depthloom_graphs::contracts::Fact;

const MOST: usize = 60;

pub(super) fn topics(bag: &Bag) -> Vec<Fact> {
    let topics: Vec<&Topic> = bag.topics().iter().take(MOST).collect();
    // Opening reports a damaged index.
    let messages = bag.messages(&topics).ok();
    let line = |(at, topic): (usize, &&Topic)| {
        let pace = messages.as_ref().map(|messages| {
            let times: Vec<u64> = messages[at].iter().map(|message| message.log_ns).collect();
            format!(", {}", Pace::from_times(&times))
        });
        Fact { label: "topic", text: format!("{}: {}{}", topic.name, topic.message_type, pace.unwrap_or_default()) }
    };
    let mut facts: Vec<Fact> = topics.iter().enumerate().map(line).collect();
    if bag.topics().len() > MOST {
        facts.push(Fact { label: "topic", text: format!("and {} more", bag.topics().len() - MOST) });
    }
    facts
}
