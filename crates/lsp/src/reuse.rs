//! Whether the results of nodes would be reused: determined on hover, on a thread of its own.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, bounded, unbounded};
use depthloom_graphs::language::Loaded;
use depthloom_threads::caught;

/// A hover waits no longer than this; the result is there for the next one.
const LIMIT: Duration = Duration::from_millis(30);

/// Whether the results of a node would be reused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReusedNode {
    /// The stage.
    pub stage: String,
    /// The node.
    pub node: String,
    /// Whether its results would be reused, for how many frames, and why not all, in words.
    pub summary: String,
}

/// Determines for every node of an experiment whether its results would be reused. It must not start programs.
pub type Reuse<'a> = dyn Fn(&Loaded) -> Result<Vec<ReusedNode>, String> + Sync + 'a;

type Outcome = Arc<Result<Vec<ReusedNode>, String>>;

struct Request {
    path: PathBuf,
    loaded: Arc<Loaded>,
    reply: Sender<Outcome>,
}

/// Requests to the thread.
pub(crate) struct Lookups {
    requests: Sender<Request>,
    is_busy: Arc<AtomicBool>,
}

/// The thread's side of [`Lookups`].
pub(crate) struct Worker {
    requests: Receiver<Request>,
    is_busy: Arc<AtomicBool>,
}

/// The two sides.
pub(crate) fn lookups() -> (Lookups, Worker) {
    let (sender, requests) = unbounded();
    let is_busy = Arc::new(AtomicBool::new(false));
    (Lookups { requests: sender, is_busy: Arc::clone(&is_busy) }, Worker { requests, is_busy })
}

impl Worker {
    /// Determines what is requested; what is known of the same plan is not determined again.
    pub(crate) fn run(&self, reuse: &Reuse<'_>) {
        let mut known: Option<(PathBuf, Arc<Loaded>, Outcome)> = None;
        while let Ok(Request { path, loaded, reply }) = self.requests.recv() {
            let outcome = match &known {
                Some((of, plan, outcome)) if *of == path && Arc::ptr_eq(plan, &loaded) => Arc::clone(outcome),
                _ => {
                    self.is_busy.store(true, Ordering::SeqCst);
                    let outcome = caught(|| reuse(&loaded)).unwrap_or_else(|panic| Err(panic.0));
                    self.is_busy.store(false, Ordering::SeqCst);
                    Arc::new(outcome)
                }
            };
            known = Some((path, loaded, Arc::clone(&outcome)));
            // The hover may no longer wait.
            let _ = reply.send(outcome);
        }
    }
}

impl Lookups {
    pub(crate) fn is_busy(&self) -> bool {
        self.is_busy.load(Ordering::SeqCst)
    }

    /// Whether the results of a node would be reused, in Markdown.
    pub(crate) fn text(&self, path: PathBuf, loaded: Arc<Loaded>, stage: &str, node: &str) -> String {
        let (reply, outcome) = bounded(1);
        let request = Request { path, loaded, reply };
        let outcome = self.requests.send(request).ok().and_then(|()| outcome.recv_timeout(LIMIT).ok());
        let text = match outcome.as_deref() {
            None => "being determined; point at it again in a moment".to_owned(),
            Some(Err(why)) => format!("not known: {why}"),
            Some(Ok(nodes)) => {
                let of_node: Vec<&str> = nodes
                    .iter()
                    .filter(|reused| reused.stage == stage && reused.node == node)
                    .map(|reused| reused.summary.as_str())
                    .collect();
                match of_node.is_empty() {
                    true => "nothing uses this node, so it does not run".to_owned(),
                    false => of_node.join("; "),
                }
            }
        };
        format!("Reuse: {text}")
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use depthloom_graphs::language::{Loaded, Options, load};
    use depthloom_graphs::{Registry, Source, SourceKind};

    use super::{Lookups, ReusedNode, lookups};

    struct Street;
    impl SourceKind for Street {
        type Params = std::collections::BTreeMap<String, u8>;
        fn declaration() -> depthloom_graphs::contracts::SourceDeclaration {
            let (kind, version, summary, doc, outputs) = ("street", 1, "A street.", "", Vec::new());
            depthloom_graphs::contracts::SourceDeclaration { kind, version, summary, doc, outputs }
        }
        fn open(_: Self::Params) -> Result<Box<dyn Source>, depthloom_graphs::Fault> {
            Err(depthloom_graphs::Fault::new("only declared"))
        }
    }

    fn plan() -> Arc<Loaded> {
        let text = "experiment: a\nsources: { s: { kind: street } }\nstages: { t: { source: s } }\n";
        let options = Options { text: Some(text.to_owned()), ..Options::default() };
        Arc::new(load(Path::new("a.yaml"), &Registry::default().source::<Street>(), &options).expect("valid"))
    }

    #[test]
    fn a_hover_does_not_wait_for_long_and_a_plan_is_looked_up_once() {
        let (lookups, worker) = lookups();
        let calls = AtomicUsize::new(0);
        let slow = |_: &Loaded| {
            calls.fetch_add(1, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(300));
            let (stage, node, summary) = ("t".to_owned(), "n".to_owned(), "reused".to_owned());
            Ok(vec![ReusedNode { stage, node, summary }])
        };
        let plan = plan();
        let text = |lookups: &Lookups, node: &str| lookups.text(PathBuf::from("a.yaml"), Arc::clone(&plan), "t", node);
        std::thread::scope(|scope| {
            let slow = &slow;
            scope.spawn(move || worker.run(slow));
            assert!(text(&lookups, "n").contains("being determined"));
            let mut now = text(&lookups, "n");
            for _ in 0..1000 {
                if !now.contains("being determined") {
                    break;
                }
                now = text(&lookups, "n");
            }
            assert_eq!(now, "Reuse: reused");
            assert_eq!(text(&lookups, "m"), "Reuse: nothing uses this node, so it does not run");
            drop(lookups);
        });
        assert_eq!(calls.load(Ordering::SeqCst), 1);
    }
}
