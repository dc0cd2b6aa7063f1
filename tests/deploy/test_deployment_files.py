"""The files of deploy/, as far as they can be tested without Docker, Kubernetes, SLURM or machines to log in to.

`benchmarks/image_cluster.py` builds the images and starts a cluster of them, where Docker or Podman is at hand.
"""

import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from urllib.parse import urlsplit

import jsonschema
import pytest
import ray
import yaml
from mlflow.server.security_utils import is_allowed_host_header, should_block_cors_request
from ray.autoscaler._private.kuberay.autoscaling_config import _derive_autoscaling_config_from_ray_cr
from ray.autoscaler._private.util import prepare_config, validate_config
from ray.scripts import scripts

import image_cluster
from cutgrammar_pipelines.cli.app import build_app

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]

TEXT, NUMBER, FLAG = {"type": "string"}, {"type": "integer", "minimum": 0, "maximum": 2**31 - 1}, {"type": "boolean"}
TEXTS = {"type": "object", "additionalProperties": TEXT}


def fields(required="", **properties):
    """The schema of an object of which every field is known."""
    return {
        "type": "object",
        "properties": properties,
        "required": required.split(),
        "additionalProperties": False,
    }


def several(schema):
    """The schema of a list with at least one item."""
    return {"type": "array", "items": schema, "minItems": 1}


def one_of(*words):
    """The schema of one of some words."""
    return {"enum": list(words)}


QUANTITY = {"type": "string", "pattern": r"^[0-9]+(\.[0-9]+)?(m|[kMGTPE]|[KMGTPE]i)?$"}
AMOUNTS = fields(cpu=QUANTITY, memory=QUANTITY)
CONTAINER = fields(
    "name image",
    name=TEXT,
    image=TEXT,
    ports=several(fields("containerPort", containerPort=NUMBER, name={"type": "string", "maxLength": 15})),
    resources=fields(requests=AMOUNTS, limits=AMOUNTS),
    volumeMounts=several(fields("name mountPath", name=TEXT, mountPath=TEXT)),
)
POD = fields(
    "containers",
    securityContext=fields(runAsNonRoot=FLAG, runAsUser=NUMBER, fsGroup=NUMBER),
    containers=several(CONTAINER),
    volumes=several(fields("name", name=TEXT, persistentVolumeClaim=fields("claimName", claimName=TEXT))),
)
GROUP = {"rayStartParams": TEXTS, "resources": TEXTS, "labels": TEXTS, "template": fields("spec", spec=POD)}
NAMED = fields("name", name={"type": "string", "pattern": "^[a-z]([-a-z0-9]*[a-z0-9])?$", "maxLength": 47})
CLUSTER = fields(
    "headGroupSpec rayVersion",
    rayVersion=TEXT,
    authOptions=fields(mode=one_of("disabled", "token"), enableK8sTokenAuth=FLAG),
    enableInTreeAutoscaling=FLAG,
    autoscalerOptions=fields(
        idleTimeoutSeconds=NUMBER,
        upscalingMode=one_of("Default", "Aggressive", "Conservative"),
        version=one_of("v1", "v2"),
    ),
    suspend=FLAG,
    headGroupSpec=fields("template rayStartParams", serviceType=TEXT, enableIngress=FLAG, **GROUP),
    workerGroupSpecs=several(
        fields(
            "groupName minReplicas maxReplicas template",
            groupName=TEXT,
            replicas=NUMBER,
            minReplicas=NUMBER,
            maxReplicas=NUMBER,
            numOfHosts=NUMBER,
            idleTimeoutSeconds=NUMBER,
            suspend=FLAG,
            **GROUP,
        )
    ),
)
JOB = fields(
    "clusterSelector entrypoint",
    clusterSelector=fields("ray.io/cluster", **{"ray.io/cluster": TEXT}),
    submissionMode=one_of("K8sJobMode", "HTTPMode"),
    backoffLimit=NUMBER,
    activeDeadlineSeconds=NUMBER,
    entrypoint=TEXT,
    runtimeEnvYAML=TEXT,
    metadata=TEXTS,
)
MANIFESTS = {
    "raycluster": ("RayCluster", CLUSTER),
    "rayjob": ("RayJob", JOB),
}
"""What of ray.io/v1 (KubeRay 1.6) and of Kubernetes' pods the manifests may use; a cluster drops unknown fields without
a word. The names and types were looked up in KubeRay's CRDs, the rules in what its operator checks."""


