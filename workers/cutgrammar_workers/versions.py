"""The versions of all that can change the result of a trial, as a worker finds them in its own process.

Packages of a remote node may have other versions than those of the driver, and code that was sent to a node has no
version at all: source code is known by its digest.
"""

import hashlib
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

LIBRARIES = ("numpy", "scipy", "numba", "torch", "manifold3d", "sapien")
"""Packages whose versions can change a result in its last digits or more."""
PACKAGES = ("cutgrammar", "cutgrammar_sim", "cutgrammar_workers")
"""Our packages whose code can change a result."""
MAX_FILES = 2000
"""A package with more source files is known by those that come first."""
ABSENT = "not installed"


def versions_here(references: Mapping[str, str]) -> dict[str, str]:
    """Name -> version of our code, of the libraries, and of the plugins among `references`.

    Args:
        references: name -> "module:attribute" of methods, worlds and scores.
    """
    found = {name: _version(name) for name in LIBRARIES}
    found["code"] = " ".join(source_digest(name) for name in PACKAGES)
    for name, reference in references.items():
        package = reference.partition(":")[0].partition(".")[0]
        if package not in PACKAGES:
            found[f"code of {name}"] = source_digest(package)
    return found


def source_digest(package: str) -> str:
    """The first digits of the sha256 of a package's or module's Python files; "unknown" where it has none."""
    try:
        spec = find_spec(package)
    except ValueError:  # a module that was made without one, as __main__
        return "unknown"
    if spec is None:
        return ABSENT
    places = [Path(place) for place in spec.submodule_search_locations or ()]
    files = [(file, file.relative_to(place)) for place in places for file in _python_files(place)]
    if not files and spec.origin is not None and spec.origin.endswith(".py"):
        files = [(Path(spec.origin), Path(Path(spec.origin).name))]
    digest = hashlib.sha256()
    for file, name in files:
        digest.update(f"{name.as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()[:12] if files else "unknown"


def _python_files(folder: Path) -> Iterable[Path]:
    return sorted(folder.rglob("*.py"))[:MAX_FILES]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ABSENT
