"""The life of the processes from which parsers are forked: when they start, and that none is left."""

import os
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest

from cutgrammar.untrusted.parser_processes import run_parser

PEDIGREE = "print(os.getpid(), os.getppid(), open(f'/proc/{os.getppid()}/stat').read().split()[3], flush=True)"
"""Prints the ids of a parser, its guard and its template."""
CALLER = """
import os, sys, threading
from cutgrammar.untrusted.parser_processes import run_parser
def call():
    return run_parser("parser_of_a_test", [], b"")
for _ in range(2):
    threading.Thread(target=call, daemon=True).start()
sys.stdin.read()
"""


def ids(answer):
    return [int(one) for one in answer.output.split()]


def is_gone(process):
    return not psutil.pid_exists(process) or psutil.Process(process).status() == psutil.STATUS_ZOMBIE


def wait_for(condition):
    """Wait until it is true, at most a minute: the system takes a moment to remove a process that was killed."""
    deadline = time.monotonic() + 60.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert condition()


def read(file):
    """The numbers in a file; none if it is not there."""
    return [int(one) for one in file.read_text().split()] if file.exists() else []


def written_to(file, code=PEDIGREE):
    """Code whose output goes to the end of a file."""
    return code.replace("flush=True", f"file=open({str(file)!r}, 'a'), flush=True")


def test_parsers_have_one_template_that_is_not_of_their_caller_s_terminal(parser):
    first, second = (ids(parser(f"{PEDIGREE}\nprint(os.getsid(0))")) for _ in range(2))
    assert first[2:] == second[2:]
    assert not {*first[:2]} & {*second[:2]}
    assert first[3] != os.getsid(0)


def test_another_path_or_environment_has_another_template(parser, monkeypatch, tmp_path):
    code = f"{PEDIGREE}\nprint(os.environ.get('OF_A_TEST', '0'), int({str(tmp_path)!r} in sys.path))"
    *_, first, variable, path = ids(parser(code))
    assert (variable, path) == (0, 0)
    monkeypatch.setenv("OF_A_TEST", "5")
    *_, second, variable, path = ids(parser(code))
    assert (variable, path) == (5, 0)
    monkeypatch.syspath_prepend(tmp_path)
    *_, third, variable, path = ids(parser(code))
    assert (variable, path) == (5, 1)
    assert len({first, second, third}) == 3
    wait_for(lambda: is_gone(first) and is_gone(second))


def test_a_template_that_was_killed_is_replaced(parser):
    *_, template = ids(parser(PEDIGREE))
    os.kill(template, signal.SIGKILL)
    *_, other = ids(parser(PEDIGREE))
    assert other != template


def test_a_template_that_ended_since_it_was_idle_is_replaced(parser):
    idle = "sys.modules['__main__'].IDLE_SECONDS = 0.1"
    *_, template = ids(parser(PEDIGREE, imported=idle))
    wait_for(lambda: is_gone(template))
    assert ids(parser(PEDIGREE, imported=idle))[-1] != template


def test_a_call_survives_the_template_that_serves_it(parser, tmp_path):
    answers, told = [], tmp_path / "told"
    code = f"{written_to(told)}\nwhile not os.path.exists({str(tmp_path / 'end')!r}): time.sleep(0.01)\nprint('whole')"
    call = threading.Thread(target=lambda: answers.append(parser(code)))
    call.start()
    wait_for(lambda: len(read(told)) == 3)
    os.kill(read(told)[2], signal.SIGKILL)
    wait_for(lambda: is_gone(read(told)[2]))
    (tmp_path / "end").touch()
    call.join()
    assert [answer.output for answer in answers] == [b"whole\n"]


def test_a_call_that_no_template_took_is_repeated(parser):
    *_, template = ids(parser(PEDIGREE))
    os.kill(template, signal.SIGSTOP)
    answers = []
    call = threading.Thread(target=lambda: answers.append(run_parser("parser_of_a_test", (), b"")))
    call.start()
    call.join(0.5)
    assert call.is_alive()
    os.kill(template, signal.SIGKILL)
    call.join()
    assert answers[0].code == 0
    assert ids(answers[0])[-1] != template