def documents(file):
    return list(yaml.safe_load_all((DEPLOY / file).read_text()))


@pytest.mark.parametrize("file", MANIFESTS)
def test_manifests_have_only_fields_that_kuberay_knows_with_values_of_their_types(file):
    kind, spec = MANIFESTS[file]
    (manifest,) = documents(f"kuberay/{file}.yaml")
    schema = fields("apiVersion kind metadata spec", apiVersion={"const": "ray.io/v1"}, kind={"const": kind})
    schema["properties"] |= {"metadata": NAMED, "spec": spec}
    jsonschema.validate(manifest, schema)
    manifest["spec"]["backofLimit"] = 0
    with pytest.raises(jsonschema.ValidationError, match="'backofLimit' was unexpected"):
        jsonschema.validate(manifest, schema)


def test_the_manifest_of_a_cluster_has_tokens_on_and_no_root():
    (manifest,) = documents("kuberay/raycluster.yaml")
    spec = manifest["spec"]
    assert spec["authOptions"]["mode"] == "token"
    assert spec["rayVersion"] == ray.__version__
    for group in (spec["headGroupSpec"], *spec["workerGroupSpecs"]):
        assert "resources" not in group or not {"num-cpus", "memory"} & set(group["rayStartParams"])
        pod = group["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"]
        mounted = {mount["name"] for container in pod["containers"] for mount in container["volumeMounts"]}
        assert mounted == {volume["name"] for volume in pod["volumes"]}
        assert all(container["image"] == f"cutgrammar:{VERSION}" for container in pod["containers"])


def test_rays_autoscaler_reads_the_manifest_as_it_was_meant():
    (manifest,) = documents("kuberay/raycluster.yaml")
    manifest["metadata"]["namespace"] = "default"  # as Kubernetes does
    config = _derive_autoscaling_config_from_ray_cr(manifest)
    validate_config(config)
    head, trials = config["available_node_types"]["headgroup"], config["available_node_types"]["trials"]
    assert head["resources"]["CPU"] == 0
    assert trials["resources"] == {"CPU": 8, "memory": 16 * 2**30}
    assert (trials["min_workers"], trials["max_workers"], config["idle_timeout_minutes"]) == (0, 16, 5.0)


def test_the_manifest_of_a_job_runs_a_command_on_that_cluster():
    (cluster,), (job,) = documents("kuberay/raycluster.yaml"), documents("kuberay/rayjob.yaml")
    assert job["spec"]["clusterSelector"] == {"ray.io/cluster": cluster["metadata"]["name"]}
    assert yaml.safe_load(job["spec"]["runtimeEnvYAML"])["env_vars"].keys() == {"MLFLOW_TRACKING_URI"}
    program, *words = shlex.split(job["spec"]["entrypoint"])
    assert program == "cutgrammar"
    _, bound, *_ = build_app("evaluate").parse_args(words, exit_on_error=False, print_error=False)
    assert "/shared/run" in repr(bound)


def test_the_volume_is_the_one_that_the_pods_claim():
    (claim,), (manifest,) = documents("kuberay/shared-volume.yaml"), documents("kuberay/raycluster.yaml")
    (volume,) = manifest["spec"]["headGroupSpec"]["template"]["spec"]["volumes"]
    assert volume["persistentVolumeClaim"]["claimName"] == claim["metadata"]["name"]
    assert claim["spec"]["accessModes"] == ["ReadWriteMany"]


