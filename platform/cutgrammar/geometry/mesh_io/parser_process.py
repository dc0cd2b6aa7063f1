"""The process that parses untrusted mesh files under limits: bytes on stdin; two arrays on stdout or an error message.

`mesh_io.files` runs it as `python -m cutgrammar.geometry.mesh_io.parser_process SUFFIX UNIT KIND`. KIND is "food", or
"scan" for a mesh or point cloud that keeps its position. The process opens no files and ignores references to them
(materials, textures, other buffers).
"""

import io
import resource
import sys

MAX_MEMORY = 4 * 2**30
"""Address space of the process [bytes]."""
MAX_SECONDS = 90
"""Processor time of the process [s]."""
REFUSED = 3
"""Exit code for invalid files; the last line of stderr is the reason."""


def main() -> int:
    """Read, repair and write one mesh."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_SECONDS, MAX_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np
    import trimesh

    from cutgrammar.errors import InputError
    from cutgrammar.geometry.fragment import Cloud, Mesh
    from cutgrammar.geometry.mesh_io.repair import cloud_in_place, food_from, solid_in_place

    suffix, unit, kind = sys.argv[1:4]
    data = io.BytesIO(sys.stdin.buffer.read())
    parsed = trimesh.load(data, file_type=suffix.removeprefix("."), force=None, process=False, skip_materials=True)
    if isinstance(parsed, trimesh.Scene):
        parsed = parsed.to_mesh()
    try:
        if kind == "scan" and isinstance(parsed, trimesh.PointCloud):
            raw = parsed.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
            if not {"nx", "ny", "nz"} <= set(raw if isinstance(raw, dict) else raw.dtype.names or ()):
                raise InputError(
                    "is a point cloud without normals (nx ny nz); estimate them in a point-cloud editor first"
                )
            normals = np.column_stack([np.asarray(raw[axis], dtype=np.float64).ravel() for axis in ("nx", "ny", "nz")])
            shape: Mesh | Cloud = cloud_in_place(np.asarray(parsed.vertices, dtype=np.float64), normals, unit or None)
        elif isinstance(parsed, trimesh.Trimesh):
            read = food_from if kind == "food" else solid_in_place
            shape = read(np.asarray(parsed.vertices, dtype=np.float64), np.asarray(parsed.faces), unit or None)
        else:
            raise InputError("is empty: it has no triangles; export it again")
    except InputError as error:
        print(error, file=sys.stderr)
        return REFUSED
    out = io.BytesIO()
    for array in (shape.vertices, shape.faces) if isinstance(shape, Mesh) else (shape.points, shape.normals):
        np.save(out, array, allow_pickle=False)
    sys.stdout.buffer.write(out.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
