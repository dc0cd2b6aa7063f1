"""Build the image of deploy/, start a Ray cluster of its containers as KubeRay would, kill a node, compare the results.

    python benchmarks/image_cluster.py [--engine podman] [--methods guided halve] [--trials 4] [--kill-at 5]
                                       [--build-option=--build-arg=TORCH_INDEX= ...] [--run-option=--read-only ...]

Needs Docker, or Podman with its networks (Debian: podman, netavark, aardvark-dns; or a Podman of another origin), and
PyYAML. The registry of the base image and the package index must be reachable; what a machine needs for that, such as
a certificate or a mirror's configuration, is mounted with --build-option=--volume=FILE:PLACE. With --image nothing is
built.

In containers of the image, data are collected, a model is trained and evaluated without a cluster. Then a head, two
workers and an MLflow server start on a network of their own: users, commands, environments, memory limits and
/dev/shm are those that KubeRay makes of deploy/kuberay/raycluster.yaml, with the CPUs of --cpus. The job of rayjob.yaml
is submitted over HTTP with the token, for the trials that are asked for; when some are done, one worker's container is
killed. In the end, every record must be that of the evaluation without a cluster, but for times, and so must be the
report. Exit code 1: something differs or a check fails. Containers, network and volume are removed; images stay.
"""

import argparse
import json
import secrets
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
HEAD = "cutgrammar-head-svc"
"""The name that KubeRay's service gives to the head of the cluster `cutgrammar`."""
START_SECONDS = 300.0
"""Time limit for the start of a node or a server [s]."""
UNITS = {"Ki": 2**10, "Mi": 2**20, "Gi": 2**30}
COUNT = """
import pathlib, sqlite3
ledger = "/shared/run/ledger.sqlite"
if pathlib.Path(ledger).exists():
    print(sqlite3.connect(f"file:{ledger}?mode=ro", uri=True).execute("SELECT count(*) FROM records").fetchone()[0])
"""
DIGESTS = """
import json, pathlib, sys
from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
ledger = ledger_of(pathlib.Path(sys.argv[1]))
print(json.dumps({record.key.name: record.digest for record in read_records(ledger)}))
"""
HOSTS = """
import collections, sqlite3
counts = collections.Counter(sqlite3.connect("/shared/run/ledger.sqlite").execute("SELECT host, status FROM attempts"))
print("attempts:", ", ".join(f"{count} {status} on {host}" for (host, status), count in sorted(counts.items())))
"""
FETCH = "import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1], timeout=10).read().decode())"


def number_of_bytes(quantity: str) -> int:
    """Bytes of a quantity such as "8Gi"."""
    return int(quantity[:-2]) * UNITS[quantity[-2:]]


def start_command(group: Mapping[str, Any], head: bool, cpus: int | None = None) -> str:
    """The shell command that KubeRay gives a container: `ray start` with the parameters of its group.

    Args:
        group: `headGroupSpec`, or one of `workerGroupSpecs`.
        head: whether it is the head's.
        cpus: CPUs that the node offers; those of the manifest if None.
    """
    limits = group["template"]["spec"]["containers"][0]["resources"]["limits"]
    own = {"no-monitor": "true", "dashboard-host": "0.0.0.0"} if head else {"address": f"{HEAD}:6379"}
    usual = {"block": "true", "dashboard-agent-listen-port": "52365", "metrics-export-port": "8080"}
    sizes = {"num-cpus": limits["cpu"], "memory": str(number_of_bytes(limits["memory"]))}
    parameters = {**sizes, **usual, **own, **group["rayStartParams"]}
    if cpus is not None:
        parameters["num-cpus"] = str(cpus)
    words = [f"--{name}" if value == "true" else f"--{name}={value}" for name, value in sorted(parameters.items())]
    return " ".join(["ulimit -n 65536; ray start", *(["--head"] if head else []), *words])