def test_rays_cluster_launcher_accepts_its_file():
    (config,) = documents("ray-cluster.yaml")
    validate_config(prepare_config(config))
    for start in ("head_start_ray_commands", "worker_start_ray_commands"):
        assert all("RAY_AUTH_MODE=token" in command for command in config[start] if "ray start" in command)


@pytest.mark.parametrize("file", ["slurm.sh"])
def test_scripts_are_valid_bash(file):
    read = subprocess.run(["bash", "-n", DEPLOY / file], capture_output=True, text=True, check=False)
    assert (read.returncode, read.stderr) == (0, "")


def test_the_image_copies_files_that_exist_and_are_not_ignored():
    kept = {line[1:] for line in (DEPLOY / "Dockerfile.dockerignore").read_text().split() if line.startswith("!")}
    copied = [
        word
        for line in (DEPLOY / "Dockerfile").read_text().splitlines()
        if line.startswith("COPY")
        for word in line.split()[1:-1]
    ]
    assert set(copied) == kept
    assert all((ROOT / name).exists() for name in copied)
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert {Path(folder).parts[0] for folder in packaged["packages"]} <= set(copied)


def test_versions_in_the_files_are_those_of_the_project():
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split())
    assert f"mlflow=={pinned['mlflow']} " in (DEPLOY / "mlflow" / "Dockerfile").read_text()
    assert pinned["ray"] == ray.__version__
    assert f"--tag cutgrammar:{VERSION}" in (DEPLOY / "Dockerfile").read_text()


@pytest.mark.parametrize("name", ["mlflow", "mlflow.example.org"])
def test_the_mlflow_server_answers_to_the_names_that_the_files_use_and_to_no_other(name):
    (compose,), (job,) = documents("mlflow/compose.yaml"), documents("kuberay/rayjob.yaml")
    environment = compose["services"]["server"]["environment"]
    hosts, origins = (
        re.sub(r"\$\{MLFLOW_NAME:-(\w+)\}", name if name != "mlflow" else r"\1", environment[variable]).split(",")
        for variable in ("MLFLOW_SERVER_ALLOWED_HOSTS", "MLFLOW_SERVER_CORS_ALLOWED_ORIGINS")
    )
    for host in (name, f"{name}:5000", "localhost:5000", "127.0.0.1:5000"):
        assert is_allowed_host_header(hosts, host)
    assert not is_allowed_host_header(hosts, f"{name}.attacker.example:5000")
    assert not should_block_cors_request(f"https://{name}", "POST", origins)
    assert should_block_cors_request("https://attacker.example", "POST", origins)
    used = yaml.safe_load(job["spec"]["runtimeEnvYAML"])["env_vars"]["MLFLOW_TRACKING_URI"]
    assert is_allowed_host_header(hosts, urlsplit(used).netloc) == (name == "mlflow")


@pytest.mark.parametrize("head", [True, False])
def test_the_commands_that_the_benchmark_starts_are_what_ray_start_accepts(head):
    (manifest,) = documents("kuberay/raycluster.yaml")
    group = manifest["spec"]["headGroupSpec"] if head else manifest["spec"]["workerGroupSpecs"][0]
    words = shlex.split(image_cluster.start_command(group, head).partition("; ")[2])
    assert words[:2] == ["ray", "start"]
    parsed = scripts.start.make_context("start", words[2:]).params
    assert (parsed["head"], parsed["num_cpus"], parsed["memory"]) == (
        head,
        0 if head else 8,
        (8 if head else 16) * 2**30,
    )
    assert parsed["address"] == (None if head else "cutgrammar-head-svc:6379")


def test_no_password_is_in_the_files_and_mlflow_is_published_on_loopback_only():
    (compose,) = documents("mlflow/compose.yaml")
    services = compose["services"]
    assert [port for service in services.values() for port in service.get("ports", [])] == ["127.0.0.1:5000:5000"]
    for service in services.values():
        secret = {name: value for name, value in service.get("environment", {}).items() if "PASSWORD" in name}
        assert all(value.startswith("${") for value in secret.values())
