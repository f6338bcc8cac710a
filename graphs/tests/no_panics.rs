//! Whatever the text, the language answers with a plan or with diagnostics that point into the file.

mod toys;

use depthloom_graphs::language::{Options, SourceFile, load};
use proptest::prelude::{Just, Strategy, any, prop, prop_oneof};
use proptest::{prop_assert, proptest};

const TABLE_1: &str = include_str!("experiments/table1.yaml");

/// Words that mean something, and text that does not.
fn token() -> impl Strategy<Value = String> {
    prop_oneof![
        prop::sample::select(vec![
            "experiment",
            "sources",
            "stages",
            "variants",
            "matrix",
            "record",
            "extends",
            "kind",
            "with",
            "inputs",
            "concat",
            "score",
            "ground_truth",
            "estimates",
            "from",
            "sets",
            "file",
            "graph",
            "include",
            "exclude",
            "topics",
            "every",
            "source/left",
            "compare.stereo/disparity",
            "stereo/sgbm",
            "synthetic/road",
            "compare.scaled.with.method",
            "frames: 1..=40",
            "${HOME}",
            "${X:-3}",
            "${",
            "$${",
            "&a",
            "*a",
            "<<: *a",
            "!tag",
            "!!int",
            "? ",
            "---\n",
            "...\n",
            "{",
            "}",
            "[",
            "]",
            ",",
            ": ",
            ":\n",
            "- ",
            "\n",
            "\n  ",
            "\n      ",
            "#",
            "\"",
            "'",
            "|",
            ">",
            "%",
            "@",
            "`",
            "\t",
            "null",
            "~",
            "true",
            "1e999",
            ".inf",
            "-1",
            "0x1F",
            "18446744073709551616",
            "é",
            "深",
            "\u{feff}",
            "\u{0}",
            "\u{85}",
        ])
        .prop_map(str::to_owned),
        any::<String>(),
    ]
}

fn check(text: &str, set: &[(String, String)]) -> Result<(), proptest::test_runner::TestCaseError> {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let path = folder.path().join("main.yaml");
    std::fs::write(&path, text).expect("a file can be written");
    let env = Box::new(|name: &str| (name == "HOME").then(|| "/root".to_owned()));
    let options = Options { set: set.to_vec(), env, ..Options::default() };
    if let Err(diagnostics) = load(&path, &toys::registry(), &options) {
        prop_assert!(diagnostics.has_errors());
        for diagnostic in &diagnostics {
            prop_assert!(diagnostic.place.file.text.get(diagnostic.place.span.clone()).is_some(), "{diagnostic:?}");
            prop_assert!(!diagnostic.to_string().is_empty());
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(proptest::test_runner::Config { cases: 300, ..Default::default() })]

    #[test]
    fn no_text_panics(tokens in prop::collection::vec(token(), 0..40)) {
        check(&tokens.concat(), &[])?;
    }

    /// A whole experiment with a few places overwritten gets past the parser more often.
    #[test]
    fn no_damaged_experiment_panics(
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0_usize..12, token()), 1..6),
        set in prop::collection::vec((prop_oneof![Just("compare.scaled.with.method".to_owned()), token()], token()), 0..3),
    ) {
        let file = SourceFile::new("table1.yaml", TABLE_1, "");
        let mut chars: Vec<char> = file.text.chars().collect();
        for (at, length, token) in edits {
            let at = at.index(chars.len());
            let end = (at + length).min(chars.len());
            chars.splice(at..end, token.chars());
        }
        check(&chars.into_iter().collect::<String>(), &set)?;
    }

    /// Text with every line of a valid file in another order or twice.
    #[test]
    fn no_shuffled_experiment_panics(order in prop::collection::vec(0_usize..50, 0..60)) {
        let lines: Vec<&str> = TABLE_1.lines().collect();
        let text: Vec<&str> = order.iter().filter_map(|&line| lines.get(line).copied()).collect();
        check(&text.join("\n"), &[])?;
    }
}