class Containers:
    """Containers of one network and one volume.

    Args:
        engine: program, such as podman.
        image: of the containers.
        options: further options of `run`.
        volume: an existing volume, which stays; one that ends with the rest if empty.
    """

    def __init__(self, engine: str, image: str, options: Sequence[str], volume: str = "") -> None:
        self.engine, self.image, self._options = engine, image, options
        self.name = f"cutgrammar-{secrets.token_hex(4)}"
        self._names: list[str] = []
        self("network", "create", self.name)
        self._volume, self._is_ours = volume or self.name, not volume
        if self._is_ours:
            self("volume", "create", self._volume)
        self.run(["chown", "1000:1000", "/shared"], "--user=0")  # as fsGroup does

    def __call__(self, *words: str, check: bool = True, **more: Any) -> subprocess.CompletedProcess[str]:
        """Run the engine with these words; its output is captured unless `stdout` is given."""
        more = {"stdout": subprocess.PIPE, **more}
        return subprocess.run([self.engine, *words], check=check, text=True, **more)

    def command(self, words: Sequence[str], *options: str, name: str = "", image: str = "") -> list[str]:
        """What starts a container that carries out `words`."""
        self._names.append(f"{self.name}-{name or secrets.token_hex(4)}")
        place = [f"--name={self._names[-1]}", f"--network={self.name}", f"--volume={self._volume}:/shared"]
        return ["run", *place, *self._options, *options, image or self.image, *words]

    def run(self, words: Sequence[str], *options: str, **more: Any) -> str:
        """Carry out a command in a new container, and return what it prints."""
        return self(*self.command(words, "--rm", *options), **more).stdout or ""

    def start(self, name: str, words: Sequence[str], *options: str, image: str = "") -> None:
        """Start a container that works in the background."""
        self(*self.command(words, "--detach", *options, name=name, image=image))

    def execute(self, name: str, words: Sequence[str], **more: Any) -> str:
        """Carry out a command in a container that runs, and return what it prints."""
        return str(self("exec", f"{self.name}-{name}", *words, **more).stdout)

    def kill(self, name: str) -> None:
        """Kill every process of a container by SIGKILL."""
        self("kill", "--signal=KILL", f"{self.name}-{name}")

    def answers(self, url: str, expected: str) -> None:
        """Wait until `url` is answered with `expected` to another container of the network, as to Kubernetes' probes.

        Raises:
            TimeoutError: it is not within `START_SECONDS`.
        """
        over = time.monotonic() + START_SECONDS
        command = ["python", "-c", FETCH, url]
        while expected not in self.execute("probe", command, check=False, stderr=subprocess.DEVNULL):
            if time.monotonic() > over:
                raise TimeoutError(f"{url} has not answered with {expected!r} within {START_SECONDS:.0f} s")
            time.sleep(2)

    def remove(self) -> None:
        """Remove everything, after the ends of the logs where an error is on its way."""
        running = sys.exc_info()[0] is not None
        for name in self._names:
            if running:
                print(f"--- {name}", flush=True)
                self("logs", "--tail=20", name, check=False, stdout=None)
            self("rm", "--force", name, check=False, stderr=subprocess.DEVNULL)
        if self._is_ours:
            self("volume", "rm", self._volume, check=False)
        self("network", "rm", self.name, check=False)


