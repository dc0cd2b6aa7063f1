"""Hostile JSON: what every reader of JSON is given, and what only one is."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hostile.cases import Case, bytes_case, json_case

ESCAPE = "\x1b[2J\x1b]0;owned\x07\x9b1m\u202e"
"""Clears a terminal, renames its window and reverses text."""
FILES = {
    "manifest": "data/manifest.json",
    "split": "data/splits/share.json",
    "model": "model/model.json",
    "grammar": "model/grammar.json",
    "run": "run/run.json",
}
DEEP = 100_000


def document_cases() -> Iterator[Case]:
    """What is hostile in any JSON file."""
    for reader, file in FILES.items():
        for name, content in (
            ("nested lists", b"[" * DEEP + b"]" * DEEP),
            ("nested objects", b'{"a":' * DEEP + b"1" + b"}" * DEEP),
            ("nested 900 deep", b"[" * 900 + b"]" * 900),
            ("an integer of 5,000 digits", b"9" * 5000),
            ("NaN", b"NaN"),
            ("empty", b""),
            ("null", b"null"),
            ("a list", b"[]"),
            ("text", b'"' + b"a" * 3_000_000 + b'"'),
            ("no UTF-8", b'{"schema": "\xff\xfe"}'),
            ("UTF-16", '{"schema": 1}'.encode("utf-16")),
            ("zeros", bytes(1000)),
        ):
            yield bytes_case(reader, file, name, content)
        yield bytes_case(
            reader, file, "a value of 5,000 digits", lambda old: old.replace(b"{", b'{"x": ' + b"9" * 5000 + b",", 1)
        )
        yield bytes_case(
            reader, file, "a deep value", lambda old: old.replace(b"{", b'{"x": ' + b"[" * 5000 + b"]" * 5000 + b",", 1)
        )
        yield bytes_case(reader, file, "an unknown NaN", lambda old: old.replace(b"{", b'{"x": NaN,', 1))
        yield bytes_case(reader, file, "a lone surrogate", lambda old: old.replace(b"{", b'{"\\ud800": 1,', 1))
        yield bytes_case(
            reader,
            file,
            "an unknown name with escapes",
            lambda old: old.replace(b"{", b'{"\\u001b[2J": 1,', 1),
            named=(),
        )
        yield Case(reader, f"{file} is a FIFO", lambda folder, file=file: _fifo(folder / file), [Path(file).name])
        yield Case(reader, f"{file} is a folder", lambda folder, file=file: _folder(folder / file), [Path(file).name])
        yield Case(
            reader, f"{file} is endless", lambda folder, file=file: _link(folder / file, "/dev/zero"), [Path(file).name]
        )
        yield Case(reader, f"{file} is 20 GB", lambda folder, file=file: _sparse(folder / file), [Path(file).name])
        yield Case(
            reader, f"{file} links to itself", lambda folder, file=file: _link(folder / file, Path(file).name), []
        )
        if reader != "grammar":
            for value in (None, "1", 1.5, -1, 10**400, [1], True):
                yield json_case(reader, file, ["schema"], value)


def value_cases() -> Iterator[Case]:
    """Values that only one file has."""
    file = FILES["manifest"]
    for path, value in (
        (["seed"], "7"),
        (["seed"], -1),
        (["seed"], 1.5),
        (["seed"], 2**70),
        (["seed"], ESCAPE),
        (["settings"], []),
        (["settings", "offset_error"], "x"),
        (["settings", "offset_error"], 1e9),
        (["settings", "unknown"], 1),
        (["foods"], []),
        (["foods"], {ESCAPE: "x"}),
        (["foods"], {"a": 5}),
        (["foods"], None),
        (["definition"], 7),
        (["sources"], {}),
        (["sources"], [{}]),
        (["sources"], [{"digest": 5}]),
        (["parts"], {}),
        (["parts"], []),
        (["parts"], None),
        (["parts"], [None]),
        (["parts"], ...),
        (["parts", 0, "number"], -1),
        (["parts", 0, "number"], "../../../etc"),
        (["parts", 0, "number"], 10**9),
        (["parts", 0, "number"], 0.5),
        (["parts", 0, "trials"], "012345"),
        (["parts", 0, "trials"], [0, 0]),
        (["parts", 0, "trials"], [5, 4, 3, 2, 1, 0]),
        (["parts", 0, "trials"], [0.5]),
        (["parts", 0, "trials"], [2**31]),
        (["parts", 0, "trials"], [-1]),
        (["parts", 0, "trials"], []),
    ):
        yield json_case("manifest", file, path, value)
    yield json_case("manifest", file, ["cutgrammar"], ESCAPE, ())
    for path, value in (
        (["parts", 0, "sha256"], None),
        (["parts", 0, "sha256", "cuts"], 7),
        (["parts", 0, "sha256", "cuts"], "zz"),
        (["parts", 0, "sha256", "cuts"], ...),
    ):
        yield Case(
            "manifest",
            f"sha256: {value!r}",
            lambda folder, file=file, path=path, value=value: _unsigned(folder / file, path, value),
            ["manifest.json", "sha256"],
        )
    yield Case(
        "manifest",
        "two parts of one number",
        lambda folder, file=file: _twice(folder / file),
        ["manifest.json", "number"],
    )
    file = FILES["split"]
    for path, value in (
        (["train"], None),
        (["train"], "01"),
        (["train"], [0, "1"]),
        (["train"], [0, 0]),
        (["train"], [99]),
        (["train"], [True]),
        (["train"], [-1]),
        (["train"], [10**400]),
        (["train"], []),
        (["test"], []),
        (["rule"], None),
        (["rule"], ESCAPE),
        (["rule"], 5),
        (["data"], 5),
        (["data"], None),
        (["train"], ...),
    ):
        options = {"named": [Path(file).name]} if value in ([0, 0], [99]) else {}
        yield json_case("split", file, path, value, **options)
    yield Case(
        "split",
        "a split called with escapes",
        lambda folder, file=file: (folder / file).rename(folder / f"data/splits/a{chr(27)}[2J.json"),
        ["split"],
    )
    file = FILES["model"]
    for path, value in (
        (["settings", "features", "hidden_size"], 10**9),
        (["settings", "features", "n_points"], 10**12),
        (["settings", "search", "max_rounds"], 10**300),
        (["settings", "features"], None),
        (["settings", "features", "hidden_size"], "8"),
        (["settings", "features", "unknown"], 1),
        (["settings", "kinova", "urdf"], 7),
        (["settings", "planes", "min_sigma"], -1),
        (["metrics", "x"], "1"),
        (["metrics", "x"], None),
        (["metrics"], []),
        (["metrics", "x"], [1]),
        (["provenance", "data"], 5),
        (["provenance", "trials"], "01"),
        (["provenance", "trials"], ["x"]),
        (["provenance", "trials"], [-1]),
        (["provenance", "seed"], "x"),
        (["provenance", "seed"], -1),
        (["provenance", "split"], ESCAPE),
        (["provenance", "split"], "../../x"),
        (["provenance", "package"], 7),
        (["provenance", "unknown"], 7),
        (["provenance", "split_digest"], ...),
        (["files", "grammar.json"], 7),
        (["files", "../../etc/passwd"], "0" * 64),
        (["files"], {}),
    ):
        yield json_case("model", file, path, value)
    yield json_case("model", file, ["metrics", ESCAPE], 1.0, ())
    file = FILES["grammar"]
    for path, value in (
        (["k"], 10**9),
        (["k"], -1),
        (["k"], "3"),
        (["k"], 3.0),
        (["k"], None),
        (["frequencies"], "abc"),
        (["frequencies", 0], "1"),
        (["frequencies", 0], -1),
        (["frequencies", 0], 5),
        (["frequencies"], []),
        (["productions"], {}),
        (["productions"], []),
        (["productions", 0, "parent"], 99),
        (["productions", 0, "parent"], -1),
        (["productions", 0, "children"], []),
        (["productions", 0, "children"], [0] * 100_000),
        (["productions", 0, "children"], "01"),
        (["productions", 0, "children", 0], 10**30),
        (["productions", 0, "probability"], 2),
        (["productions", 0, "probability"], -0.5),
        (["productions", 0, "probability"], "1"),
        (["productions", 0, "probability"], None),
        (["productions", 0], None),
        (["induction"], None),
        (["induction"], []),
        (["induction"], ...),
        (["induction", "type_means"], "x"),
        (["induction", "type_means"], [[1]]),
        (["induction", "type_statistics"], []),
        (["induction", "type_statistics", "whole"], [5.0]),
        (["induction", "type_statistics", "whole"], ...),
        (["induction", "curve"], 7),
        (["induction", "curve"], [7]),
    ):
        options: dict[str, Any] = {"may_pass": value == [] and path == ["productions"]}
        if value == 99:
            options["named"] = [Path(file).name, "c99"]
        yield json_case("grammar", file, path, value, **options)
    file = FILES["run"]
    for path, value in (
        (["seed"], "x"),
        (["seed"], -1),
        (["settings"], []),
        (["settings", "search", "max_rounds"], -1),
        (["settings", "kinova", "urdf"], 5),
        (["data_digest"], 5),
        (["data_digest"], ESCAPE),
        (["missing"], "01"),
        (["missing"], [None]),
        (["missing"], [2**40]),
        (["split"], "../../x"),
        (["split"], ESCAPE),
        (["split"], None),
        (["split_digest"], 5),
        (["model_digests"], []),
        (["model_digests"], "abc"),
        (["model_digests"], [5]),
        (["models"], []),
        (["models"], [7]),
        (["models"], "ab"),
        (["package"], 5),
        (["package"], ESCAPE),
        (["data"], 5),
        (["data"], "a\x00b"),
        (["commit"], 5),
        (["commit"], ESCAPE),
        (["machine"], None),
        (["machine"], 5),
        (["by_robot"], "no"),
        (["human"], 5),
        (["unknown"], 5),
        (["seed"], ...),
    ):
        options = {"named": [Path(file).name]} if len(path) > 2 else {}
        yield json_case("run", file, path, value, **options)
    yield json_case("run", file, ["machine", "processor"], ESCAPE, (), may_pass=True)


def _fifo(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def _link(file: Path, target: str) -> None:
    file.unlink()
    file.symlink_to(target)


def _sparse(file: Path) -> None:
    with file.open("r+b") as stream:
        stream.truncate(20 * 10**9)


def _unsigned(file: Path, path: list[str | int], value: object) -> None:
    from hostile.cases import put
    from hostile.good import change_json

    change_json(file, lambda tree: put(tree, path, value))


def _twice(file: Path) -> None:
    from hostile.good import change_json

    change_json(file, lambda tree: tree["parts"].append(tree["parts"][0]))
