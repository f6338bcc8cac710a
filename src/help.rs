//! What stands at the end of a command's help and of its manual page: examples, and what its exit codes mean.

use std::fmt::Write as _;

use depthloom_terminal::Exit;

/// The end of a help text.
pub struct Ending {
    /// The command, as in `runs rm`; empty for the program.
    command: &'static str,
    /// Arguments, and what they do.
    pub examples: &'static [(&'static str, &'static str)],
    /// Exit codes, and what they mean here.
    pub exits: &'static [(Exit, &'static str)],
}

const WHOLE: (Exit, &str) = (Exit::Whole, "whole");
const PRINTED: (Exit, &str) = (Exit::Engine, "the output could not be written");
const WRONG: (Exit, &str) = (Exit::Before, "the experiment or an argument is wrong");
const ARGUMENT: (Exit, &str) = (Exit::Before, "an argument is wrong");
const BEFORE: (Exit, &str) = (Exit::Before, "found before any frame was admitted: file, arguments, missing data");
const INTERRUPTED: (Exit, &str) = (Exit::Interrupted, "interrupted");

const RUN_READ: &[(Exit, &str)] = &[
    WHOLE,
    PRINTED,
    (Exit::Before, "there is no such run, it cannot be read, or an argument is wrong"),
    (Exit::Frames, "a recording is damaged where it was read"),
];

const RUNS_REMOVED: &[(Exit, &str)] = &[
    WHOLE,
    (Exit::Engine, "the disk failed, or the output could not be written"),
    (Exit::Before, "nothing was removed: there is no such run, it goes on, or an argument is wrong"),
];

const RUNS_READ: &[(Exit, &str)] =
    &[WHOLE, PRINTED, (Exit::Before, "there is no such folder, or an argument is wrong")];

/// Of what asks a recording for scores.
const ASKED: &[(Exit, &str)] = &[
    WHOLE,
    (Exit::Engine, "the analysis failed, or the output could not be written"),
    (Exit::Before, "there is no recording, or an argument is wrong"),
    (Exit::Frames, "the recording is damaged where a number would come from"),
    INTERRUPTED,
];

