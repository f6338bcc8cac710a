//! What no key can know: the audit of reused values finds it. Each case makes a run, changes something behind the keys'
//! back, and runs again.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use depthloom::graphs::contracts::{Contract, NodeDeclaration};
use depthloom::graphs::values::Depth;
use depthloom::graphs::{Context, Fault, Inputs, Instance, Node, Outputs, Port, PureNode, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The variable by which this test program is depthloom with one more kind, and its value the constant in that kind's
/// code.
pub(crate) const FACTOR: &str = "DEPTHLOOM_TEST_FACTOR";

/// Parameters of `test/scale`.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[derive(Default)]
pub(crate) struct ScaleParams {}

/// A kind whose code changes while its version does not.
pub(crate) struct Scale {
    factor: f32,
}

impl Node for Scale {
    type Params = ScaleParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "test/scale",
            version: 1,
            contract: Contract::Pure,
            summary: "Depth times a constant.",
            doc: "The constant is part of the code.",
            inputs: vec![Port::frame("depth", ValueType::Depth, "Depth, metres.")],
            outputs: vec![Port::frame("depth", ValueType::Depth, "Depth, metres.")],
        }
    }

    fn build(_: ScaleParams) -> Result<Instance, Fault> {
        let factor = std::env::var(FACTOR).ok().and_then(|factor| factor.parse().ok());
        let factor = factor.ok_or_else(|| Fault::new(format!("{FACTOR} is not a number")))?;
        Ok(Instance::Pure(Box::new(Self { factor })))
    }
}

impl PureNode for Scale {
    fn process(&self, inputs: &Inputs<'_>, _: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mut metres = inputs.get::<Depth>("depth")?.metres.clone();
        metres.iter_mut().for_each(|metres| *metres *= self.factor);
        Ok(Outputs::one("depth", Depth { metres }))
    }
}

/// A folder with an experiment of one node `own` on a street, and a filter behind it.
struct Case {
    folder: tempfile::TempDir,
    /// This test program.
    program: PathBuf,
    binary: PathBuf,
    /// The PATH of the runs, if it is another.
    path: Option<OsString>,
}

impl Case {
    fn new(binary: &Path, node: &str) -> Self {
        let program = std::env::current_exe().expect("a test program has a path");
        let folder = tempfile::tempdir().expect("a folder");
        let text = format!(
            "experiment: audit
sources: {{ street: {{ kind: synthetic/road, with: {{ frames: 0..3, width: 64, height: 32 }} }} }}
stages:
  look:
    source: street
    nodes:
      own: {node}
      after: {{ kind: filter/median, inputs: {{ depth: own/depth }} }}
    score: {{ ground_truth: source/depth, estimates: {{ own: own/depth, after: after/depth }} }}
"
        );
        let text = text.replace("PROGRAM", &program.display().to_string());
        fs::write(folder.path().join("audit.yaml"), text).expect("written");
        Self { folder, program, binary: binary.to_owned(), path: None }
    }

    /// A `process` node; `with` is how its results are known again.
    fn of_process(binary: &Path, with: &str) -> Self {
        Self::of_process_on(binary, "depth", with)
    }