def test_a_template_that_hangs_keeps_nobody_beyond_the_time_limit(parser, monkeypatch):
    monkeypatch.setattr("cutgrammar.untrusted.parser_processes.STOP_SECONDS", 0.1)
    *_, template = ids(parser(PEDIGREE))
    os.kill(template, signal.SIGSTOP)
    assert run_parser("parser_of_a_test", (), b"", 0.1).code is None
    os.kill(template, signal.SIGKILL)


@pytest.mark.parametrize("end", ["time.sleep(60)", ""])
def test_nothing_is_left_of_a_parser(end, parser):
    code = "print(subprocess.Popen(['sleep', '600']).pid, os.getpid(), os.getppid(), flush=True)"
    answer = parser(f"{code}\n{end}", *[3.0] * bool(end))
    assert (answer.code is None) == bool(end)
    assert len(ids(answer)) == 3
    for process in ids(answer):
        wait_for(lambda: is_gone(process))  # noqa: B023


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, None])
def test_nothing_is_left_of_a_caller(how, write, tmp_path):
    write(f"{written_to(tmp_path / 'told')}\ntime.sleep(600)")
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen([sys.executable, "-c", CALLER], stdin=subprocess.PIPE, env=variables) as caller:
        wait_for(lambda: len(read(tmp_path / "told")) == 6)
        if how:
            caller.send_signal(how)
    processes = set(read(tmp_path / "told"))
    assert len(processes) == 5
    wait_for(lambda: all(map(is_gone, processes)))


def ids_in_a_fork():
    """The ids of a parser, its guard and its template that a fork of this process asks for."""
    ours, its = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(its, run_parser("parser_of_a_test", (), b"").output)
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    os.close(its)
    with os.fdopen(ours) as told:
        return [int(one) for one in told.read().split()]


def test_forks_of_the_caller_share_its_template(parser):
    *_, template = ids(parser(PEDIGREE))
    assert [ids_in_a_fork()[-1] for _ in range(2)] == [template] * 2
    assert ids(parser(PEDIGREE))[-1] == template


def test_a_fork_that_finds_the_template_dead_starts_its_own(parser):
    *_, template = ids(parser(PEDIGREE))
    os.kill(template, signal.SIGKILL)
    *_, other = ids_in_a_fork()
    assert other != template
    wait_for(lambda: is_gone(other))
    assert ids(parser(PEDIGREE))[-1] not in (template, other)


def test_a_template_serves_forks_of_its_caller_until_the_last_has_ended(write, tmp_path):
    write(PEDIGREE)
    code = f"""
import os, time
from cutgrammar.untrusted.parser_processes import run_parser
def call():
    print(run_parser("parser_of_a_test", (), b"").output.decode(), end="", flush=True)
call()
caller = os.getpid()
if os.fork() == 0:
    while os.getppid() == caller: time.sleep(0.05)
    call()
    while not os.path.exists({str(tmp_path / "end")!r}): time.sleep(0.05)
"""
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=variables) as caller:
        first, second = ([int(one) for one in caller.stdout.readline().split()] for _ in range(2))
        assert caller.wait() == 0
        assert first[-1] == second[-1]
        assert not is_gone(second[-1])
        (tmp_path / "end").touch()
        wait_for(lambda: is_gone(second[-1]))


def test_calls_leave_no_descriptors_and_no_zombies(parser):
    *_, template = ids(parser(PEDIGREE))

    def left():
        wait_for(lambda: not psutil.Process(template).children())
        files = [os.listdir(f"/proc/{process}/fd") for process in (os.getpid(), template)]
        return files, psutil.Process().children(recursive=True)

    before = left()
    for _ in range(50):
        assert run_parser("parser_of_a_test", (), b"data").code == 0
    assert left() == before


def test_other_children_of_the_caller_inherit_no_descriptors(parser):
    def inherited():
        return subprocess.run(["ls", "/proc/self/fd"], close_fds=False, capture_output=True, check=True).stdout

    before = inherited()
    parser("")
    assert inherited() == before
