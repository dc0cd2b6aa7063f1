"""The template of parser processes: it imports a module once, and forks a process for every file.

`parser_processes` runs it as `python -m cutgrammar.untrusted.parser_template MODULE`, with a Unix socket on stdin. If
the module has a function `prepare`, it is called once, to load what all files need. A request is one message: the
arguments as JSON, and descriptors of the parser's stdin, stdout, stderr and working directory and of a status socket.
The template forks a guard, which forks the parser and waits until that has ended or the caller has closed its end of
the status socket (since the parser is late, or the caller has ended). The guard then kills the parser, answers with its
exit code and processor time, and kills itself with all that the parser left behind. So it needs neither template nor
caller to tidy up.

The template itself reads no file, and ends when its caller and the forks of that have ended, or have asked for nothing
for `IDLE_SECONDS`.
"""

import importlib
import json
import os
import resource
import select
import signal
import socket
import sys
from contextlib import suppress
from typing import NoReturn

IDLE_SECONDS = 60.0
"""A template ends when it was not used for so long [s]; that of mesh files has 227 MB."""
MAX_REQUEST = 2**18
"""More than a socket takes as one message [bytes]."""


def main() -> None:
    """Serve requests until nobody makes them."""
    if os.fork() > 0:
        os._exit(0)  # the caller waits for this one only, so that a template that ends is nobody's zombie
    os.dup2(1, 2)  # stdout is /dev/null; the caller waits for the end of stderr
    line, module = socket.socket(fileno=0), sys.argv[1]
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (hard, hard))  # the caller may have been within `bounded_memory`
    with suppress(BaseException):  # the import fails in the parser again, which tells why
        imported = importlib.import_module(module)
        if hasattr(imported, "prepare"):
            imported.prepare()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # guards are no zombies either
    line.settimeout(IDLE_SECONDS)
    while True:
        try:
            request, files, _, _ = socket.recv_fds(line, MAX_REQUEST, 5)
        except TimeoutError:
            return
        if not request:
            return
        if os.fork() == 0:
            line.close()
            _guard(module, json.loads(request), files)
        for file in files:
            os.close(file)


def _guard(module: str, arguments: list[str], files: list[int]) -> NoReturn:
    """Fork the parser and see to its end."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    *own, status = files
    try:
        parser = os.fork()
        if parser == 0:
            os.close(status)
            _parse(module, arguments, *own)
        for file in own:
            os.close(file)
        ended = os.pidfd_open(parser)
        select.select([ended, status], [], [])
        os.kill(parser, signal.SIGKILL)
        _, how, usage = os.wait4(parser, 0)
        with suppress(OSError):  # the caller has ended
            os.write(status, f"{os.waitstatus_to_exitcode(how)} {usage.ru_utime + usage.ru_stime}".encode())
    finally:
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _parse(module: str, arguments: list[str], stdin: int, stdout: int, stderr: int, folder: int) -> NoReturn:
    """Run the module as `python -m` does, but for exit handlers, and end the process."""
    code = 120  # Python's own if output cannot be written
    try:
        os.fchdir(folder)
        for file, number in ((stdin, 0), (stdout, 1), (stderr, 2)):
            os.dup2(file, number)
        for file in (stdin, stdout, stderr, folder):
            os.close(file)
        ended = _exit_code(module, arguments)
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and not stream.closed:
                stream.flush()
        code = ended
    finally:
        os._exit(code)


def _exit_code(module: str, arguments: list[str]) -> int:
    """Run the module's `main`; messages of errors go to stderr."""
    try:
        parser = importlib.import_module(module)
        sys.argv = [parser.__file__ or module, *arguments]
        sys.exit(parser.main())
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
    except BaseException:  # noqa: BLE001  the process ends
        sys.__excepthook__(*sys.exc_info())
    return 1


if __name__ == "__main__":
    main()