    /// The same on another output of the street.
    fn of_process_on(binary: &Path, output: &str, with: &str) -> Self {
        let ports = "ports: { inputs: { depth: depth }, outputs: { depth: depth } }";
        let node = format!(
            "{{ kind: process, inputs: {{ depth: source/{output} }}, with: {{ command: [PROGRAM, --process], {ports}, {with} }} }}"
        );
        Self::new(binary, &node)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.folder.path().join(name), content).expect("written");
    }

    fn run(&self, out: &str, factor: Option<&str>, more: &[&str]) -> Output {
        let mut command = Command::new(if factor.is_some() { &self.program } else { &self.binary });
        command.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH").env("NO_COLOR", "1");
        command.envs(factor.map(|factor| (FACTOR, factor)));
        command.envs(self.path.iter().map(|path| ("PATH", path))).env("PYTHONDONTWRITEBYTECODE", "1");
        command.args(["run", "audit.yaml", "--quiet", "--no-page", "--allow-exec", "--out", out]).args(more);
        command.output().expect("the program starts")
    }

    fn succeed(&self, out: &str, factor: Option<&str>, more: &[&str]) {
        let output = self.run(out, factor, more);
        assert!(output.status.success(), "{out}: {}", errors(&output));
    }

    /// Runs again after something changed: the audit fails the run and names the node; without it, nothing is noticed;
    /// with `--fresh` the run succeeds.
    fn assert_found(&self, what: &str, factor: Option<&str>, node: &str) {
        for audit in [&[][..], &["--audit", "sample"], &["--audit", "all"]] {
            let output = self.run("runs/again", factor, audit);
            let text = errors(&output);
            assert!(!output.status.success(), "{what}: {audit:?} does not find it");
            assert!(
                text.contains(&format!("look.{node}")),
                "{what}: the error does not name the node `{node}`: {text}"
            );
            assert!(text.contains("fresh"), "{what}: the error does not say how to go on: {text}");
            assert!(!self.folder.path().join("runs/again").exists(), "{what}: the run has its final name");
        }
        self.succeed("runs/unaudited", factor, &["--audit", "none"]);
        fs::remove_dir_all(self.folder.path().join("runs/unaudited")).expect("removed");
        self.succeed("runs/fresh", factor, &["--fresh"]);
        println!("audit: finds {what}");
    }
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// All cases; `python` has the package `depthloom`.
pub(crate) fn check(binary: &Path, python: Option<&Path>) {
    constant(binary);
    if let Some(python) = python {
        module(binary, python);
    }
    undeclared_file(binary);
    random(binary);
    chunk(binary);
    nothing(binary);
}

fn constant(binary: &Path) {
    let case = Case::new(binary, "{ kind: test/scale, inputs: { depth: source/depth } }");
    case.succeed("runs/first", Some("2"), &[]);
    case.assert_found("a constant that changed without a new version of its kind", Some("3"), "own");
}

fn undeclared_file(binary: &Path) {
    for with in ["version: 1", "code: [code.txt]"] {
        let case = Case::of_process(binary, &format!("{with}, params: {{ read: [factor.txt] }}"));
        case.write("code.txt", "");
        case.write("factor.txt", "2");
        case.succeed("runs/first", None, &[]);
        case.write("factor.txt", "3");
        case.assert_found("a changed file that `code` does not name", None, "own");
    }
}

/// A module that a node in Python imports, where keys do not contain what programs import.
fn module(binary: &Path, python: &Path) {
    let ports = "ports: { inputs: { depth: depth }, outputs: { depth: depth } }";
    let node = format!(
        "{{ kind: process, inputs: {{ depth: source/depth }}, with: {{ command: [python3, own.py], code: [own.py], imports: false, {ports} }} }}"
    );
    let mut case = Case::new(binary, &node);
    let own = python.parent().map(Path::to_owned);
    let others = std::env::var_os("PATH").unwrap_or_default();
    let folders = own.into_iter().chain(std::env::split_paths(&others));
    case.path = Some(std::env::join_paths(folders).expect("folders of a PATH"));
    let code = "import depthloom\nimport factor\n@depthloom.node(inputs={'depth': 'depth'}, outputs={'depth': 'depth'})\n\
                def own(depth):\n    return depth * factor.FACTOR\ndepthloom.serve(own)\n";
    case.write("own.py", code);
    case.write("factor.py", "FACTOR = 2\n");
    case.succeed("runs/first", None, &[]);
    case.write("factor.py", "FACTOR = 3\n");
    case.assert_found("a changed module, where keys do not contain imports", None, "own");
}

fn random(binary: &Path) {
    let case = Case::of_process(binary, "version: 1, params: { random: true }");
    case.succeed("runs/first", None, &[]);
    case.assert_found("a node with random results", None, "own");
}

/// Nothing changed: nothing is found.
fn nothing(binary: &Path) {
    let case = Case::of_process(binary, "version: 1");
    case.succeed("runs/first", None, &[]);
    for audit in ["none", "sample", "all"] {
        case.succeed(&format!("runs/{audit}"), None, &["--audit", audit]);
    }
}

