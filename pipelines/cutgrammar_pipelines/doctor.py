"""What this machine has and lacks, each with how to get it."""

import os
import platform
import shutil
import subprocess
import sys
from importlib.metadata import version

PACKAGES = ("numpy", "scipy", "torch", "numba", "trimesh", "manifold3d", "ray", "sapien", "mlflow", "rerun-sdk")


def doctor() -> int:
    """Print a line for each part; return 0, or 1 where a part without which nothing runs is missing."""
    print(f"python      {platform.python_version()} at {sys.prefix}")
    print(f"cores       {os.cpu_count()}")
    for package in PACKAGES:
        print(f"{package:<11} {version(package)}")
    physics = _works("import sapien; sapien.Scene([sapien.physx.PhysxCpuSystem()])")
    print(
        "physics     " + ("SAPIEN steps on the CPU" if physics else "SAPIEN does not start: --world bench still works")
    )
    vulkan = _works("import sapien; sapien.render.RenderSystem()")
    print(
        "rendering   "
        + (
            "a Vulkan device was found"
            if vulkan
            else "no Vulkan device: nothing here needs one yet (Debian's chromium package brings one in software)"
        )
    )
    viewer = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) or sys.platform != "linux"
    print(
        "screen      "
        + (
            "yes: cutgrammar view opens rerun"
            if viewer
            else "none: use cutgrammar view --save FILE.rrd, open it elsewhere"
        )
    )
    browser = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("firefox")
    print("browser     " + (browser or "none found here: copy report.html to where one is"))
    print(f"mlflow at   {os.environ.get('MLFLOW_TRACKING_URI', 'sqlite:///mlflow.db in the current folder')}")
    return 0 if physics else 1


def _works(code: str) -> bool:
    """Whether a fresh interpreter runs `code` to its end; a driver that is missing can crash the process."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=False).returncode == 0
