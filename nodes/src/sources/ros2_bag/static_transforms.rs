//! The static transforms of a bag.

use depthloom_bags::stamps::seconds;
use depthloom_bags::transforms::Transforms;
use depthloom_bags::{Bag, Form};
use depthloom_graphs::Fault;

use crate::sources::dataset::folders::at_file;

const TF_STATIC: &str = "/tf_static";

const MOST_TRANSFORMS: usize = 100_000;

pub(super) fn read(bag: &Bag) -> Result<Transforms, Fault> {
    let mut transforms = Transforms::default();
    let Ok(topic) = bag.topic(TF_STATIC) else { return Ok(transforms) };
    let form = Form::from_topic(topic).map_err(|fault| at_file(bag.path(), fault))?;
    let messages = bag.messages(&[topic])?.remove(0);
    if messages.len() > MOST_TRANSFORMS {
        let (path, count) = (bag.path().display(), messages.len());
        let what = format!("{path} has {count} messages of {TF_STATIC}, and static transforms are few");
        return Err(Fault::new(what)
            .remedy("what moves belongs on /tf, and is not read: record /tf_static latched, each transform once"));
    }
    for message in &messages {
        let added = transforms.add(form, &bag.read(message)?);
        let place = format!("recorded at {}", seconds(message.log_ns));
        added.map_err(|error| depthloom_bags::message_fault(error, bag.path(), TF_STATIC, &place))?;
    }
    Ok(transforms)
}