/// One bit of a stored value changes, and the checksum of its chunk with it: the checksum of its frame finds that. If
/// this is adjusted too, the audit does.
fn chunk(binary: &Path) {
    for with_frames in [false, true] {
        // Of the exact depth, which has no gaps: noise is stored as it is.
        let case = Case::of_process_on(binary, "dense", "version: 1, params: { noise: true }");
        case.succeed("runs/first", None, &[]);
        let path = case.folder.path().join("runs/first/recording.mcap");
        let mut bytes = fs::read(&path).expect("a recording");
        corrupt(&mut bytes, "/look/own/depth", with_frames.then_some("/look/commit"));
        fs::write(&path, bytes).expect("written");
        if with_frames {
            case.assert_found("a corrupted chunk with valid checksums", None, "own");
            continue;
        }
        let output = case.run("runs/again", None, &["--audit", "none"]);
        assert!(output.status.success() && errors(&output).contains("damaged"), "{}", errors(&output));
        case.succeed("runs/fresh", None, &["--fresh"]);
        let recording = |run: &str| fs::read(case.folder.path().join(run).join("recording.mcap")).expect("a recording");
        assert!(recording("runs/again") == recording("runs/fresh"), "corrupted values are reused");
    }
}

/// Records of MCAP: opcode, length, content.
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;

/// The records from a place to an end: opcode, and where the content is.
fn records(bytes: &[u8], mut place: usize, end: usize) -> Vec<(u8, std::ops::Range<usize>)> {
    let mut found = Vec::new();
    while place + 9 <= end {
        let length = u64::from_le_bytes(bytes[place + 1..place + 9].try_into().expect("eight bytes")) as usize;
        found.push((bytes[place], place + 9..place + 9 + length));
        place += 9 + length;
    }
    found
}

/// Changes the values of a topic; the checksums of chunks are adjusted, and with the topic of commits those of frames,
/// too.
fn corrupt(bytes: &mut [u8], topic: &str, commits: Option<&str>) {
    let original = bytes.to_vec();
    let number = |bytes: &[u8], place: usize| {
        u32::from_le_bytes(bytes[place..place + 4].try_into().expect("four bytes")) as usize
    };
    let all = records(bytes, 8, bytes.len() - 8);
    let channel = |topic: &str| {
        let found = all.iter().find(|(op, content)| {
            let name = content.start + 8;
            *op == CHANNEL && &original[name..name + number(&original, content.start + 4)] == topic.as_bytes()
        });
        let (_, content) = found.expect("the topic has a channel");
        [original[content.start], original[content.start + 1]]
    };
    let (values, commits) = (channel(topic), commits.map(channel));
    let mut is_done = false;
    for (_, content) in all.iter().filter(|(op, _)| *op == CHUNK) {
        // Two times, the size, the checksum; the compression's name; the records.
        let (checksum, name) = (content.start + 24, content.start + 28);
        let first = name + 4 + number(bytes, name) + 8;
        let is_plain = number(bytes, name) == 0;
        if !is_plain {
            continue;
        }
        for (_, message) in records(bytes, first, content.end).iter().filter(|(op, _)| *op == MESSAGE) {
            let channel = [bytes[message.start], bytes[message.start + 1]];
            if channel == values {
                // In the lower bits of a sample in the middle of the map.
                bytes[usize::midpoint(message.start, message.end) & !3] ^= 1;
                is_done = true;
            }
            if Some(channel) == commits {
                // A commit has the checksum of all bytes before its chunk.
                let record = content.start - 9;
                let before = crc32fast::hash(&original[..record]).to_le_bytes();
                let after = crc32fast::hash(&bytes[..record]).to_le_bytes();
                let place = bytes[message.clone()].windows(4).position(|bytes| bytes == before);
                let place = message.start + place.expect("a commit has a checksum");
                bytes[place..place + 4].copy_from_slice(&after);
            }
        }
        let adjusted = crc32fast::hash(&bytes[first..content.end]).to_le_bytes();
        bytes[checksum..checksum + 4].copy_from_slice(&adjusted);
    }
    assert!(is_done, "no value of {topic} is stored without compression");
}
