"""A parser module made of lines of code, run as a process."""

import textwrap

import pytest

from cutgrammar.untrusted.parser_processes import run_parser

MODULE = """
import os, resource, signal, subprocess, sys, time
from cutgrammar.untrusted.parser_processes import limit_this_process
{imported}

def main():
    limit_this_process()
{code}

if __name__ == "__main__":
    sys.exit(main())
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Makes `parser_of_a_test`, of code and of code for its import; once a test, since its template keeps it."""
    folder = tmp_path / "modules"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)

    def write(code, imported=""):
        text = MODULE.format(imported=textwrap.dedent(imported), code=textwrap.indent(textwrap.dedent(code), "    "))
        file = folder / "parser_of_a_test.py"
        assert not file.exists() or file.read_text() == text
        file.write_text(text)

    return write


@pytest.fixture
def parser(write):
    """Runs code as a parser, with `data` on stdin."""

    def run(code, *given, imported="", data=b"data"):
        write(code, imported)
        return run_parser("parser_of_a_test", ("word",), data, *given)

    return run
