"""The modules and files that the cache keys of a program contain: its own files by content, installed packages by version."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import marshal
import os
import platform
import re
import sys
import sysconfig

from . import _opened

_INSTALLED = {"site-packages", "dist-packages"}
#: Files that belong to no experiment.
_SHARED = ("/etc/", "/usr/")


class Imports:
    """The imported modules of this process, updated when more are imported."""

    def __init__(self) -> None:
        self._names: set[str] = set()
        #: For each file its name relative to the program, and a hash of its content.
        self._modules: dict[str, tuple[str, str]] = {}
        # With PYTHONOPTIMIZE=1 or -O, assertions of the program do not run.
        optimized = f", optimized ({sys.flags.optimize})" if sys.flags.optimize else ""
        self._packages: dict[str, str] = {"python": platform.python_version() + optimized}
        self._folders = {path: _Installed(path) for path in sys.path if os.path.basename(path) in _INSTALLED}
        self._standard = tuple(
            os.path.abspath(path) + os.sep for path in {sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")} if path
        )
        self._main = _file_of(sys.modules.get("__main__")) or ""
        #: Files that were opened for reading before the program serves. Files that are opened later depend on frames.
        self._opened = _opened.take()
        #: Files that were opened for reading after the program began to serve.
        self._late: set[str] = set()
        self._roots = [os.path.dirname(self._main), *(os.path.abspath(path) for path in sys.path)]

    def news(self) -> str | None:
        """All modules and files as JSON, if there are more than at the previous call."""
        late = {file for file in _opened.take() if self._is_own(file) and file not in self._opened and not file.startswith(_SHARED)}
        is_later = not late <= self._late
        self._late |= late
        if len(sys.modules) == len(self._names) and not is_later:
            return None
        before = (len(self._modules), len(self._packages))
        for name in [name for name in sys.modules if name not in self._names]:
            self._add(name, _file_of(sys.modules.get(name)))
        self._names = set(sys.modules)
        if before == (len(self._modules), len(self._packages)) and not is_later:
            return None
        modules = [{"name": name, "file": file, "hash": content} for file, (name, content) in sorted(self._modules.items())]
        files = [{"name": self._relative(file), "file": file, "hash": _hash(file)} for file in self._opened if self._is_own(file)]
        return json.dumps({"main": self._main, "modules": modules, "packages": self._packages, "files": files, "late": sorted(self._late)})

    def _is_own(self, file: str) -> bool:
        """Whether an opened file belongs to the program: not a reported module, not Python's, and not of an installed package."""
        is_installed = not _INSTALLED.isdisjoint(file.split(os.sep)) or file.startswith(self._standard)
        is_package = file.startswith(os.path.dirname(os.path.abspath(__file__)) + os.sep)
        return not (is_installed or is_package or file == self._main or file in self._modules)

    def _add(self, name: str, file: str | None) -> None:
        if file is None or file in self._modules:
            return
        if _INSTALLED.isdisjoint(file.split(os.sep)):
            if name.partition(".")[0] == __package__:
                # This package, imported from its sources. All of it counts, because it imports its parts on demand.
                folder = os.path.dirname(os.path.abspath(__file__))
                for part in _entries(folder):
                    if part.endswith(".py"):
                        self._add_module(os.path.join(folder, part))
            elif not file.startswith(self._standard):
                self._add_module(file)
            return
        parts = file.split(os.sep)
        at = max(index for index, part in enumerate(parts) if part in _INSTALLED)
        folder = os.sep.join(parts[: at + 1])
        if folder not in self._folders:
            self._folders[folder] = _Installed(folder)
        packages = self._folders[folder].packages_of(parts[at + 1].partition(".")[0])
        if not packages:
            # Its package is unknown.
            self._add_module(file)
        for package in packages:
            self._add_package(package)

    def _add_module(self, file: str) -> None:
        if file not in self._modules:
            self._modules[file] = (self._relative(file), _hash(file) + _other_bytecode(file))

    def _add_package(self, name: str) -> None:
        """Adds an installed package and those that it needs: it may import them at any time."""
        if name in self._packages:
            return
        for folder in self._folders.values():
            if name in folder.versions:
                self._packages[name] = folder.versions[name] + folder.content_of(name)
                for needed in folder.needed_by(name):
                    self._add_package(needed)
                return

    def _relative(self, file: str) -> str:
        """The path of a module relative to the program's folder, or to a folder of Python's search path. It does not depend on where the folder is."""
        for root in self._roots:
            if root and file.startswith(root.rstrip(os.sep) + os.sep):
                return os.path.relpath(file, root)
        return os.path.basename(file)


