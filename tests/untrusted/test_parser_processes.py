"""What becomes of a process that parses: its output, its refusal, its death."""

import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from cutgrammar.untrusted import parser_processes
from cutgrammar.untrusted.memory import bounded_memory
from cutgrammar.untrusted.parser_processes import REFUSED, run_parser, time_of_parsers

DIED = "it ends the process that reads it, or never lets it end"


@pytest.mark.parametrize("has_templates", [True, False])
def test_the_output_of_a_parser_is_what_it_makes_of_the_data(parser, has_templates, monkeypatch):
    monkeypatch.setattr(parser_processes, "HAS_TEMPLATES", has_templates)
    answer = parser("print(sys.argv[1], sys.stdin.read(), end='')")
    assert (answer.code, answer.output, answer.message) == (0, b"word data", "")


def test_the_reason_of_a_refusal_is_the_last_line(parser):
    answer = parser(f"print('a warning\\nis empty', file=sys.stderr)\nreturn {REFUSED}")
    assert (answer.code, answer.reason) == (REFUSED, "is empty")


@pytest.mark.parametrize(
    "code",
    [
        "os.abort()",
        "os.kill(os.getpid(), signal.SIGKILL)",
        "bytearray(5 * 2**30)",
        "resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass",
        "os.kill(os.getppid(), signal.SIGKILL); time.sleep(1)",
        "os.kill(0, signal.SIGKILL)",
    ],
)
def test_the_death_of_a_parser_is_an_answer(parser, code):
    answer = parser(code)
    assert answer.code != 0
    assert answer.reason == DIED


@pytest.mark.parametrize("has_templates", [True, False])
def test_a_parser_that_does_not_end_is_stopped(parser, has_templates, monkeypatch):
    monkeypatch.setattr(parser_processes, "HAS_TEMPLATES", has_templates)
    answer = parser("print('so far', end='', flush=True); time.sleep(60)", 3.0)
    assert answer.code is None
    assert answer.output == b"so far"
    assert answer.reason == "it takes too long"


@pytest.mark.parametrize(
    "code",
    [
        "sys.stdout.buffer.write(sys.stdin.buffer.read() * 2)",
        "return 7",
        "sys.exit()",
        "sys.exit('no such thing')",
        "sys.exit(-1)",
        "sys.exit(True)",
        "print('partly'); raise ValueError('two\\nlines')",
        "raise KeyError('é\\udc80')",
        "raise MemoryError",
        "print('\\udc80')",
        "os.write(1, b'first '); print('late', end='')",
        "sys.stdout.close()",
        "os.close(1); print('lost')",
        "print(sys.stdin.encoding, sys.stdin.errors, sys.stdout.encoding, sys.stdout.errors, sys.stderr.errors)",
        "print(sys.argv, sys.path, os.getcwd(), sorted(os.environ))",
        "print([signal.getsignal(number) for number in sorted(signal.valid_signals())])",
        "print(*[resource.getrlimit(which) for which in range(16)])",
        "print(len(os.listdir('/proc/self/fd')))",
        "print(subprocess.run(['false']).returncode)",
    ],
)
def test_an_answer_is_that_of_a_new_interpreter(parser, code):
    answer = parser(code)
    command = [sys.executable, "-P", "-m", "parser_of_a_test", "word"]
    variables = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    own = subprocess.run(command, input=b"data", capture_output=True, env=os.environ | variables, check=False)
    lines = own.stderr.decode().splitlines()
    assert (answer.code & 0xFF, answer.output) == (own.returncode & 0xFF, own.stdout)
    assert answer.message == (lines[-1] if lines else "")


def test_many_threads_get_their_own_answers(parser):
    given = [bytes([65 + i]) * (i * 100_000 + 1) for i in range(24)]
    code = "data = sys.stdin.buffer.read()\nsys.stderr.write(data[:50].decode() * 9)\nsys.stdout.buffer.write(data)"
    parser(code)
    with ThreadPoolExecutor(8) as threads:
        answers = list(threads.map(lambda data: run_parser("parser_of_a_test", (), data), given))
    assert [answer.output for answer in answers] == given
    assert [answer.message for answer in answers] == [data[:50].decode() * 9 for data in given]


def test_every_parser_has_a_folder_and_limits_of_its_own(parser, tmp_path, monkeypatch):
    busy = "while time.process_time() < 1.0: pass\nspent = time.process_time()"
    code = "print(time.process_time() < spent, resource.getrlimit(resource.RLIMIT_DATA), os.getcwd())"
    limit = resource.getrlimit(resource.RLIMIT_DATA)
    with bounded_memory():
        assert parser(code, imported=busy).output.decode() == f"True {limit} {os.getcwd()}\n"
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert parser(code, imported=busy).output.decode() == f"True {limit} {tmp_path / 'other'}\n"


def test_a_folder_that_was_removed_hinders_no_parser(parser, tmp_path, monkeypatch):
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    (tmp_path / "other").rmdir()
    assert parser("print(sys.stdin.read())").output == b"data\n"


def test_the_processor_time_of_parsers_is_counted(parser):
    before = time_of_parsers()
    answer = parser("while time.process_time() < 0.3: pass")
    assert answer.seconds >= 0.3
    assert time_of_parsers() - before == pytest.approx(answer.seconds)


def test_an_earlier_parser_leaves_nothing_to_a_later_one(parser):
    code = "global seen\nseen += 1\nprint(seen, sys.modules.get('wave'), os.environ.get('LEFT'))\nimport wave"
    answers = [parser(f"{code}\nos.environ['LEFT'] = 'x'", imported="seen = 0") for _ in range(2)]
    assert [answer.output for answer in answers] == [b"1 None None\n"] * 2


def test_a_module_that_cannot_be_imported_is_told(parser):
    answer = parser("", imported="import no_such_module")
    assert (answer.code, answer.reason) == (1, "ModuleNotFoundError: No module named 'no_such_module'")


def test_a_module_that_dies_when_it_is_imported_is_an_answer(parser):
    assert parser("", imported="os.abort()").reason == DIED


def test_a_python_that_does_not_start_is_told(parser, monkeypatch):
    monkeypatch.setattr("sys.executable", "/bin/false")
    assert parser("").reason == "no process can be started that reads it: /bin/false ends with 1"
    monkeypatch.setattr("sys.executable", "/no/python")
    with pytest.raises(FileNotFoundError, match="/no/python"):
        parser("")
