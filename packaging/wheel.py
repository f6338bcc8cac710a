#!/usr/bin/env python3
"""Makes the wheel of a program that is built already, in seconds: tests and `bench/newcomer.sh` use it.

    python3 packaging/wheel.py PROGRAM FOLDER

maturin makes the wheel as for a release, from `pyproject.toml`. Only its call of `cargo rustc` is replaced: it receives
a copy of PROGRAM without symbols, as it would receive what cargo has built. Run it with a Python that has maturin.
Prints the path of the wheel.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: Stands for cargo: reports the program as built, and passes everything else to the cargo of this machine.
CARGO = """#!/bin/sh
if [ "$1" = rustc ]; then
    cat '{messages}'
else
    exec '{cargo}' "$@"
fi
"""


def messages(program: Path) -> str:
    """What `cargo rustc --message-format json` prints after it has built the program."""
    metadata = ["cargo", "metadata", "--no-deps", "--offline", "--format-version", "1"]
    packages = json.loads(subprocess.run(metadata, cwd=ROOT, check=True, capture_output=True, text=True).stdout)["packages"]
    (package,) = (package for package in packages if package["name"] == "depthloom")
    (target,) = (target for target in package["targets"] if target["kind"] == ["bin"])
    artifact = {
        "reason": "compiler-artifact",
        "package_id": package["id"],
        "manifest_path": package["manifest_path"],
        "target": target,
        "profile": {"opt_level": "3", "debuginfo": 0, "debug_assertions": False, "overflow_checks": False, "test": False},
        "features": ["default", "tract"],
        "filenames": [str(program)],
        "executable": str(program),
        "fresh": True,
    }
    return "\n".join(json.dumps(message) for message in (artifact, {"reason": "build-finished", "success": True}))


def main() -> None:
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} PROGRAM FOLDER")
    built, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    cargo = shutil.which("cargo")
    if cargo is None:
        sys.exit("there is no `cargo` on the PATH: maturin reads the package's version with it")
    with tempfile.TemporaryDirectory() as work:
        program, wheels = Path(work, "depthloom"), Path(work, "wheels")
        subprocess.run(["strip", "-o", program, built], check=True)
        Path(work, "messages").write_text(messages(program))
        shim = Path(work, "bin/cargo")
        shim.parent.mkdir()
        shim.write_text(CARGO.format(messages=Path(work, "messages"), cargo=cargo))
        shim.chmod(0o755)
        # `cargo test` sets CARGO, which maturin prefers to the PATH.
        environment = {**os.environ, "CARGO": str(shim), "PATH": f"{shim.parent}{os.pathsep}{os.environ['PATH']}"}
        build = [sys.executable, "-m", "maturin", "build", "--release", "--out", str(wheels)]
        done = subprocess.run(build, cwd=ROOT, env=environment, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"maturin failed: {done.stderr}")
        (wheel,) = wheels.glob("*.whl")
        folder.mkdir(parents=True, exist_ok=True)
        print(shutil.move(wheel, folder / wheel.name))


if __name__ == "__main__":
    main()
