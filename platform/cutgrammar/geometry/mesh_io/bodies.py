"""From the triangles of an untrusted file to the solid bodies in it, by stated rules, or a reason why there are none.

Rules: coincident vertices are merged; degenerate and repeated triangles and fins are dropped (`shells`); shells of
under `SPECK` of the surface are dropped as dust; holes are filled and meshes simplified as `repair` says; a shell that
lies within a body and faces the other way is its cavity. Every body is one fragment. What else is open, overlaps or
lies within another is refused with its place, unless the user says what to keep.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import manifold3d
import numpy as np
import trimesh

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.mesh_io.repair import (
    MIN_THICKNESS,
    Place,
    oriented,
    refuse_open,
    sound,
    thickness,
    with_small_holes_filled,
)
from cutgrammar.geometry.mesh_io.shells import edge_counts, merged, shells
from cutgrammar.geometry.slicing import mesh_of, solid_of

Keep = Literal["all", "closed", "largest", "union"]
"""Which bodies of a file to keep: all; those that are closed; the largest; or the union of all, as one."""
SPECK = 1e-3
"""Shells of under this share of the surface are dropped as dust."""
OVERLAP = 0.01
"""Bodies may overlap by this share of the smaller one's volume: pieces scanned one by one never fit exactly."""
MAX_BODIES = 200


@dataclass(frozen=True, eq=False)
class _Shell:
    """A closed shell, facing outwards, at size 1.

    Attributes:
        mesh: the shell.
        solid: what it encloses.
        inverted: it faced inwards in the file.
    """

    mesh: Mesh
    solid: manifold3d.Manifold
    inverted: bool


def bodies_in(vertices: Floats, faces: Ints, keep: Keep = "all") -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """The bodies in a file, closed and free of self-intersections, in the file's numbers.

    Args:
        vertices: (n, 3) vertices.
        faces: (m, 3) vertex indices of the triangles.
        keep: which bodies to keep.

    Returns:
        The bodies, in the order of their first triangles, and notes on what was changed.

    Raises:
        InputError: a body cannot be used; the message does not name the file.
    """
    corners = vertices[faces].reshape(-1, 3)
    if not len(corners):
        raise InputError("is empty: it has no triangles; export it again")
    if not np.isfinite(corners).all():
        raise InputError("has coordinates that are not finite (NaN or infinite); export it again")
    size = float(np.ptp(corners, axis=0).max())
    if size <= 0.0:
        raise InputError("is flat: all its vertices are at one point; a solid is needed")
    # Repairs and checks use a copy of size 1 about the origin, so that their tolerances are relative to the size.
    place = Place((corners.min(axis=0) + corners.max(axis=0)) / 2.0, size)
    whole = merged((vertices - place.centre) / size, faces)
    if not len(whole.faces) or thickness(whole.vertices) < MIN_THICKNESS:
        raise InputError("is flat: it has no thickness; a solid is needed")
    parts = shells(whole)
    notes: list[str] = []
    area = sum(part.area for part in parts)
    large = [part for part in parts if part.area >= SPECK * area]
    if len(large) < len(parts):
        notes.append(f"{len(parts) - len(large)} specks of under {SPECK:g} of the surface were dropped")
    closed = _closed([with_small_holes_filled(part) for part in large], keep, place, notes)
    bodies = _solids(closed, keep, notes, place)
    if keep == "largest" and len(bodies) > 1:
        notes.append(f"the largest of {len(bodies)} bodies was kept")
        bodies = [max(bodies, key=lambda body: body.volume)]
    found = []
    for body in bodies:
        own = Place.of(body.vertices)
        usable, note = sound(Mesh(own.inwards(body.vertices), body.faces), own.within(place))
        notes += [note] if note else []
        found.append(Mesh(own.within(place).outwards(usable.vertices), usable.faces))
    return tuple(found), tuple(notes)


def one_body(bodies: Sequence[Mesh]) -> Mesh:
    """The only body.

    Raises:
        InputError: there are several.
    """
    if len(bodies) > 1:
        raise InputError(
            f"has {len(bodies)} separate bodies; one solid is needed; --bodies largest keeps the largest, "
            "or save them one by one"
        )
    return bodies[0]


