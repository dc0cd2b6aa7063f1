"""Recorded demonstrations as files: the schema of the JSON that describes one, and reading it.

The page "Your own demonstrations" (docs/howto/import.md) shows an example. Files are untrusted: their size and every
value in them are checked here, before anything is computed from them.
"""

from dataclasses import KW_ONLY
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from cutgrammar.errors import InputError
from cutgrammar.settings.bounds import CHECKED
from cutgrammar.untrusted import read_json, shortened

FORMAT, VERSION = "cutgrammar demonstration", 1
MAX_BYTES = 5_000_000
MAX_CUTS = 500
ONE_OF = {"cuts": "cut", "objects": "object", "products": "product", "categories": "category"}
LARGEST = 1e6
"""Of any number, in the file's unit."""

Category = Literal["chunks", "slices", "cubes", "strips"]
Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]
Name = Annotated[str, Field(strict=True, pattern=r"^\w[\w .+-]{0,63}$")]
"""Letters, digits, spaces and . + - _, at most 64."""
MeshName = Annotated[str, Field(strict=True, min_length=1, max_length=200, pattern=r"^[\w .+/-]+$")]


@dataclass(frozen=True, config=CHECKED)
class RecordedPose:
    """The pose X_WF of a mesh file's own axes in the world frame W, whose z points up.

    Attributes:
        position: x, y, z of the origin of the file's axes, in the file's unit.
        quaternion: w, x, y, z.
    """

    position: tuple[Number, Number, Number]
    quaternion: tuple[Number, Number, Number, Number] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, config=CHECKED)
class RecordedPlane:
    """The plane n.v + d = 0 in W, where the fragment lies when it is cut.

    Attributes:
        normal: n, of length 1.
        offset: d, in the file's unit.
    """

    normal: tuple[Number, Number, Number]
    offset: Number


@dataclass(frozen=True, config=CHECKED)
class RecordedObject:
    """An object before the first cut.

    Attributes:
        name: by which cuts call it.
        food: name of its food.
        mesh: file of its closed mesh, within the folder.
        pose: where it lies.
    """

    name: Name
    food: Name
    mesh: MeshName
    pose: RecordedPose


@dataclass(frozen=True, config=CHECKED)
class RecordedProduct:
    """A fragment that a cut made.

    Attributes:
        name: by which later cuts call it.
        mesh: file of its closed mesh, in a frame of its own or in that of the fragment cut; None: what the plane makes.
        pose: where it lies after the cut; None: the mesh is in the frame of the fragment cut, which did not move.
        category: of a fragment of the goal; None: the only category of the demonstration, if there is one.
    """

    name: Name
    _: KW_ONLY
    mesh: MeshName | None = None
    pose: RecordedPose | None = None
    category: Category | None = None


@dataclass(frozen=True, config=CHECKED)
class RecordedCut:
    """A cut.

    Attributes:
        fragment: name of what was cut.
        plane: the plane.
        products: what came out; without meshes first those on the side that the normal points to, the larger first.
        poses: where other fragments lie after the cut, if they have moved.
    """

    fragment: Name
    plane: RecordedPlane
    products: Annotated[tuple[RecordedProduct, ...], Field(min_length=2, max_length=200)]
    poses: Annotated[dict[Name, RecordedPose], Field(max_length=1000)] = Field(default_factory=dict)


def _distinct(categories: tuple[Category, ...]) -> tuple[Category, ...]:
    if len(set(categories)) < len(categories):
        raise ValueError("each category stands once")
    return categories


@dataclass(frozen=True, config=CHECKED)
class RecordedDemonstration:
    """One demonstration.

    Attributes:
        format: `FORMAT`.
        version: of the format.
        unit: of all lengths here and in the mesh files.
        categories: into which the objects were cut.
        objects: before the first cut.
        cuts: in their order.
        demonstrator: who cut.
    """

    format: Literal["cutgrammar demonstration"]
    version: Literal[1]
    unit: Literal["mm", "cm", "m", "in"]
    categories: Annotated[tuple[Category, ...], Field(min_length=1), AfterValidator(_distinct)]
    objects: Annotated[tuple[RecordedObject, ...], Field(min_length=1, max_length=20)]
    cuts: Annotated[tuple[RecordedCut, ...], Field(min_length=1, max_length=MAX_CUTS)]
    demonstrator: Name | None = None


def read_recorded(file: Path) -> RecordedDemonstration:
    """Read and check the description of one demonstration.

    Raises:
        InputError: it cannot be read, is no JSON, or does not follow the schema; the message names file and place.
    """
    try:
        data = read_json(file, MAX_BYTES)
    except InputError:  # which names the file
        raise
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{file} is not JSON: {error}") from None
    try:
        return TypeAdapter(RecordedDemonstration).validate_python(data)
    except ValidationError as error:
        raise InputError(f"{file}: {_explained(error)}; docs/howto/import.md has an example") from None


def _explained(error: ValidationError) -> str:
    """What is wrong first, and where."""
    first = error.errors(include_url=False, include_context=False)[0]
    words = list[str]()
    for part in first["loc"]:
        if isinstance(part, int):  # the third of "cuts" is cut 3
            words[-1] = f"{ONE_OF.get(words[-1], words[-1])} {part + 1}"
        else:
            words.append(str(part))
    if not isinstance(first["input"], dict | list):
        words.append(shortened(first["input"]))
    what = {
        "missing": "is missing",
        "unexpected_keyword_argument": "is unknown",
        "string_pattern_mismatch": "is not made of letters, digits, spaces and . + - _ alone",
    }.get(first["type"], first["msg"][:1].lower() + first["msg"][1:])
    return f"{', '.join(words) or 'the file'}: {what}"
