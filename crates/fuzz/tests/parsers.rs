//! Whatever a stranger's file holds, it is read or refused in words, in bounded memory: no panic, no abort.
//!
//! `DEPTHLOOM_FUZZ=100000` mutates as often, `DEPTHLOOM_FUZZ_TARGET=kitti_scan` that target alone; whichever input
//! fails is written to a file, which belongs into `found/` then.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_fuzz::{Reader, Target, targets};
use depthloom_random::SplitMix64;
use depthloom_test_needs::is_full;

/// What a test may take, KiB of addresses: decoders are bounded to half a GiB each.
const MEMORY_KIB: u64 = 4 << 20;

/// Mutations of a target, unless the environment says otherwise.
fn default_mutations() -> usize {
    if is_full() { 300 } else { 100 }
}

/// Runs a test's body in a process of its own that may not take more memory: an allocation beyond ends it, and the test
/// with it.
fn bounded(test: &str, body: impl FnOnce()) {
    const INSIDE: &str = "DEPTHLOOM_FUZZ_INSIDE";
    if !cfg!(unix) || std::env::var_os(INSIDE).is_some() {
        return body();
    }
    let itself = std::env::current_exe().expect("a test is a program");
    let script = format!("ulimit -v {MEMORY_KIB} && exec \"$0\" \"$@\"");
    let mut inside = Command::new("sh");
    inside.arg("-c").arg(script).arg(itself).args([test, "--exact", "--nocapture"]).env(INSIDE, "1");
    let output = inside.output().expect("there is a shell");
    let status = output.status;
    let printed = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(status.success(), "{printed}");
    assert!(printed.contains("1 passed"), "{printed}");
    println!("{printed}");
}

/// All targets, or the one that `DEPTHLOOM_FUZZ_TARGET` names.
fn asked_for() -> impl Iterator<Item = Target> {
    let name = std::env::var("DEPTHLOOM_FUZZ_TARGET").ok();
    targets().into_iter().filter(move |target| name.as_ref().is_none_or(|name| target.name == name))
}

fn found(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("found").join(target);
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths.map(|path| (path.clone(), std::fs::read(path).expect("a file"))).collect()
}

/// Reads an input; if that panics, keeps it in a file and says where.
fn read(reader: &Reader, bytes: &[u8]) -> Result<(), String> {
    let name = reader.target().name;
    catch_unwind(AssertUnwindSafe(|| reader.read(bytes))).unwrap_or_else(|_| {
        let file = std::env::temp_dir().join(format!("depthloom-fuzz-{name}"));
        std::fs::write(&file, bytes).expect("written");
        panic!("{name} panics on {}: mend it, and keep the file in crates/fuzz/found/{name}", file.display());
    })
}

#[test]
fn seeds_are_read_and_known_failures_are_refused() {
    bounded("seeds_are_read_and_known_failures_are_refused", seeds);
}

fn seeds() {
    for target in asked_for() {
        let reader = Reader::new(target);
        let name = reader.target().name;
        let refused: Vec<String> = reader.target().seeds.iter().filter_map(|seed| reader.read(seed).err()).collect();
        // Two of the experiment's are there for their faults.
        let expected = if name == "experiment" { 2 } else { 0 };
        assert_eq!(refused.len(), expected, "{name}: {refused:#?}");
        for (path, bytes) in found(name) {
            let _ = read(&reader, &bytes).map_err(|why| assert!(!why.is_empty(), "{}", path.display()));
        }
    }
}

#[test]
fn mutations_are_read_or_refused() {
    bounded("mutations_are_read_or_refused", mutations);
}

fn mutations() {
    let mutations =
        std::env::var("DEPTHLOOM_FUZZ").map_or_else(|_| default_mutations(), |text| text.parse().expect("a number"));
    for target in asked_for() {
        let reader = Reader::new(target);
        let name = reader.target().name;
        let mut inputs = reader.target().seeds.clone();
        inputs.extend(found(name).into_iter().map(|(_, bytes)| bytes));
        let mut random =
            SplitMix64::new(name.bytes().fold(1, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte))));
        let mut refused = 0;
        for _ in 0..mutations {
            let mut bytes = inputs[below(&mut random, inputs.len())].clone();
            for _ in 0..=below(&mut random, 4) {
                mutate(&mut bytes, &inputs, &mut random);
            }
            refused += usize::from(read(&reader, &bytes).is_err());
        }
        println!("{name}: {refused} of {mutations} refused");
        assert!(refused > 0 || mutations < 100, "{name}: nothing was refused, so nothing was read");
    }
}

fn below(random: &mut SplitMix64, bound: usize) -> usize {
    (random.next() % bound.max(1) as u64) as usize
}

/// Changes bytes as files are broken, and as they are forged.
fn mutate(bytes: &mut Vec<u8>, inputs: &[Vec<u8>], random: &mut SplitMix64) {
    const NUMBERS: [&[u8]; 12] = [
        b"0",
        b"-1",
        b"1e308",
        b"nan",
        b"18446744073709551616",
        b"99999999999",
        &[0; 4],
        &[0xff; 4],
        &[0xff; 8],
        &[0xff, 0xff, 0xff, 0x7f],
        &[0, 0, 0, 0x80],
        &[1, 0, 0, 0, 0, 0, 0, 0],
    ];
    let at = below(random, bytes.len() + 1);
    match random.next() % 7 {
        0 => bytes.truncate(at),
        1 => bytes.extend_from_within(at..),
        2 => {
            let other = &inputs[below(random, inputs.len())];
            bytes.truncate(at);
            bytes.extend_from_slice(&other[at.min(other.len())..]);
        }
        3 => {
            let end = (at + 1 + below(random, 16)).min(bytes.len());
            bytes.drain(at.min(end)..end);
        }
        4 => {
            let number = NUMBERS[below(random, NUMBERS.len())];
            let end = (at + number.len()).min(bytes.len());
            bytes.splice(at..end, number.iter().copied());
        }
        5 => {
            let number = NUMBERS[below(random, NUMBERS.len())];
            bytes.splice(at..at, number.iter().copied());
        }
        _ => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << (random.next() % 8);
            }
        }
    }
}