def start_cluster(containers: Containers, cluster: Mapping[str, Any], cpus: int, workers: int) -> str:
    """Start a head and workers as KubeRay does, wait until their probes are content, and return the token."""
    token = secrets.token_hex(32)
    spec = cluster["spec"]
    for number in range(workers + 1):
        group = spec["workerGroupSpecs"][0] if number else spec["headGroupSpec"]
        pod = group["template"]["spec"]
        limits = pod["containers"][0]["resources"]["limits"]
        name = f"worker-{number}" if number else "head"
        command = start_command(group, not number, cpus if number else None)
        environment = {
            "FQ_RAY_IP": HEAD,
            "RAY_IP": HEAD,
            "RAY_PORT": "6379",
            "RAY_ADDRESS": f"{HEAD if number else '127.0.0.1'}:6379",
            "RAY_CLUSTER_NAME": cluster["metadata"]["name"],
            "RAY_CLOUD_INSTANCE_ID": name,
            "RAY_NODE_TYPE_NAME": group.get("groupName", "headgroup"),
            "KUBERAY_GEN_RAY_START_CMD": command,
            "RAY_USAGE_STATS_KUBERAY_IN_USE": "1",
            "RAY_DASHBOARD_ENABLE_K8S_DISK_USAGE": "1",
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": token,
        }
        size = number_of_bytes(limits["memory"])
        options = [f"--env={key}={value}" for key, value in environment.items()]
        user = [f"--user={pod['securityContext']['runAsUser']}"]
        if number:  # the init container of KubeRay
            wait = f"until ray health-check --address {HEAD}:6379; do sleep 5; done"
            containers.run(["/bin/bash", "-lc", "--", wait], *options, *user, "--memory=256m")
        sizes = [f"--memory={size}", f"--shm-size={size}", f"--network-alias={name if number else HEAD}"]
        containers.start(name, ["/bin/bash", "-lc", "--", command], *options, *user, *sizes)
        containers.answers(f"http://{name if number else HEAD}:52365/api/healthz", "success")
        print(f"{name} is ready", flush=True)
    return token


def kill_when(containers: Containers, records: int, job: subprocess.Popen[Any]) -> None:
    """Kill the container of the first worker when so many records are in the ledger.

    Raises:
        RuntimeError: the job has ended before.
    """
    while int(containers.execute("probe", ["python", "-c", COUNT]).strip() or 0) < records:
        if job.poll() is not None:
            raise RuntimeError("the job ended before a worker could be killed; give more --trials")
        time.sleep(0.5)
    containers.kill("worker-1")
    print(f"killed worker-1 when {containers.execute('probe', ['python', '-c', COUNT]).strip()} trials were done")


def compare(containers: Containers) -> bool:
    """Whether both runs have the same records and reports but for times."""
    found = []
    for run in ("/shared/alone", "/shared/run"):
        digests = json.loads(containers.execute("probe", ["python", "-c", DIGESTS, run]))
        words = ["cutgrammar", "report", "--runs", run, "--json", "--no-timing"]
        found.append((digests, json.loads(containers.execute("probe", words))))
    (expected, report), (records, other) = found
    changed = sum(records.get(key) != digest for key, digest in expected.items()) + len(
        records.keys() - expected.keys()
    )
    print(containers.execute("probe", ["python", "-c", HOSTS]).strip())
    print(f"{len(records)} records of {len(expected)}, {changed} differ; reports equal: {report == other}", flush=True)
    return not changed and report == other


