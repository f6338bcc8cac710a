//! A round of training, on a thread of its own.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use depthloom_graphs::{Fault, Host};
use depthloom_threads::{Caught, caught, look_for_room};

use crate::networks::ParameterLayout;
use crate::samples::{Sample, SamplesView, encode};
use crate::ssl::{SelfSupervision, SslParams};
use crate::training::{State, advance, in_pool};

/// How long a node waits before it looks again whether the run was cancelled.
const POLL: Duration = Duration::from_millis(20);

/// What a round trains, and on what: nothing else decides its result.
pub(super) struct Task {
    /// Their `steps` is the last step of the round.
    pub(super) params: SslParams,
    pub(super) layout: Arc<ParameterLayout>,
    /// After the round before.
    pub(super) state: Arc<State>,
    /// Columns and rows of the samples, px.
    pub(super) size: [u32; 2],
    pub(super) samples: Vec<Arc<Sample>>,
}

impl Task {
    fn train(&self, threads: usize, is_cancelled: &AtomicBool) -> Result<TrainedState, Fault> {
        let bytes = encode(self.size, &self.samples);
        let samples =
            SamplesView::read(&bytes).map_err(|error| Fault::new("the samples are damaged").because(error))?;
        let objective = SelfSupervision::new(&self.params, self.layout.map, &samples, None);
        let is_cancelled = || is_cancelled.load(Ordering::Relaxed);
        let train = || advance(&objective, &self.layout, (*self.state).clone(), &is_cancelled);
        let (state, cpu_ns) = in_pool(threads, self.params.batch, train)?;
        Ok(TrainedState { state: state?, cpu_ns })
    }
}

/// The result of a round.
pub(super) struct TrainedState {
    pub(super) state: State,
    /// CPU time of the training, nanoseconds.
    pub(super) cpu_ns: u64,
}

/// A round that was started. Dropping it cancels the training and waits for its thread.
pub(super) struct Round {
    results: Receiver<Result<TrainedState, Fault>>,
    is_cancelled: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Round {
    pub(super) fn start(task: Task, threads: usize) -> Result<Self, Fault> {
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let (sender, results) = sync_channel(1);
        let cancelled = Arc::clone(&is_cancelled);
        let train = move || {
            let result = caught(|| task.train(threads, &cancelled)).unwrap_or_else(|Caught(panic)| {
                Err(Fault::new(format!("the training failed with an internal error: {panic}")))
            });
            // The node may be gone.
            let _ = sender.send(result);
        };
        let builder = Builder::new().name("depthloom-online".to_owned());
        let thread = look_for_room().and_then(|()| builder.spawn(train));
        let thread = thread.map_err(|error| Fault::new("failed to start the training thread").because(error))?;
        Ok(Self { results, is_cancelled, thread: Some(thread) })
    }

    /// The result, if the round is finished.
    pub(super) fn try_finish(&self) -> Option<Result<TrainedState, Fault>> {
        match self.results.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(lost())),
        }
    }

    #[cfg(test)]
    pub(super) fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the result, or until the run is cancelled.
    pub(super) fn wait(&self, host: &dyn Host) -> Result<TrainedState, Fault> {
        loop {
            if host.cancelled() {
                return Err(Fault::Cancelled);
            }
            match self.results.recv_timeout(POLL) {
                Ok(result) => return result,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(lost()),
            }
        }
    }
}

fn lost() -> Fault {
    Fault::new("the training thread ended without a result")
}

impl Drop for Round {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It catches panics, and sends them as its result.
            let _ = thread.join();
        }
    }
}
