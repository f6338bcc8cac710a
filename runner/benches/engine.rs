//! The engine's own cost: nodes that do nothing, beside a bare crossbeam channel.
//!
//! `cargo bench -p depthloom-runner --bench engine`. An element is a task of the engine, a message of a channel. What
//! costs is CPU time, of all threads together: unlike the time on the wall it says the same on a machine that has
//! other work.

#[path = "../tests/support/mod.rs"]
mod support;

use depthloom_graphs::plan::{FrameIndex, PartId, RunId};
use std::hint::black_box;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use crossbeam::channel::{bounded, unbounded};
use depthloom_graphs::contracts::{Commit, Contract, ErrorMessage, NodeWarning, Sink, Slot};
use depthloom_graphs::values::Calibration;
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Key, Outputs, PureNode, Source, SourceOutputs, Value};
use depthloom_runner::{Audit, Interrupt, Options, Unwatched, run};
use rustix::time::{ClockId, clock_gettime};
use support::{Bench, node, number, planned, source};

const FRAMES: usize = 500;
const NODES: usize = 20;

/// Hands its input on.
struct Trivial;

impl PureNode for Trivial {
    fn process(&self, inputs: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        Ok(Outputs::one("x", Value::Calibration(Arc::clone(inputs.get::<Calibration>("a")?))))
    }
}

struct Still(Vec<Frame>, Value, Key);

impl Source for Still {
    fn frames(&self) -> &[Frame] {
        &self.0
    }

    fn key(&self, _: FrameIndex) -> Result<Key, Fault> {
        Ok(self.2)
    }

    fn read(&self, _: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        Ok(SourceOutputs { outputs: Outputs::one("x", self.1.clone()), key: self.2 })
    }
}

/// Takes nothing.
struct NoSink;

impl Sink for NoSink {
    type Part = ();

    fn parts(&self, _: RunId) -> usize {
        0
    }

    fn part(&self, _: RunId, _: Slot) -> Option<PartId> {
        None
    }

    fn encode(&self, _: RunId, _: (FrameIndex, &Frame), _: PartId, _: &[(Slot, Value)]) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn write(&self, _: &Commit<'_>, _: Vec<()>) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn once(&self, _: RunId, _: Slot, _: &Key, _: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        Ok(())
    }
}

/// `NODES` nodes: one after the other, or all on the source.
fn graph(is_chain: bool) -> Bench {
    let mut bench = Bench::new(&[""]);
    let frames = (0..FRAMES as u64).map(|k| Frame::at_10_hz("f", k)).collect();
    bench.stage("bench", Still(frames, number(1), Key::of_content(b"still")));
    for index in 0..NODES {
        let from = if is_chain && index > 0 { node(index - 1, 0) } else { source(0) };
        bench.node(planned("trivial", Contract::Pure, [from, None, None]), Instance::Pure(Box::new(Trivial)));
    }
    bench
}

/// The CPU time of `times` calls of `f`, over all threads. Setup is not counted.
fn cpu_time<S>(times: u64, set_up: impl Fn() -> S, f: impl Fn(S)) -> Duration {
    let now = || {
        let now = clock_gettime(ClockId::ProcessCPUTime);
        Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).expect("below a second"))
    };
    let time = || {
        let ready = set_up();
        let start = now();
        f(ready);
        now().saturating_sub(start)
    };
    (0..times).map(|_| time()).sum()
}

fn engine(c: &mut Criterion) {
    let mut group = c.benchmark_group("engine");
    group.sample_size(20).throughput(Throughput::Elements((FRAMES * (NODES + 1)) as u64));
    for (shape, is_chain) in [("chain", true), ("fan", false)] {
        for workers in [1, 2, 4] {
            let options = Options {
                workers,
                window: None,
                keep_going: false,
                checkpoints: None,
                audit: Audit::None,
                share: None,
            };
            let run = |ready| {
                run(ready, &NoSink, &options, &Unwatched, &Interrupt::default()).expect("nothing fails");
            };
            group.bench_function(format!("{shape} of {NODES}, {workers} workers"), |b| {
                b.iter_custom(|times| cpu_time(times, || graph(is_chain).ready(), run));
            });
        }
    }
    group.finish();
}

fn channel(c: &mut Criterion) {
    const MESSAGES: u64 = 10_000;
    let mut group = c.benchmark_group("channel");
    group.sample_size(20).throughput(Throughput::Elements(MESSAGES));
    group.bench_function("send and receive, one thread", |b| {
        let (send, receive) = unbounded::<u64>();
        let round = |()| {
            for message in 0..MESSAGES {
                send.send(message).expect("the other end is there");
                black_box(receive.recv().expect("the other end is there"));
            }
        };
        b.iter_custom(|times| cpu_time(times, || (), round));
    });
    group.bench_function("send to another thread, streaming", |b| {
        let round = |()| {
            let (send, receive) = bounded::<u64>(64);
            thread::scope(|scope| {
                scope.spawn(|| assert_eq!(black_box(receive.iter().count()) as u64, MESSAGES));
                (0..MESSAGES).for_each(|message| send.send(message).expect("the other end is there"));
                drop(send);
            });
        };
        b.iter_custom(|times| cpu_time(times, || (), round));
    });
    group.bench_function("send to another thread and back, one at a time", |b| {
        let round = |()| {
            let ((there, arrived), (back, returned)) = (bounded::<u64>(1), bounded::<u64>(1));
            thread::scope(|scope| {
                scope.spawn(move || arrived.iter().try_for_each(|message| back.send(message)));
                for message in 0..MESSAGES {
                    there.send(message).expect("the other end is there");
                    black_box(returned.recv().expect("the other end is there"));
                }
                drop(there);
            });
        };
        b.iter_custom(|times| cpu_time(times, || (), round));
    });
    group.finish();
}

criterion_group!(benches, engine, channel);
criterion_main!(benches);
