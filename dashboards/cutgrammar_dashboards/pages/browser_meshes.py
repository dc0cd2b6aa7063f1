"""Meshes as a browser draws them."""

from typing import Any

import numpy as np

from cutgrammar.geometry.fragment import Fragment
from cutgrammar_dashboards.rendering.food_colours import NEUTRAL, SKIN_AND_FLESH, face_colours

MICROMETRES = 1e6


def browser_mesh(fragment: Fragment, food: str, max_skin_facet: float) -> dict[str, Any]:
    """The mesh of a fragment in the world frame, as JSON: whole micrometres, so that it stays small.

    Args:
        fragment: a mesh in its place.
        food: name of its food, which has the colours.
        max_skin_facet: flat parts that are larger show the flesh [m2]; see `food_colours.largest_facet`.

    Returns:
        `vertices`: 3 n numbers [um]; `skin` and `flesh`: 3 indices for each triangle; `colours`: of both, as in CSS.
    """
    skin, flesh = SKIN_AND_FLESH.get(food, NEUTRAL)
    mesh = fragment.mesh
    is_skin = (face_colours(mesh, food, max_skin_facet) == skin).all(axis=1)
    p_W = fragment.X_WF.apply(mesh.vertices)
    return {
        "vertices": np.rint(p_W * MICROMETRES).astype(np.int64).reshape(-1).tolist(),
        "skin": mesh.faces[is_skin].reshape(-1).tolist(),
        "flesh": mesh.faces[~is_skin].reshape(-1).tolist(),
        "colours": [_css(skin), _css(flesh)],
    }


def _css(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)
