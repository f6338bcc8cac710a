//! ROS 2 bags and other MCAP files: their messages by topic, and the content of messages of cameras, scanners and
//! transforms.
//!
//! A [`Bag`] is one file or several, in MCAP or in rosbag2's SQLite storage. Opening it reads its index,
//! [`Bag::messages`] lists what a topic holds, and any thread reads any message at any time. The content of a message
//! is decoded by [`images`], [`camera`], [`points`] and [`transforms`], out of CDR or protobuf bytes that may be
//! anything: every length is checked before anything is allocated.
//!
//! ```no_run
//! use depthloom_bags::{Bag, Form};
//!
//! let bag = Bag::open("drive".as_ref())?;
//! let topic = bag.topic("/stereo/left/image_rect")?;
//! let form = Form::from_topic(topic)?;
//! for message in bag.messages(&[topic])?.remove(0) {
//!     let bytes = bag.read(&message)?;
//!     let image = depthloom_bags::images::image(form, &bytes)?;
//!     println!("{} {}", image.header.stamp_ns, image.header.frame_id);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]
#![expect(clippy::missing_errors_doc, reason = "an error states the fault of the bag or the message, and the remedy")]
#![expect(clippy::missing_panics_doc, reason = "rows are compared with the size before")]

mod bag;
pub mod camera;
mod cdr;
mod form;
pub mod images;
mod message_fault;
mod metadata;
mod mosaic;
pub mod pace;
pub mod pairs;
pub mod points;
pub mod stamps;
mod storage;
pub mod topics;
pub mod transforms;
mod yuv;

pub use bag::{Bag, Topic};
pub use form::{Form, Header, Sort};
pub use message_fault::message_fault;
pub use storage::mcap_file::written_by;
pub use storage::message::Message;

/// The most bytes of a message, compressed or not: 8192 x 8192 of 16-bit RGB are 384 MiB.
pub const MOST_BYTES: u64 = 512 << 20;
