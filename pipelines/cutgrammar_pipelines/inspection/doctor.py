"""Which parts of cutgrammar work on this machine, and how to get those that do not."""

import os
import platform
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

from cutgrammar.command_lines import as_typed
from cutgrammar_dashboards.recording.viewer import has_screen
from cutgrammar_pipelines.tracking.mlflow_store import store_name

PACKAGES = ("numpy", "scipy", "torch", "numba", "trimesh", "manifold3d", "ray", "sapien", "pin", "mlflow", "rerun-sdk")


def doctor() -> int:
    """Print a line for each part; return 0, or 1 if a package is missing or SAPIEN's physics does not start."""
    print(f"python      {platform.python_version()} at {sys.prefix}")
    print(f"cores       {os.cpu_count()}")
    versions = {package: _version(package) for package in PACKAGES}
    for package, number in versions.items():
        print(f"{package:<11} {number or f'missing: pip install {package}'}")
    physics = _works("import sapien; sapien.Scene([sapien.physx.PhysxCpuSystem()])")
    vulkan = _works("import sapien; sapien.render.RenderSystem()")
    browser = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("firefox")
    if physics:
        print("physics     SAPIEN steps on the CPU")
    else:
        print("physics     SAPIEN does not start: --world bench still works")
    if vulkan:
        print("rendering   a Vulkan device was found")
    else:
        print("rendering   no Vulkan device; none is needed (Debian's chromium includes one in software)")
    if has_screen():
        print(as_typed("screen      yes: cutgrammar view opens rerun"))
    else:
        print(as_typed("screen      none: use cutgrammar view RUN TRIAL --save FILE.rrd and open the file elsewhere"))
    print("browser     " + (browser or "none found: open report.html on another machine"))
    print(f"mlflow at   {store_name()}")
    return 0 if physics and all(versions.values()) else 1


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _works(code: str, seconds: float = 120.0) -> bool:
    """Whether a new interpreter runs `code` without an error; a missing driver can crash or stop the process."""
    try:
        subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=seconds, check=True)
    except subprocess.SubprocessError:
        return False
    return True
