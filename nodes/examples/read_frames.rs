//! Reads every frame of a source as a run does (its key, then its values), on some threads at once; for
//! `bench/reading.sh`.
//!
//!     read_frames KIND 'PARAMS AS JSON'
//!
//! Each line of standard input is a number of threads; the answer is the seconds that all frames took.

use depthloom_graphs::plan::FrameIndex;
use std::io::{BufRead, stdin};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::{Context, Fault, Scratch};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(kind), Some(params)) = (arguments.next(), arguments.next()) else { return Err("KIND and PARAMS".into()) };
    let registry = depthloom_nodes::registry();
    let kind = registry.source_kind(&kind).ok_or("no such kind")?;
    let resolved = kind.resolve(&serde_json::from_str(&params)?).map_err(|error| error.what)?;
    let source = kind.open(&resolved)?;
    for line in stdin().lock().lines() {
        let threads: usize = line?.trim().parse()?;
        let next = AtomicUsize::new(0);
        let work = || -> Result<(), Fault> {
            let mut scratch = Scratch::default();
            loop {
                let position = next.fetch_add(1, Ordering::Relaxed);
                if position >= source.frames().len() {
                    return Ok(());
                }
                let key = source.key(FrameIndex(position))?;
                let read = source.read(FrameIndex(position), &mut Context::new(&InlineHost, &mut scratch))?;
                assert_eq!(key, read.key, "the key of the frame that was read equals the requested key");
            }
        };
        let started = Instant::now();
        std::thread::scope(|scope| {
            let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
            let own = work();
            others.into_iter().map(|other| other.join().expect("no thread panics")).fold(own, Result::and)
        })?;
        println!("{}", started.elapsed().as_secs_f64());
    }
    Ok(())
}