def _closed(parts: list[trimesh.Trimesh], keep: Keep, place: Place, notes: list[str]) -> list[trimesh.Trimesh]:
    """The closed shells among `parts`.

    Raises:
        InputError: one is open that must not be, or all are.
    """
    counts = [edge_counts(np.asarray(part.faces))[1] for part in parts]
    is_open = [bool((count != 2).any()) for count in counts]
    if not any(is_open):
        return parts
    closed = [part for part, opened in zip(parts, is_open, strict=True) if not opened]
    largest = max(range(len(parts)), key=lambda i: parts[i].area)
    if len(parts) == 1 or not closed or (keep == "largest" and is_open[largest]):
        worst = largest if keep == "largest" else is_open.index(True)
        which = "" if len(parts) == 1 else f"the {'largest' if keep == 'largest' else 'first'} of {len(parts)} bodies "
        refuse_open(parts[worst], counts[worst], place, which)
    if keep in ("closed", "largest"):
        notes.append(f"{len(parts) - len(closed)} of {len(parts)} bodies are open and were left out")
        return closed
    i = is_open.index(True)
    middle = parts[i].vertices.mean(axis=0)
    raise InputError(
        f"has {len(parts)} bodies, of which {sum(is_open)} {'is' if sum(is_open) == 1 else 'are'} open: "
        f"that of {len(parts[i].faces)} faces around {place.text(middle)} has {int((counts[i] == 1).sum())} edges with "
        "only one face; --bodies closed leaves out what is open, --bodies largest keeps the largest body"
    )


def _solids(parts: list[trimesh.Trimesh], keep: Keep, notes: list[str], place: Place) -> list[Mesh]:
    """Shells with their cavities, or the union of all.

    Raises:
        InputError: shells overlap, or lie within another and do not face the other way.
    """
    if len(parts) > MAX_BODIES:
        raise InputError(f"has {len(parts)} bodies; at most {MAX_BODIES} are read; save the fragments in several files")
    closed = [_shell(part) for part in parts]
    order = sorted(range(len(closed)), key=lambda i: -closed[i].mesh.volume)
    cavities: dict[int, list[int]] = {}
    for rank, i in enumerate(order):
        around = None
        for j in order[:rank]:
            share = _shared(closed[i], closed[j])
            if share > 1.0 - OVERLAP:
                around = j  # the smallest body that contains it comes last
            elif share > OVERLAP and keep in ("all", "closed"):
                raise InputError(
                    f"intersects itself: its {len(closed)} shells overlap, two of them by {share:.0%} of the smaller "
                    f"one around {place.text(closed[i].mesh.centroid)}; move them apart or unite them (--bodies union)"
                )
        if around is None or around not in cavities:  # outside, or within a cavity
            cavities[i] = []
        elif closed[i].inverted != closed[around].inverted:
            cavities[around].append(i)
        elif keep in ("all", "closed"):
            raise InputError(
                f"has a body within another, around {place.text(closed[i].mesh.centroid)}, that faces the same way: "
                "the faces of a cavity point into it; turn them round if it is one, or --bodies largest leaves it out"
            )
    if n := sum(map(len, cavities.values())):
        notes.append(f"{n} inner {'shell is a cavity' if n == 1 else 'shells are cavities'}")
    bodies = [_hollow(closed[i], [closed[k] for k in cavities[i]]) for i in range(len(closed)) if i in cavities]
    if keep != "union" or len(bodies) == 1:
        return bodies
    united = manifold3d.Manifold.batch_boolean(list(map(solid_of, bodies)), manifold3d.OpType.Add)
    notes.append(f"{len(bodies)} bodies were united")
    return [mesh_of(united)]


def _shell(part: trimesh.Trimesh) -> _Shell:
    inverted = oriented(part)
    mesh = Mesh(part.vertices, part.faces)
    try:
        return _Shell(mesh, solid_of(mesh), inverted)
    except ValueError as error:
        raise InputError(f"is not the surface of a solid ({error}); clean it in a mesh editor first") from None


def _shared(a: _Shell, b: _Shell) -> float:
    """Share of the smaller solid `a` that also lies in `b`."""
    low = np.maximum(a.mesh.vertices.min(axis=0), b.mesh.vertices.min(axis=0))
    high = np.minimum(a.mesh.vertices.max(axis=0), b.mesh.vertices.max(axis=0))
    if (low >= high).any():
        return 0.0
    return float((a.solid ^ b.solid).volume() / a.mesh.volume)


def _hollow(outer: _Shell, cavities: Sequence[_Shell]) -> Mesh:
    vertices, faces = [outer.mesh.vertices], [outer.mesh.faces]
    for cavity in cavities:
        faces.append(cavity.mesh.faces[:, ::-1] + sum(map(len, vertices)))
        vertices.append(cavity.mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))
