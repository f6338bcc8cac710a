"""What a program reports of its imports."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest

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
    assert not any(name.startswith("json") for name in names), "Python's own modules are no modules of the program"
    assert report["packages"]["numpy"] == np.__version__
    assert imports.news() is None
    importlib.import_module("late_of_test")
    late = {module["name"] for module in json.loads(imports.news() or "")["modules"]}
    assert late - names == {"late_of_test.py"}
    for name in ("own_of_test", "late_of_test"):
        sys.modules.pop(name)
