"""Runs benchmarks, and records their ratios by processor in results.json and README.md.

    python3 bench/record.py SCRIPT [ARGUMENT...]    runs bench/SCRIPT.sh, and records its lines `ratio NAME VALUE`
    python3 bench/record.py --check                 fails if README.md is not that of results.json

A ratio is the peer's time divided by ours. Only ratios of one run can be compared; the last of each processor is kept.
"""

import datetime
import json
import os
import pathlib
import platform
import re
import subprocess
import sys

FOLDER = pathlib.Path(__file__).parent
RESULTS, PAGE = FOLDER / "results.json", FOLDER / "README.md"
HEAD = """# Benchmarks

Each script installs its peer into a private virtual environment, runs ours and theirs in turn, and prints lines
`ratio NAME VALUE`: the peer's time divided by ours, over 1 where depthloom is faster. What a script measures is at its head.

The last ratios of each processor. Machines differ, and so do neighbours on a shared machine: compare within one line only.
`python3 bench/record.py SCRIPT` runs a script and writes this page.
"""


def processor():
    try:
        models = re.findall(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text())
    except OSError:
        models = []
    return f"{models[0] if models else platform.processor() or 'unknown processor'}, {os.cpu_count()} threads"


def page(results):
    text = HEAD
    for name, ratios in sorted(results.items()):
        text += f"\n## {name}\n| ratio | value | script | date | commit |\n|---|---|---|---|---|\n"
        for ratio, row in sorted(ratios.items()):
            text += f"| `{ratio}` | {row['value']} | `{row['script']}` | {row['date']} | {row['commit']} |\n"
    return text


def main(arguments):
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    if arguments == ["--check"]:
        if PAGE.read_text() != page(results):
            sys.exit(f"{PAGE} is not that of {RESULTS}: run `python3 bench/record.py`")
        return
    if arguments:
        script = " ".join(arguments)
        run = subprocess.Popen(["bash", FOLDER / f"{arguments[0]}.sh", *arguments[1:]], stdout=subprocess.PIPE, text=True)
        found = {}
        for line in run.stdout:
            print(line, end="", flush=True)
            if match := re.fullmatch(r"ratio (\S+) ([0-9.]+)\s*", line):
                found[match[1]] = match[2]
        if run.wait() != 0 or not found:
            sys.exit(f"bench/{arguments[0]}.sh failed or printed no ratio")
        commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=FOLDER, capture_output=True, text=True, check=True)
        row = dict(script=script, date=str(datetime.date.today()), commit=commit.stdout.strip())
        ratios = results.setdefault(processor(), {})
        for ratio, value in found.items():
            ratios[ratio] = dict(value=value, **row)
    RESULTS.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n")
    PAGE.write_text(page(results))


main(sys.argv[1:])
