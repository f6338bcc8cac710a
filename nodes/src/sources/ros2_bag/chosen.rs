//! Which topics of a bag frames are made of.

use depthloom_bags::{Bag, Form, Sort, Topic, topics};
use depthloom_graphs::Fault;

use crate::sources::dataset::folders::at_file;
use crate::sources::ros2_bag::frame::Part;
use crate::sources::ros2_bag::params::Ros2BagParams;

pub(super) struct Chosen<'a>(pub Vec<(Part, &'a Topic, Form)>);

impl<'a> Chosen<'a> {
    pub(super) fn select(bag: &'a Bag, params: &Ros2BagParams) -> Result<Self, Fault> {
        let (left, right) = pair(bag, params)?;
        let camera = |named: &Option<String>, image: &Topic, parameter: &str| match named {
            Some(name) => bag.topic(name),
            None => topics::camera_of(bag, image).ok_or_else(|| {
                let there = bag.there_are(|topic| Form::sort_of(topic) == Some(Sort::CameraInfo));
                Fault::new(format!("{} has no camera_info beside {}", bag.path().display(), image.name))
                    .remedy(format!("name its topic with `{parameter}`: of cameras {there}"))
            }),
        };
        let mut chosen = vec![
            (Part::Left, left),
            (Part::Right, right),
            (Part::LeftInfo, camera(&params.left_info, left, "left_info")?),
        ];
        match camera(&params.right_info, right, "right_info") {
            Ok(info) => chosen.push((Part::RightInfo, info)),
            // With `baseline_m`, the info of the left camera describes a rectified pair completely.
            Err(_) if params.baseline_m.is_some() && params.right_info.is_none() => {}
            Err(fault) => return Err(fault),
        }
        for (part, named) in [(Part::Depth, &params.depth), (Part::Points, &params.points)] {
            if let Some(name) = named {
                chosen.push((part, bag.topic(name)?));
            }
        }
        let with_form = |(part, topic): (Part, &'a Topic)| {
            let form = Form::from_topic(topic).map_err(|fault| at_file(bag.path(), fault))?;
            match part.fits(form.sort) {
                true => Ok((part, topic, form)),
                false => {
                    let there = bag.there_are(|topic| Form::sort_of(topic).is_some_and(|sort| part.fits(sort)));
                    let what = format!(
                        "{}: {} has messages {}: `{}` takes {}",
                        bag.path().display(),
                        topic.name,
                        topic.message_type,
                        part.parameter(),
                        part.wanted()
                    );
                    Err(Fault::new(what).remedy(there))
                }
            }
        };
        chosen.into_iter().map(with_form).collect::<Result<_, _>>().map(Self)
    }

    pub(super) fn beside(&self, bag: &Bag) -> [Option<String>; 2] {
        [Part::Left, Part::Right].map(|part| {
            let image = self.0[self.position(part)?].1;
            topics::camera_of(bag, image).map(|topic| topic.name.clone())
        })
    }

    pub(super) fn position(&self, part: Part) -> Option<usize> {
        self.0.iter().position(|(other, ..)| *other == part)
    }
}

fn pair<'a>(bag: &'a Bag, params: &Ros2BagParams) -> Result<(&'a Topic, &'a Topic), Fault> {
    let images = || bag.there_are(|topic| Form::sort_of(topic).is_some_and(Sort::is_image));
    let no_partner = |topic: &Topic, parameter: &str| {
        Fault::new(format!("{} has no topic that is the other camera's of {}", bag.path().display(), topic.name))
            .remedy(format!("name it with `{parameter}`: of images {}", images()))
    };
    match (&params.left, &params.right) {
        (Some(left), Some(right)) => Ok((bag.topic(left)?, bag.topic(right)?)),
        (Some(left), None) => {
            let left = bag.topic(left)?;
            topics::right_of(bag, left).map(|right| (left, right)).ok_or_else(|| no_partner(left, "right"))
        }
        (None, Some(right)) => {
            let right = bag.topic(right)?;
            topics::left_of(bag, right).map(|left| (left, right)).ok_or_else(|| no_partner(right, "left"))
        }
        (None, None) => match topics::stereo_pairs(bag).as_slice() {
            [pair] => Ok(*pair),
            [] => Err(Fault::new(format!("{} has no pair of image topics named left and right", bag.path().display()))
                .remedy(format!("name them with `left` and `right`: of images {}", images()))),
            several => {
                let named: Vec<String> =
                    several.iter().map(|(left, right)| format!("{} and {}", left.name, right.name)).collect();
                Err(Fault::new(format!("{} has {} stereo pairs", bag.path().display(), several.len()))
                    .remedy(format!("select one with `left` and `right`: {}", named.join("; "))))
            }
        },
    }
}
