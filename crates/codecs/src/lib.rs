//! Values as protobuf messages and back, and as the [`files`] of other programs: bytes, no file.
//!
//! A recording is one consumer; a live view, a process and a bridge encode values as a recording does: `foxglove.*`
//! messages that any viewer of these reads, and depthloom's own for maps of floats, scores, learning curves and
//! commits.
//!
//! ```
//! use depthloom_codecs::{decode, encode};
//! use depthloom_graphs::values::{Depth, Raster};
//! use depthloom_graphs::{Value, ValueType};
//!
//! let value = Value::from(Depth { metres: Raster::from_raw(2, 1, vec![3.5, f32::NAN]).unwrap() });
//! let mut message = Vec::new();
//! let stamp = encode::Stamp { time_ns: 100_000_000, frame_id: "left" };
//! let schema = encode::put(&mut message, stamp, &value).unwrap();
//! assert_eq!(schema.name(), "depthloom.FloatMap");
//! let Ok(Value::Depth(depth)) = decode::value(schema, ValueType::Depth, &message) else { panic!() };
//! assert_eq!(depth.metres[(0, 0)].0, [3.5]);
//! ```

#![expect(clippy::missing_errors_doc, reason = "an error is a lower-case fragment that states the fault")]

pub mod arrow;
pub mod compression;
pub mod decode;
pub mod encode;
pub mod files;
pub mod floats;
pub mod jpeg;
pub mod messages;
pub mod picture;
pub mod schema;
pub mod wire_format;

pub use schema::Schema;
