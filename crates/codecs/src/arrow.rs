//! Values as Arrow record batches, and streams of these, for programs in other languages.
//!
//! A column holds the value of one port: a struct with `width`, `height` and `data`, a list of numbers, row by row, so
//! that Arrow's libraries, and NumPy on top of them, read the pixels without a copy. A batch has one row.
//!
//! This is the part of Arrow's IPC format that such streams take (little endian, V5; no dictionaries, no compression),
//! and it reads what others write of it: lengths and offsets are checked before they are followed.
//!
//! `arrow-ipc` 60.1 takes half the lines and the same CPU time (tried on calls with KITTI images). It adds nine crates,
//! about 90 s of CPU time to build, and `arrow-array` enables other features of `chrono` and `ahash`, so that polars
//! and burn are compiled again.
//!
//! ```
//! use depthloom_codecs::arrow::{self, Schema, StreamReader};
//! use depthloom_graphs::values::{Depth, Raster};
//! use depthloom_graphs::{Value, ValueType};
//!
//! let value = Value::from(Depth { metres: Raster::from_raw(2, 1, vec![3.5, f32::NAN]).unwrap() });
//! let schema = Schema { fields: vec![arrow::field("depth", ValueType::Depth).unwrap()], metadata: vec![] };
//! let mut stream = Vec::new();
//! arrow::write_schema(&schema, &mut stream)?;
//! arrow::encode(&schema, vec![arrow::data(&value).unwrap()]).write(&mut stream)?;
//!
//! let mut reader = StreamReader::new(&stream[..]);
//! let schema = reader.schema()?.unwrap();
//! let batch = reader.batch(&schema)?.unwrap();
//! let column = batch.column(&schema, "depth").unwrap();
//! let Ok(Value::Depth(depth)) = arrow::value(ValueType::Depth, &column) else { panic!() };
//! assert_eq!(depth.metres[(0, 0)].0, [3.5]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod batch;
mod flat;
mod row;
mod stream;
mod types;
mod values;

pub use batch::{Batch, View};
pub use row::{Data, Encoded, Items, encode};
pub use stream::{StreamError, StreamReader, write_schema};
pub use types::{DataType, Field, Offsets, Schema};
pub use values::{PORT_TYPE, data, field, value};
