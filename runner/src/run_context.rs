//! What all stage runs of a run share.

use depthloom_threads::Budget;

use crate::checkpoints::Checkpoints;
use crate::interrupt::Interrupt;
use crate::observer::Observer;
use crate::options::Audit;
use crate::share::Share;
use crate::warnings::Warnings;

pub(crate) struct RunContext<'a, T> {
    pub(crate) sink: &'a T,
    pub(crate) budget: &'a Budget,
    pub(crate) observer: &'a dyn Observer,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) warnings: &'a Warnings,
    pub(crate) window: usize,
    pub(crate) keep_going: bool,
    pub(crate) checkpoints: &'a Checkpoints,
    pub(crate) audit: Audit,
    /// `None` if this process computes everything.
    pub(crate) share: Option<&'a Share>,
}
