"""What a program reports of its imports."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import json
import os
import py_compile
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from depthloom import _opened
from depthloom._modules import Imports


def test_own_modules_are_reported_by_content_and_installed_ones_by_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_of_test.py").write_text("K = 1\n")
    (tmp_path / "late_of_test.py").write_text("K = 1\n")
    importlib.import_module("own_of_test")
    imports = Imports()
    report = json.loads(imports.news() or "")
    names = {module["name"] for module in report["modules"]}
    assert "own_of_test.py" in names and "late_of_test.py" not in names
    assert not any(name.startswith("json") for name in names), "Python's own modules are not modules of the program"
    assert report["packages"]["numpy"].partition(" ")[0] == np.__version__
    assert imports.news() is None
    importlib.import_module("late_of_test")
    late = {module["name"] for module in json.loads(imports.news() or "")["modules"]}
    assert late - names == {"late_of_test.py"}
    for name in ("own_of_test", "late_of_test"):
        sys.modules.pop(name)


def test_python_without_assertions_is_reported_as_a_different_python() -> None:
    report = "import json; from depthloom._modules import Imports; print(json.loads(Imports().news())['packages']['python'])"
    command = [sys.executable, "-c", report]
    versions = [subprocess.run([*command[:1], *flags, *command[1:]], check=True, capture_output=True, text=True).stdout for flags in ([], ["-O"], ["-OO"])]
    assert len(set(versions)) == 3


def test_files_that_were_opened_before_serving_are_reported_by_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["settings.json", "weights.npy", "written.txt", "late.json"]
    for name in names:
        (tmp_path / name).write_bytes(b"1")
    monkeypatch.setattr(_opened, "_read", set())
    _opened.watch()
    (tmp_path / "settings.json").read_text()
    with open(tmp_path / "written.txt", "a") as written:
        written.write("2")
    (tmp_path / "written.txt").read_text()
    os.close(os.open(tmp_path / "weights.npy", os.O_RDONLY))
    imports = Imports()
    (tmp_path / "late.json").read_text()
    files = json.loads(imports.news() or "")["files"]
    assert {file["name"] for file in files} == {"settings.json", "weights.npy"}
    assert {file["hash"] for file in files} == {hashlib.sha256(b"1").hexdigest()}


def test_files_opened_for_writing_but_unchanged_count_as_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_opened, "_read", set())
    for name in ("read", "changed"):
        (tmp_path / name).write_text("1")
    _opened.watch()
    for name, more in (("read", ""), ("changed", "2")):
        with open(tmp_path / name, "r+") as file:
            file.write(file.read() + more if more else "")
    assert [os.path.basename(file) for file in _opened.take() if file.startswith(str(tmp_path))] == ["read"]


def test_a_file_opened_later_is_reported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_opened, "_read", set())
    (tmp_path / "late.txt").write_text("1")
    imports = Imports()
    imports.news()
    _opened.watch()
    (tmp_path / "late.txt").read_text()
    assert [os.path.basename(file) for file in json.loads(imports.news() or "{}")["late"]] == ["late.txt"]
    _opened.watch()
    (tmp_path / "late.txt").read_text()
    assert imports.news() is None


def test_compiled_files_that_run_instead_of_a_module_are_hashed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    module = tmp_path / "compiled_of_test.py"

    def reported() -> str:
        importlib.invalidate_caches()
        importlib.import_module("compiled_of_test")
        modules = json.loads(Imports().news() or "")["modules"]
        sys.modules.pop("compiled_of_test")
        return str(next(of["hash"] for of in modules if of["name"] == "compiled_of_test.py"))

    module.write_text("K = 1.3\n")
    plain = reported()
    py_compile.compile(str(module))
    assert reported() == plain, "it was made from the module as it is"
    module.write_text("K = 1.0\n")
    py_compile.compile(str(module), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    module.write_text("K = 1.3\n")
    assert reported() != plain


def test_modules_in_archives_and_removed_modules_count_as_opened_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_opened, "_read", set())
    with zipfile.ZipFile(tmp_path / "archive.zip", "w") as archive:
        archive.writestr("of_archive.py", "K = 1\n")
    (tmp_path / "by_path.py").write_text("K = 1\n")
    _opened.watch()
    monkeypatch.syspath_prepend(tmp_path / "archive.zip")
    importlib.import_module("of_archive")
    spec = importlib.util.spec_from_file_location("by_path", tmp_path / "by_path.py")
    assert spec is not None and spec.loader is not None
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    names = {file["name"] for file in json.loads(Imports().news() or "")["files"]}
    assert {"archive.zip", "by_path.py"} <= names
    sys.modules.pop("of_archive")