def main() -> int:
    """Read the command line, build, try, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", help="podman or docker; the one that is installed if not given")
    parser.add_argument("--build-option", action="append", default=[], help="option of the engine's build")
    parser.add_argument("--run-option", action="append", default=[], help="option of the engine's run")
    parser.add_argument("--image", help="image to try, instead of building one")
    parser.add_argument("--mlflow-image", help="MLflow server's image, instead of building one")
    parser.add_argument("--volume", default="", help="volume that stays; data and model that it has are used again")
    parser.add_argument("--cpus", type=int, default=1, help="CPUs that each worker's node offers")
    parser.add_argument("--demonstrations", type=int, default=33)
    parser.add_argument("--methods", nargs="+", default=["grammar", "guided", "halve"])
    parser.add_argument("--trials", type=int, default=4, help="of each setup")
    parser.add_argument("--kill-at", type=int, default=5, help="number of finished trials at which a worker is killed")
    given = parser.parse_args()
    engine = given.engine or next(filter(shutil.which, ("podman", "docker")), None)
    if engine is None:
        parser.error("neither podman nor docker is installed")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    image, server = given.image or f"cutgrammar:{version}", given.mlflow_image or "cutgrammar-mlflow"
    for tag, folder, file, wanted in (
        (image, ".", "deploy/Dockerfile", not given.image),
        (server, "deploy/mlflow", "deploy/mlflow/Dockerfile", not given.mlflow_image),
    ):
        began = time.monotonic()
        if wanted:
            options = [*given.build_option, "--file", file, "--tag", tag]
            subprocess.run([engine, "build", *options, folder], check=True, cwd=ROOT)
        words = [engine, "image", "inspect", "--format={{.Size}}", tag]
        size = int(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
        print(f"{tag}: {size / 1e9:.2f} GB, built in {time.monotonic() - began:.0f} s", flush=True)
    containers = Containers(engine, image, given.run_option, given.volume)
    try:
        return 0 if carry_out(containers, server, given) else 1
    finally:
        containers.remove()


def carry_out(containers: Containers, server: str, given: argparse.Namespace) -> bool:
    """Evaluate without and with a cluster; whether the results are the same."""
    cluster, job = (
        yaml.safe_load((ROOT / "deploy" / "kuberay" / f"{name}.yaml").read_text()) for name in ("raycluster", "rayjob")
    )
    containers.run(["rm", "-rf", "/shared/alone", "/shared/run"])
    containers.run(["cutgrammar", "--help"])
    print(containers.run(["cutgrammar", "doctor"]), flush=True)
    some = ["--world", "bench", "--runs", "1", "--trials", str(given.trials), "--methods", *given.methods]
    for words in (
        ["collect", "--out", "/shared/data", "--trials", str(given.demonstrations), "--workers", "0"],
        ["split", "/shared/data", "--out", "/shared/data"],
        ["train", "--data", "/shared/data", "--out", "/shared/model"],
        ["evaluate", "--data", "/shared/data", "--model", "/shared/model", "--out", "/shared/alone", "--workers", "0"],
    ):
        began = time.monotonic()
        words = ["cutgrammar", *words, *(some if words[0] == "evaluate" else [])]
        containers.run(words, "--env=MLFLOW_TRACKING_URI=sqlite:////tmp/mlflow.db", stdout=None)
        print(f"{' '.join(words[:2])}: {time.monotonic() - began:.0f} s", flush=True)
    containers.start("probe", ["sleep", "infinity"])
    environment = yaml.safe_load(job["spec"]["runtimeEnvYAML"])["env_vars"]
    name = environment["MLFLOW_TRACKING_URI"].removeprefix("http://").removesuffix(":5000")
    serve = ["mlflow", "server", "--host=0.0.0.0", "--port=5000", "--backend-store-uri=sqlite:////tmp/mlflow.db"]
    serve += ["--artifacts-destination=/tmp/files", f"--allowed-hosts={name}:5000"]
    containers.start("mlflow", serve, f"--network-alias={name}", image=server)
    containers.answers(f"{environment['MLFLOW_TRACKING_URI']}/health", "OK")
    token = start_cluster(containers, cluster, given.cpus, 2)
    submit = ["ray", "job", "submit", f"--address=http://{HEAD}:8265"]
    wrong = containers.command([*submit, "--", "true"], "--rm", f"--env=RAY_AUTH_TOKEN={secrets.token_hex(32)}")
    refused = containers(*wrong, check=False, stderr=subprocess.STDOUT)
    print("a job with a wrong token:", refused.stdout.strip().splitlines()[-1], flush=True)
    if not refused.returncode:
        raise RuntimeError("the head has taken a job with a wrong token")
    words = [*submit, f"--runtime-env-json={json.dumps({'env_vars': environment})}", "--"]
    words += [*shlex.split(job["spec"]["entrypoint"]), *some]
    command = containers.command(words, "--rm", f"--env=RAY_AUTH_TOKEN={token}")
    process = subprocess.Popen([containers.engine, *command])
    kill_when(containers, given.kill_at, process)
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, words)
    query = "import mlflow; print(len(mlflow.search_runs(search_all_experiments=True)))"
    found = containers.execute("probe", ["env", *(f"{k}={v}" for k, v in environment.items()), "python", "-c", query])
    print(f"runs that the MLflow server has: {found.strip()}")
    return compare(containers) and int(found) > 0


if __name__ == "__main__":
    sys.exit(main())
