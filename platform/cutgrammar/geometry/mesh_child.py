"""The process in which strangers' mesh files are parsed, under limits: bytes on stdin, two arrays or a reason out.

Run as `python -m cutgrammar.geometry.mesh_child SUFFIX UNIT` by `mesh_files.read_food`. It opens no file, and whatever
a file's text points at (materials, textures, other buffers) is not looked for.
"""

import io
import resource
import sys

MEMORY = 4 * 2**30
"""Address space of the process [bytes]."""
SECONDS = 90
"""Processor time."""
REFUSED = 3
"""Exit code: what is wrong stands in the last line of stderr."""


def main() -> int:
    """Read, repair and write one mesh."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np
    import trimesh

    from cutgrammar.errors import InputError
    from cutgrammar.geometry.mesh_repair import food_of

    suffix, unit = sys.argv[1:3]
    data = io.BytesIO(sys.stdin.buffer.read())
    parsed = trimesh.load_mesh(data, file_type=suffix.removeprefix("."), process=False, skip_materials=True)
    try:
        if not isinstance(parsed, trimesh.Trimesh):
            raise InputError("is empty: it holds no triangles; export it again")
        mesh = food_of(np.asarray(parsed.vertices, dtype=np.float64), np.asarray(parsed.faces), unit or None)
    except InputError as error:
        print(error, file=sys.stderr)
        return REFUSED
    out = io.BytesIO()
    np.save(out, mesh.vertices, allow_pickle=False)
    np.save(out, mesh.faces, allow_pickle=False)
    sys.stdout.buffer.write(out.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())