def _file_of(module: object) -> str | None:
    # Not with `getattr`, which would load lazily loaded modules.
    file = getattr(module, "__dict__", {}).get("__file__")
    return os.path.abspath(file) if isinstance(file, str) and not file.startswith("<") else None


def _other_bytecode(file: str) -> str:
    """A hash of the compiled file in `__pycache__` that Python runs in place of a module, if it was made from another version of the module; otherwise empty."""
    try:
        compiled = importlib.util.cache_from_source(file)
        with open(compiled, "rb") as content:
            data = content.read()
        with open(file, "rb") as content:
            source = content.read()
        flags, state = int.from_bytes(data[4:8], "little"), os.stat(file)
        if data[:4] != importlib.util.MAGIC_NUMBER:
            is_run = False
        elif flags & 1:
            # The compiled file names the hash of its source; bit 1 says whether Python compares it.
            is_run = not flags & 2 or importlib.util.source_hash(source) == data[8:16]
        else:
            compiled_from = (int.from_bytes(data[8:12], "little"), int.from_bytes(data[12:16], "little"))
            is_run = compiled_from == (int(state.st_mtime) & 0xFFFFFFFF, state.st_size & 0xFFFFFFFF)
        if not is_run or marshal.loads(data[16:]) == compile(source, file, "exec", dont_inherit=True):
            return ""
        return ", compiled " + hashlib.sha256(data).hexdigest()
    except (OSError, EOFError, NotImplementedError, SyntaxError, TypeError, ValueError):
        return ""


def _hash(file: str) -> str:
    try:
        digest = hashlib.sha256()
        with open(file, "rb") as content:
            while block := content.read(1 << 20):
                digest.update(block)
        return digest.hexdigest()
    except OSError as error:
        return f"unreadable: {error.strerror}"


class _Installed:
    """The installed packages in a folder. `importlib.metadata` takes a second if there are many."""

    def __init__(self, folder: str) -> None:
        self._infos: dict[str, str] = {}
        self.versions: dict[str, str] = {}
        self._tops: dict[str, list[str]] | None = None
        for entry in _entries(folder):
            stem, ending = os.path.splitext(entry)
            if ending in (".dist-info", ".egg-info"):
                name, version, *_ = [*stem.split("-"), ""]
                self._infos[_normalized(name)] = os.path.join(folder, entry)
                self.versions[_normalized(name)] = version

    def packages_of(self, top: str) -> list[str]:
        """The packages that have a module or a folder of that name."""
        if _normalized(top) in self.versions:
            return [_normalized(top)]
        if self._tops is None:
            self._tops = {}
            for name, info in self._infos.items():
                for its_top in self._tops_of(info):
                    self._tops.setdefault(its_top, []).append(name)
        return sorted(self._tops.get(top, []))

    @staticmethod
    def _tops_of(info: str) -> set[str]:
        listed = _lines(os.path.join(info, "top_level.txt"))
        if listed:
            return set(listed)
        return {line.partition(",")[0].partition("/")[0].partition(".")[0] for line in _lines(os.path.join(info, "RECORD"))}

    def content_of(self, name: str) -> str:
        """A hash of the installed content, from the hashes that the installer recorded, because packages of the same version may differ."""
        digest = hashlib.sha256()
        has_hashes = False
        for line in _lines(os.path.join(self._infos[name], "RECORD")):
            path, _, content = line.partition(",")
            # Scripts and metadata of the installer depend on the place of installation.
            if content.startswith("sha256=") and not path.startswith("..") and ".dist-info/" not in path:
                digest.update(line.encode())
                has_hashes = True
        return f" ({digest.hexdigest()[:16]})" if has_hashes else ""

    def needed_by(self, name: str) -> list[str]:
        needed = []
        for line in _lines(os.path.join(self._infos[name], "METADATA")):
            if not line:
                break
            match = re.match(r"Requires-Dist: ([A-Za-z0-9._-]+)", line)
            if match and "extra ==" not in line:
                needed.append(_normalized(match.group(1)))
        return needed


def _entries(folder: str) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def _lines(file: str) -> list[str]:
    try:
        with open(file, encoding="utf-8", errors="replace") as lines:
            return [line.rstrip() for line in lines]
    except OSError:
        return []


def _normalized(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
