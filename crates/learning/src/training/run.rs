//! A training as a node runs it: resumed, watched, stored.

use std::time::Instant;

use depthloom_graphs::values::Curve;
use depthloom_graphs::{Fault, Host};
use depthloom_threads::look_for_room;
use rayon::ThreadPool;
use rustix::time::{ClockId, clock_gettime};

use super::checkpoint::Checkpoint;
use super::steps::{State, Training};
use super::{Objective, Settings, diverged};
use crate::networks::ParameterLayout;

/// Trains from a checkpoint of an earlier run, or else from the values of `start`: the learned values and the curve.
pub(crate) fn learn<O: Objective>(
    objective: &O,
    layout: &ParameterLayout,
    start: impl FnOnce() -> Result<Vec<Vec<f32>>, Fault>,
    host: &dyn Host,
) -> Result<(Vec<Vec<f32>>, Curve), Fault> {
    let Settings { steps, checkpoint_every, .. } = objective.settings();
    let checkpoint = host.checkpoint().map(Checkpoint::at);
    let resumed_state = checkpoint.as_ref().and_then(|checkpoint| {
        checkpoint.load(layout).unwrap_or_else(|unusable| {
            host.notice(&format!("{unusable}: training starts from the first step"));
            None
        })
    });
    let state = match resumed_state {
        Some(state) => {
            let step = state.step;
            host.info(&format!("resumes at step {step} of {steps} from a checkpoint of an earlier run"));
            state
        }
        None => State { values: start()?, ..State::default() },
    };
    let mut training = Training::resume(objective, objective.network(), layout, state);
    let save = |training: &Training<'_, O, _>| match &checkpoint {
        Some(checkpoint) => checkpoint.save(layout, training.state()),
        None => Ok(()),
    };
    let (began, first) = (Instant::now(), training.step());
    while !training.is_finished() {
        if host.stopping() {
            save(&training)?;
            return Err(Fault::Cancelled);
        }
        training.advance();
        if training.has_diverged() {
            return Err(diverged());
        }
        let step = training.step();
        let seconds = began.elapsed().as_secs_f64();
        let per_second = (step - first) as f64 / seconds.max(1e-9);
        let left = steps.saturating_sub(step) as f64 / per_second;
        let loss = training.loss().map_or_else(|| "no target yet".to_owned(), |loss| format!("loss {loss:.5}"));
        host.progress(step, steps, &format!("{loss}, {per_second:.1} steps/s, {left:.0} s left"));
        if step.is_multiple_of(checkpoint_every) && !training.is_finished() {
            save(&training)?;
        }
    }
    let learned = training.learned();
    if learned.iter().flatten().any(|value| !value.is_finite()) {
        return Err(diverged());
    }
    // The last state too: a run may end before the network is stored, and the next one then finds it complete.
    if training.step() > first
        && let Err(fault) = save(&training)
    {
        host.notice(&fault.chain());
    }
    Ok((learned, Curve { points: training.points().to_vec() }))
}

/// Trains from a state until the objective's last step. Returns the state after it, with the parameters of that step.
pub(crate) fn advance<O: Objective>(
    objective: &O,
    layout: &ParameterLayout,
    state: State,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<State, Fault> {
    let mut training = Training::resume(objective, objective.network(), layout, state);
    while !training.is_finished() {
        if is_cancelled() {
            return Err(Fault::Cancelled);
        }
        training.advance();
        if training.has_diverged() {
            return Err(diverged());
        }
    }
    let state = training.into_state();
    if state.values.iter().flatten().any(|value| !value.is_finite()) {
        return Err(diverged());
    }
    Ok(state)
}

/// Runs a training on threads of its own, whose CPU time is added to that of the host.
pub(crate) fn on_threads<T: Send>(batch: u32, host: &dyn Host, train: impl FnOnce() -> T + Send) -> Result<T, Fault> {
    let (learned, cpu_ns) = in_pool(host.width(), batch, train)?;
    host.add_cpu_time(cpu_ns);
    Ok(learned)
}

/// Runs a training on at most `width` threads of its own. Returns their CPU time too, nanoseconds.
pub(crate) fn in_pool<T: Send>(width: usize, batch: u32, train: impl FnOnce() -> T + Send) -> Result<(T, u64), Fault> {
    let pool = pool(width, batch)?;
    let learned = pool.install(train);
    let cpu_ns = spent_ns(&pool);
    Ok((learned, cpu_ns))
}

/// Refuses a `patience` without validation samples.
pub(crate) fn check_patience(settings: &Settings, has_validation: bool) -> Result<(), Fault> {
    if settings.patience.is_none() || has_validation {
        return Ok(());
    }
    Err(Fault::new("`patience` waits for a better validation error, and no samples are wired to `validation`")
        .remedy("wire validation samples, or leave `patience` out"))
}

/// Refuses a `patience` that never sees a point of the curve.
pub(crate) fn check_curve(settings: &Settings) -> Result<(), (&'static str, String)> {
    if settings.patience.is_some() && settings.curve_every > settings.steps {
        return Err(("curve_every", "curve_every must not exceed steps if patience is set".to_owned()));
    }
    Ok(())
}

/// CPU time of the pool's threads since they began, nanoseconds.
fn spent_ns(pool: &ThreadPool) -> u64 {
    let of_thread = |_: rayon::BroadcastContext<'_>| {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs()
    };
    pool.broadcast(of_thread).into_iter().sum()
}

/// The threads of one training. More than the batch has images would find nothing to do. Trainings at once have threads
/// of their own, so that each one's CPU time is known; the cores they share.
fn pool(width: usize, batch: u32) -> Result<ThreadPool, Fault> {
    let named = |index: usize| format!("depthloom-learning-{index}");
    let threads = width.min(batch as usize).max(1);
    let start = |thread: rayon::ThreadBuilder| {
        let builder = std::thread::Builder::new().name(named(thread.index()));
        look_for_room().and_then(|()| builder.spawn(|| thread.run())).map(drop)
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).spawn_handler(start).build();
    pool.map_err(|error| Fault::new("failed to start the training threads").because(error))
}
