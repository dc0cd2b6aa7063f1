import pytest
import trimesh

from cutgrammar.geometry.fragment import Mesh
from cutgrammar_dashboards.figures.layout.sheet import write_sheet
from pictures.reconstruction import Pair, reconstruction_sheet


def pair(iou, found=True):
    box = trimesh.creation.box([1.0, 1.2, 2.0])
    mesh = Mesh(box.vertices, box.faces)
    return Pair(mesh, Mesh(0.9 * box.vertices, box.faces) if found else None, iou)


def test_every_fragment_is_beside_its_reconstruction_with_the_iou(tmp_path):
    figure = reconstruction_sheet({"seen": [pair(0.9), pair(0.5)], "never seen": [pair(0.0, found=False)]}, "Boxes")
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {"Boxes", "seen", "never seen", "IoU 0.90", "IoU 0.50", "IoU 0.00"} <= texts
    assert len(figure.axes[0].images) == 5  # where the decoder found nothing, nothing is drawn
    write_sheet(figure, tmp_path / "boxes.png")
    assert (tmp_path / "boxes.png").read_bytes().startswith(b"\x89PNG")


def test_a_sheet_without_fragments_is_refused():
    with pytest.raises(ValueError, match="no fragments"):
        reconstruction_sheet({"seen": []}, "Nothing")
