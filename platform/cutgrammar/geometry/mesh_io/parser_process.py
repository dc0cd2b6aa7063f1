"""The process that parses untrusted mesh files under limits: bytes on stdin; arrays on stdout or an error message.

`mesh_io.files` runs it with the arguments SUFFIX and KEEP. The output is an .npz file with the vertices and faces of
every body, in the file's numbers, and notes on what was changed. The process opens no files and ignores references to
them (materials, textures).
"""

import io
import sys
from typing import Any, cast

import numpy as np
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.bodies import Keep, bodies_in
from cutgrammar.geometry.mesh_io.clouds import oriented_cloud, solid_from
from cutgrammar.geometry.mesh_io.headers import counted_from_the_start
from cutgrammar.untrusted.parser_processes import REFUSED, limit_this_process


def prepare() -> None:
    """Load the compiled loops, which takes longer than most meshes, by reading a mesh that is no file."""
    cube = trimesh.creation.box()
    bodies_in(np.asarray(cube.vertices), np.asarray(cube.faces), "all")


def main() -> int:
    """Read, repair and write one mesh."""
    limit_this_process()
    suffix, keep = sys.argv[1:3]
    read = sys.stdin.buffer.read()
    try:
        data = io.BytesIO(counted_from_the_start(read) if suffix == ".obj" else read)
        parsed: Any = trimesh.load(data, file_type=suffix[1:], force=None, process=False, skip_materials=True)
        if isinstance(parsed, trimesh.Scene):
            parsed = parsed.to_mesh()
        if isinstance(parsed, trimesh.PointCloud):
            cloud, notes = oriented_cloud(np.asarray(parsed.vertices, dtype=np.float64), _normals_of(parsed))
            bodies: tuple[Mesh, ...] = (solid_from(cloud),)
            notes += (f"a surface was made of {len(cloud.points)} points",)
        elif isinstance(parsed, trimesh.Trimesh):
            vertices, faces = np.asarray(parsed.vertices, dtype=np.float64), np.asarray(parsed.faces)
            bodies, notes = bodies_in(vertices, faces, cast(Keep, keep))
        else:
            raise InputError("is empty: it has no triangles; export it again")
    except InputError as error:
        print(error, file=sys.stderr)
        return REFUSED
    arrays: dict[str, Any] = {f"vertices{i}": body.vertices for i, body in enumerate(bodies)}
    arrays |= {f"faces{i}": body.faces for i, body in enumerate(bodies)}
    out = io.BytesIO()
    np.savez(out, notes=np.array(notes, dtype=np.str_), **arrays)
    sys.stdout.buffer.write(out.getvalue())
    return 0


def _normals_of(cloud: Any) -> Any:
    """(n, 3) normals of a point cloud in a PLY file, or None."""
    raw = cloud.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    names = set(raw if isinstance(raw, dict) else raw.dtype.names or ())
    for prefix in ("n", "normal_"):
        if {f"{prefix}{axis}" for axis in "xyz"} <= names:
            return np.column_stack([np.asarray(raw[f"{prefix}{axis}"], dtype=np.float64).ravel() for axis in "xyz"])
    return None


if __name__ == "__main__":
    sys.exit(main())
