#!/usr/bin/env python3
"""Prints the licences of all crates in the program, which must accompany it: those of the sources that cargo has downloaded.

    python3 packaging/licences.py [TARGET] > LICENSE-THIRD-PARTY

TARGET is the platform of the program, by default that of this machine. Wheel, archive and image contain every file
`LICENSE-*` of the root.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: What the program contains besides crates.
EMBEDDED = {"DejaVu Sans (in figures)": "crates/figures/fonts", "uPlot (in report.html)": "crates/figures/src/page"}
NAMES = ("license", "licence", "copying", "notice", "copyright", "unlicense")


def run(*command: str) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def texts(folder: Path) -> list[str]:
    """The licences in a folder, or in its folders `LICENSES`."""
    files = sorted(path for path in folder.rglob("*") if len(path.relative_to(folder).parts) <= 2 and path.is_file())
    named = [path for path in files if any(name in path.name.lower() for name in NAMES) and path.suffix.lower() not in (".rs", ".py")]
    return [path.read_text(errors="replace").strip() for path in named]


def linked(target: str) -> list[dict[str, Any]]:
    """The crates of others that the program is linked with, sorted. `cargo metadata` alone does not know the features."""
    tree = run("cargo", "tree", "--locked", "--package", "depthloom", "--edges", "normal,no-proc-macro", "--target", target, "--prefix", "none")
    names = {tuple(line.split()[:2]) for line in tree.splitlines() if line}
    packages = json.loads(run("cargo", "metadata", "--locked", "--format-version", "1"))["packages"]
    found = [package for package in packages if package["source"] and (package["name"], f"v{package['version']}") in names]
    return sorted(found, key=lambda package: (package["name"], package["version"]))


def main() -> None:
    host = next(line.removeprefix("host: ") for line in run("rustc", "-vV").splitlines() if line.startswith("host: "))
    target = sys.argv[1] if len(sys.argv) > 1 else host
    users: dict[str, list[str]] = defaultdict(list)
    without = []
    for package in linked(target):
        found = texts(Path(package["manifest_path"]).parent)
        name = f"{package['name']} {package['version']} ({package['license']})"
        for text in found:
            users[text].append(name)
        if not found:
            without.append(name)
    for name, folder in EMBEDDED.items():
        for text in texts(ROOT / folder):
            users[text].append(name)
    parts = [f"depthloom contains the work of others, under these licences. Target: {target}.\n"]
    if without:
        parts.append("Without a text in their sources; the identifiers are of spdx.org/licenses:\n" + "\n".join(f"- {name}" for name in without) + "\n")
    parts += ["\n".join(f"- {name}" for name in names) + f"\n\n{text}\n" for text, names in sorted(users.items(), key=lambda entry: entry[1])]
    rule = "\n" + "-" * 80 + "\n\n"
    print(rule.join(parts), end="")


if __name__ == "__main__":
    main()
