"""What becomes of a process that parses: its output, its refusal, its death."""

import pytest

from cutgrammar.untrusted.parser_processes import REFUSED, run_parser

BEGIN = "import os, sys\nfrom cutgrammar.untrusted.parser_processes import limit_this_process\nlimit_this_process()\n"


@pytest.fixture
def parser(tmp_path, monkeypatch):
    """Makes a module of lines of code and runs it as a process."""
    monkeypatch.syspath_prepend(tmp_path)

    def run(code, *given):
        (tmp_path / "parser_of_a_test.py").write_text(BEGIN + code)
        return run_parser("parser_of_a_test", ("word",), b"data", *given)

    return run


def test_the_output_of_a_parser_is_what_it_makes_of_the_data(parser):
    answer = parser("print(sys.argv[1], sys.stdin.read(), end='')")
    assert (answer.code, answer.output, answer.message) == (0, b"word data", "")


def test_the_reason_of_a_refusal_is_the_last_line(parser):
    answer = parser(f"sys.exit(print('a warning\\nis empty', file=sys.stderr) or {REFUSED})")
    assert (answer.code, answer.reason) == (REFUSED, "is empty")


@pytest.mark.parametrize("code", ["os.abort()", "bytearray(5 * 2**30)"])
def test_the_death_of_a_parser_is_an_answer(parser, code):
    answer = parser(code)
    assert answer.code != 0
    assert answer.reason == "it ends the process that reads it, or never lets it end"


def test_a_parser_that_does_not_end_is_stopped(parser):
    answer = parser("import time; print('so far', end='', flush=True); time.sleep(60)", 3.0)
    assert answer.code is None
    assert answer.reason == "it takes too long"