const ENDINGS: &[Ending] = &[
    Ending {
        command: "",
        examples: &[
            ("new first.yaml", "write a commented experiment that runs anywhere"),
            ("run first.yaml", "run it: a recording, a table, plots"),
            ("nodes stereo/sgbm", "explain a kind of node"),
            ("help run", "explain a command"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the engine, the disk or learning failed"),
            BEFORE,
            (Exit::Frames, "frames failed or were dropped, not one pixel could be scored, or a recording is damaged"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "run",
        examples: &[
            ("run experiments/table1.yaml", "into runs/table1/<UTC time>"),
            ("run first.yaml --out look --overwrite", "into look, in place of the run there"),
            ("run first.yaml --set sources.street.with.frames=0..2", "with something set otherwise"),
            ("run first.yaml --json | jq .report.table", "for programs"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the engine, the disk or learning failed; frames before that are readable"),
            BEFORE,
            (Exit::Frames, "a frame failed; with --keep-going: the run is whole but for what failed"),
            (Exit::Interrupted, "interrupted; frames before that are readable"),
        ],
    },
    Ending {
        command: "check",
        examples: &[
            ("check first.yaml", "all of its mistakes, each where it stands"),
            (
                "check first.yaml --json | jq -r '.diagnostics[] | \"\\(.file):\\(.line): \\(.message)\"'",
                "for programs",
            ),
            ("check first.yaml --sarif > check.sarif", "for code review; begin in the repository's root"),
            ("check first.yaml --data", "every frame of its data too, before an hour is computed on them"),
        ],
        exits: &[(Exit::Whole, "right; there may be warnings"), PRINTED, WRONG],
    },
    Ending {
        command: "data",
        examples: &[
            ("data /data/kitti", "frames, sizes, calibration and truth, and the source to paste"),
            ("data /data/robot --sheet robot.png", "and a picture of its frames"),
        ],
        exits: &[
            (Exit::Whole, "recognised; what is wrong with it is told"),
            PRINTED,
            (Exit::Before, "no data set that is known, or no such folder"),
        ],
    },
    Ending {
        command: "plan",
        examples: &[
            ("plan experiments/table1.yaml", "stereo is run once for all variants"),
            ("plan first.yaml --reuse --set look.stereo.with.block=7", "what a run would take from earlier ones"),
        ],
        exits: &[WHOLE, PRINTED, WRONG],
    },
    Ending {
        command: "graph",
        examples: &[
            ("graph first.yaml", "Mermaid, for a Markdown file on GitHub"),
            ("graph first.yaml --format dot | dot -Tsvg > graph.svg", "Graphviz"),
            ("graph first.yaml --json | jq '.edges[]'", "for programs"),
        ],
        exits: &[WHOLE, PRINTED, WRONG],
    },
    Ending {
        command: "dora",
        examples: &[
            (
                "dora first.yaml --out look > dataflow.yml",
                "then `dora run dataflow.yml`: every node a process, the same recording",
            ),
            ("dora first.yaml --machine '*.mono=jetson' > dataflow.yml", "and one of them on another machine"),
        ],
        exits: &[WHOLE, PRINTED, WRONG],
    },
    Ending {
        command: "report",
        examples: &[
            ("report runs/first/2026-11-21T08-30-05Z", "its tables and plots again"),
            ("report look.partial --out salvaged", "of a run that did not come to its end"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the analysis or the disk failed"),
            (Exit::Before, "there is no recording, or an argument is wrong"),
            (Exit::Frames, "the recording is damaged; the report is of what can be read"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "table",
        examples: &[
            ("table RUN --sort d1 --top 10 --columns d1,epe,density,ms", "the ten best settings"),
            ("table RUN --effects abs_rel", "what each axis did, and how much of it"),
            ("table RUN --best-per-zone abs_rel", "which setting is best where"),
            ("table RUN --effects ms", "what each axis costs"),
            ("table RUN --pareto abs_rel,ms", "what is worth its time"),
            ("table RUN --top 8 --format latex --out variants.tex", "for a paper"),
        ],
        exits: ASKED,
    },
    Ending {
        command: "compare",
        examples: &[
            ("compare RUN full no_scaling", "a variant against another, all scores"),
            (
                "compare RUN '*/fused' --scores abs_rel --baseline best",
                "which are as good as the best, and which are not",
            ),
            ("compare table1/2026-11-20 @latest", "is the newest run better than that of another day?"),
            (
                "compare RUN stereo full/mono --by distance",
                "where each is better, and where one hands over to the other",
            ),
            ("compare main pr --fail-if 'fused.abs_rel > +1%'", "for CI: exit code 3 if it is worse"),
            ("compare A:full/fused B:fused --set answered --json", "for programs"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the analysis failed, or the output could not be written"),
            (Exit::Before, "there is no recording, nothing to compare, a limit is on nothing, or an argument is wrong"),
            (Exit::Frames, "what --fail-if says is so, or a recording is damaged where a number would come from"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "analyse",
        examples: &[
            ("analyse @latest", "error against distance, a metre a bin"),
            (
                "analyse @latest --bins log:12 --estimators '*/fused' --set common",
                "of some estimators, on the pixels that all of them answered",
            ),
            ("analyse @latest --by weight --percentiles 50,95", "is a higher weight a smaller error?"),
            ("analyse one two --by frame --format csv --out frames.csv", "two runs, frame by frame"),
        ],
        exits: ASKED,
    },
    Ending {
        command: "figure",
        examples: &[
            ("figure @latest error-vs-distance --out error.pdf", "the paper's figure, two columns wide"),
            (
                "figure RUN difference --estimators stereo,full/mono --width one-column --out where.svg",
                "where mono hands over to stereo",
            ),
            ("figure RUN parameter --axes block,p1 --score abs_rel --out sweep.png --dpi 600", "of a matrix"),
            ("figure RUN panels --frames 0,3 --out frames.png --data frames.csv", "frames as the paper shows them"),
        ],
        exits: ASKED,
    },
    Ending {
        command: "samples",
        examples: &[
            ("samples @latest", "samples.parquet into the run's folder"),
            ("samples RUN --out /data/samples.parquet", "elsewhere"),
        ],
        exits: ASKED,
    },
    Ending {
        command: "explain",
        examples: &[
            ("explain RUN abs_rel full/fused", "formula, pixels, frames, source, the paper's convention"),
            ("explain RUN rmse fused --set answered --json", "for programs"),
        ],
        exits: ASKED,
    },
    Ending {
        command: "export",
        examples: &[
            ("export RUN depth --out depths", "each frame's depth as a 16-bit PNG, as KITTI has them"),
            (
                "export RUN depth/depth --format npy,pfm --frames 3,7 --out arrays",
                "the floats themselves, of two frames",
            ),
            ("export RUN 'fused*' --colormap turbo --range 0..40 --out look", "in colours, for a figure"),
            ("export RUN depth --format ply --range 0..60 --out clouds", "points up to 60 m, coloured by the image"),
            ("export RUN --out all --json | jq '.topics[]'", "everything; for programs"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the disk failed, or a value cannot be exported so; files that are there are whole"),
            (Exit::Before, "there is no recording, a file is in the way, or an argument is wrong"),
            (Exit::Frames, "the recording is damaged; what can be read was exported"),
            (Exit::Interrupted, "interrupted; files that are there are whole"),
        ],
    },
    Ending {
        command: "timings",
        examples: &[("timings runs/first/2026-11-21T08-30-05Z", "what to make faster")],
        exits: &[WHOLE, PRINTED, (Exit::Before, "there are no timings, or an argument is wrong")],
    },
    Ending {
        command: "info",
        examples: &[
            ("info @latest", "topics with their sizes and recipes"),
            ("info copied.mcap --check", "is every byte what was written?"),
            ("info RUN --keys --json | jq -r '.keys[].key' | sort -u", "for programs"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the disk failed, or the output could not be written"),
            (Exit::Before, "there is no recording, or an argument is wrong"),
            (Exit::Frames, "the recording is damaged"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "replay",
        examples: &[
            ("replay RUN --check", "every node whose values and inputs are recorded"),
            ("replay RUN --check compare.fused --tolerance depth=0.001", "one node, to a millimetre"),
            ("replay RUN --check --json | jq '.nodes[] | select(.different > 0)'", "for programs"),
        ],
        exits: &[
            (Exit::Whole, "all that could be compared is equal"),
            (Exit::Engine, "learning or the engine failed, or the output could not be written"),
            (Exit::Before, "nothing can be compared, a named node cannot be made again, or an argument is wrong"),
            (Exit::Frames, "values differ, or the recording is damaged where they would be read"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "recover",
        examples: &[("recover runs/first/2026-11-21T08-30-05Z.partial", "what a killed run left, for any MCAP reader")],
        exits: &[
            WHOLE,
            (Exit::Engine, "the disk failed"),
            (Exit::Before, "nothing was committed, the output exists, or an argument is wrong"),
        ],
    },
    Ending {
        command: "runs",
        examples: &[
            ("runs", "all runs below `runs`"),
            (
                "report @latest",
                "the newest that is over, wherever a run is wanted; `table1/@latest`: of those in runs/table1",
            ),
            ("table table1/2026-11-21", "or the beginning of its name, if no other's begins so"),
            ("runs why table1/2026-11-20 @latest", "which node is another since, and why"),
            ("runs prune --keep 3 --dry-run", "what would go if three of each experiment stayed"),
            ("runs --in /data/runs --json | jq -r '.runs[] | select(.state != \"whole\").path'", "for programs"),
        ],
        exits: RUNS_READ,
    },
    Ending {
        command: "runs show",
        examples: &[
            ("runs show @latest", "the newest that is over"),
            ("runs show look.partial --json | jq .stages", "for programs"),
        ],
        exits: RUN_READ,
    },
    Ending {
        command: "runs why",
        examples: &[
            ("runs why table1/2026-11-20 table1/@latest", "what is another since that day, and why"),
            (
                "runs why A B --json | jq -r '.nodes[] | select(.same | not) | .node'",
                "for programs: the nodes whose values differ",
            ),
        ],
        exits: RUN_READ,
    },
    Ending {
        command: "runs rm",
        examples: &[
            ("runs rm look.partial", "what a run left that ended before it was whole"),
            ("runs rm table1/2026-11-20 table1/2026-11-21", "several"),
        ],
        exits: RUNS_REMOVED,
    },
    Ending {
        command: "runs prune",
        examples: &[
            ("runs prune --keep 3 --dry-run", "all but the newest three of each experiment: what would go"),
            ("runs prune --older-than 30d --keep 1", "what is older than 30 days, but never an experiment's last"),
            ("runs prune --max-size 100GB --unfinished", "the unfinished, then the oldest until the rest fits"),
        ],
        exits: RUNS_REMOVED,
    },
    Ending {
        command: "runs list",
        examples: &[("runs list --in /data/runs", "the runs below another folder")],
        exits: RUNS_READ,
    },
    Ending {
        command: "nodes",
        examples: &[
            ("nodes", "all kinds, with a sentence each"),
            ("nodes stereo/sgbm", "one kind: ports and parameters"),
            ("nodes learn/ssl --json | jq .parameters", "for programs"),
        ],
        exits: &[WHOLE, PRINTED, (Exit::Before, "there is no such kind, or an argument is wrong")],
    },
    Ending {
        command: "onnx",
        examples: &[
            ("onnx raft-stereo.onnx", "inputs, outputs, operators, cost; the lines for an experiment"),
            ("onnx net.onnx --json | jq .operators", "for programs"),
        ],
        exits: &[WHOLE, PRINTED, (Exit::Before, "the file is no ONNX model, or an argument is wrong")],
    },
    Ending {
        command: "synth",
        examples: &[("synth street --frames 40 --seed 7", "40 frames, the ground truth with them")],
        exits: &[
            WHOLE,
            (Exit::Engine, "the disk failed"),
            (Exit::Before, "the folder exists, or an argument is wrong"),
            INTERRUPTED,
        ],
    },
    Ending {
        command: "doctor",
        examples: &[("doctor --json | jq .networks.engine", "for programs")],
        exits: &[WHOLE, PRINTED, ARGUMENT],
    },
    Ending {
        command: "new",
        examples: &[("new first.yaml", "then: depthloom run first.yaml")],
        exits: &[WHOLE, PRINTED, (Exit::Before, "the file exists or cannot be written, or an argument is wrong")],
    },
    Ending {
        command: "schema",
        examples: &[
            ("schema > experiment.schema.json", "an experiment names it in its first line"),
            ("schema --output run", "what `run --json` prints"),
        ],
        exits: &[WHOLE, PRINTED, ARGUMENT],
    },
    Ending {
        command: "completions",
        examples: &[
            ("completions bash", "bash, in ~/.bashrc: source <(depthloom completions bash)"),
            ("completions zsh", "zsh, in ~/.zshrc behind compinit: source <(depthloom completions zsh)"),
            ("completions fish", "fish, in ~/.config/fish/config.fish: depthloom completions fish | source"),
        ],
        exits: &[WHOLE, PRINTED, ARGUMENT],
    },
    Ending {
        command: "man",
        examples: &[
            ("man run | man -l -", "read the page of a command"),
            ("man --out ~/.local/share/man/man1", "install all: then `man depthloom-run` finds them"),
        ],
        exits: &[
            WHOLE,
            (Exit::Engine, "the pages could not be written"),
            (Exit::Before, "there is no such command, or an argument is wrong"),
        ],
    },
];

impl Ending {
    /// The end of a command's help; of one that has none, nothing.
    pub fn of(command: &str) -> &'static Self {
        const NONE: Ending = Ending { command: "", examples: &[], exits: &[] };
        ENDINGS.iter().find(|ending| ending.command == command).unwrap_or(&NONE)
    }

    /// As text below the options.
    pub fn text(&self) -> String {
        let mut text = String::new();
        if !self.examples.is_empty() {
            text.push_str("Examples:\n");
        }
        for (arguments, about) in self.examples {
            let _ = writeln!(text, "  depthloom {arguments}\n          {about}");
        }
        if !self.exits.is_empty() {
            text.push_str("\nExit codes:\n");
        }
        for (exit, about) in self.exits {
            let _ = writeln!(text, "  {:<4}  {about}", *exit as u8);
        }
        text.trim().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Cli;
    use clap::CommandFactory as _;

    #[test]
    fn every_command_has_an_ending_and_every_ending_a_command() {
        fn names(command: &clap::Command, name: &str) -> Vec<String> {
            let below = command.get_subcommands().filter(|sub| !sub.is_hide_set());
            let below = below.flat_map(|sub| names(sub, format!("{name} {}", sub.get_name()).trim_start()));
            std::iter::once(name.to_owned()).chain(below).collect()
        }
        let mut commands = names(&Cli::command(), "");
        let mut endings: Vec<&str> = ENDINGS.iter().map(|ending| ending.command).collect();
        commands.sort_unstable();
        endings.sort_unstable();
        assert_eq!(endings, commands);
    }
}
