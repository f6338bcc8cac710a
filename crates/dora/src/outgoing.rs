//! The outputs of a part: each value as soon as it is there, and a report per frame.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{Commit, Contract, ErrorMessage, NodeWarning, Sink, Slot};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, PortId, RunId, StageRun};
use depthloom_graphs::{Fault, Frame, Key, Rate, Value, chain};
use depthloom_runner::RunError;
use depthloom_threads::locked;

use crate::bridge::Bridge;
use crate::channel;
use crate::message::{of_text, of_value};
use crate::remedies::Remedies;
use crate::report::Report;

/// Sends each value as soon as it is there, and a report per frame.
pub(crate) struct Outgoing<'a> {
    bridge: &'a Bridge,
    /// The outputs with a value per frame.
    slots: Vec<(Slot, &'static str)>,
    once: Vec<&'static str>,
    is_source: bool,
    written: AtomicUsize,
    sent_once: Mutex<(BTreeSet<&'static str>, Vec<NodeWarning>)>,
    remedies: Arc<Remedies>,
}

impl<'a> Outgoing<'a> {
    /// For the last node of a piece, or for its source if it has no nodes.
    pub(crate) fn new(bridge: &'a Bridge, run: &StageRun, remedies: Arc<Remedies>) -> Self {
        let (mut slots, mut once) = (Vec::new(), Vec::new());
        let is_source = run.nodes.is_empty();
        if let Some((node, planned)) = NodeId::enumerate(&run.nodes).last() {
            for (port, output) in PortId::enumerate(&planned.outputs) {
                if planned.contract == Contract::Once || output.port.rate == Rate::Once {
                    once.push(output.port.name);
                } else {
                    slots.push((Slot::Node { node, port }, output.port.name));
                }
            }
        } else {
            let outputs = PortId::enumerate(&run.source.outputs);
            slots.extend(outputs.map(|(port, output)| (Slot::Source { port }, output.port.name)));
        }
        let (written, sent_once) = (AtomicUsize::new(0), Mutex::default());
        Self { bridge, slots, once, is_source, written, sent_once, remedies }
    }

    /// Sends how the run ended.
    pub(crate) fn close(&self, ran: &Result<depthloom_runner::Report, RunError>) -> Result<(), Fault> {
        let frame = Frame::at_10_hz("", 0);
        let next = Some((FrameIndex(self.written.load(Ordering::SeqCst)), &frame));
        let report = |position, report: &Report| self.bridge.send(channel::REPORT, position, &of_text(&report.text()));
        match ran {
            Ok(ran) if ran.interrupted => Ok(()),
            Ok(_) => {
                let (sent, warned) = std::mem::take(&mut *locked(&self.sent_once));
                let absent: Vec<&str> = self.once.iter().copied().filter(|port| !sent.contains(port)).collect();
                for port in &absent {
                    self.bridge.send(port, None, &[])?;
                }
                if self.once.is_empty() {
                    return Ok(());
                }
                let absent = absent.into_iter().map(str::to_owned).collect();
                let warnings = warned.into_iter().map(|warned| (warned.what, warned.count)).collect();
                report(None, &Report { absent, warnings, ..Report::default() })
            }
            Err(RunError::Aborted) => Ok(()),
            Err(RunError::NodeFailed { frame: None, fault, .. }) => report(None, &Report::failed(fault)),
            Err(RunError::NodeFailed { fault, .. } | RunError::SourceFailed { fault, .. }) => {
                report(next, &Report::failed(fault))
            }
            Err(error) => {
                let fault = Fault::new(chain(error));
                report(next, &Report::failed(&fault))?;
                report(None, &Report::failed(&fault))
            }
        }
    }
}

impl Sink for Outgoing<'_> {
    type Part = ();

    fn parts(&self, _: RunId) -> usize {
        self.slots.len()
    }

    fn part(&self, _: RunId, slot: Slot) -> Option<PartId> {
        self.slots.iter().position(|(own, _)| *own == slot).map(PartId)
    }

    fn encode(
        &self,
        _: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<(), ErrorMessage> {
        let stream = values.first().map(|(_, value)| of_value(value)).unwrap_or_default();
        self.bridge.send(self.slots[part].1, Some(frame), &stream).map_err(ErrorMessage::from)
    }

    fn write(&self, commit: &Commit<'_>, _: Vec<()>) -> Result<(), ErrorMessage> {
        let position = FrameIndex(self.written.fetch_add(1, Ordering::SeqCst));
        let is_ours = |slot: &Slot| self.slots.iter().find(|(own, _)| own == slot);
        let absent = commit.absent.iter().filter_map(is_ours).map(|(_, port)| (*port).to_owned()).collect();
        // The source of a node's piece only fails if the run is abandoned.
        let own = commit.failures.iter().find(|failure| failure.node.is_some() != self.is_source);
        let own = own.or_else(|| commit.failures.first());
        let remedy = locked(&self.remedies).remove(&position);
        let report = Report {
            key: commit.source_key.filter(|_| self.is_source),
            absent,
            warnings: commit.warnings.iter().map(|warned| (warned.what.clone(), warned.count)).collect(),
            failed: own.map(|failure| (failure.what.clone(), remedy)),
        };
        let stream = of_text(&report.text());
        self.bridge.send(channel::REPORT, Some((position, commit.frame)), &stream).map_err(ErrorMessage::from)
    }

    fn once(&self, _: RunId, slot: Slot, _: &Key, value: &Value, warnings: &[NodeWarning]) -> Result<(), ErrorMessage> {
        let Slot::Node { port, .. } = slot else { return Ok(()) };
        let Some(name) = self.aggregate_name(port) else { return Ok(()) };
        self.bridge.send(name, None, &of_value(value))?;
        let mut sent = locked(&self.sent_once);
        sent.0.insert(name);
        sent.1 = warnings.to_vec();
        Ok(())
    }
}

impl Outgoing<'_> {
    /// The aggregate output of a port.
    fn aggregate_name(&self, port: PortId) -> Option<&'static str> {
        let before = self.slots.iter().filter(|(slot, _)| matches!(slot, Slot::Node { port: of, .. } if *of < port));
        self.once.get(port.0 - before.count()).copied()
    }
}
