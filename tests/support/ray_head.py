"""The head of a Ray cluster in a process of its own, with an environment of its own."""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@contextlib.contextmanager
def ray_head(prefix=(), host="127.0.0.1", port=None, cpus=1, **environment):
    """Starts a head for the length of a `with` block, by the command `prefix` if given; yields its address."""
    port = port or free_port()
    with tempfile.TemporaryDirectory(prefix="ray", dir="/tmp") as folder:  # paths of its sockets must be short
        command = [*prefix, sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block"]
        command += [f"--node-ip-address={host}", f"--port={port}", f"--num-cpus={cpus}", f"--temp-dir={folder}"]
        command += ["--include-dashboard=false", "--disable-usage-stats"]
        log = open(f"{folder}/log", "w+")  # noqa: SIM115
        process = subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | environment)
        try:
            end = time.monotonic() + 60
            while "Ray runtime started" not in (said := open(f"{folder}/log").read()):  # noqa: SIM115
                assert process.poll() is None, said
                assert time.monotonic() < end, said
                time.sleep(0.2)
            yield f"{host}:{port}"
        finally:
            process.terminate()
            process.wait(30)
            log.close()
