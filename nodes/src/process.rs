//! `process` and `process/source`: nodes and sources in any language, as programs that are called over their standard
//! streams.

#[cfg(unix)]
mod child;
mod ended;
mod imports;
mod launch;
#[cfg(unix)]
mod memory;
mod modules;
mod node;
pub mod permission;
#[cfg(unix)]
mod pool;
mod protocol;
mod source;
#[cfg(unix)]
mod stream;

pub use ended::{EndedProgram, printed_text, take_ended};
pub use imports::take_import_warnings;
pub(crate) use launch::{ProgramParams, command_line};
pub use node::{Process, ProcessContract, ProcessParams};
pub use source::{ProcessSource, ProcessSourceParams};

#[cfg(not(unix))]
mod pool {
    //! Where there are no process groups nothing is started.

    use depthloom_codecs::arrow::Schema;
    use depthloom_graphs::{Fault, Host, Outputs, Port, Value};

    use std::sync::Arc;

    use super::launch::Launch;
    use super::modules::ModuleReport;
    use super::protocol::Call;

    pub(super) struct Pool(Launch);

    pub(super) enum Answer {
        Frames(Vec<String>, Option<Vec<u64>>),
    }

    pub(super) fn report_of(_: &Launch) -> Option<Arc<ModuleReport>> {
        None
    }

    impl Pool {
        pub(super) fn new(launch: Launch, _: Schema, _: Vec<Port>) -> Self {
            Self(launch)
        }

        pub(super) const fn launch(&self) -> &Launch {
            &self.0
        }

        pub(super) fn outputs(&self, _: Call, _: Vec<Option<Value>>, _: &dyn Host) -> Result<Outputs, Fault> {
            Err(Fault::new("programs are started on Unix alone"))
        }

        pub(super) fn call(&self, _: Call, _: Vec<Option<Value>>, _: &dyn Host) -> Result<Answer, Fault> {
            Err(Fault::new("programs are started on Unix alone"))
        }
    }
}
