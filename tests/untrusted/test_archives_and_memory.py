"""What a stranger packed takes no more memory than it says and may."""

import io
import sys
import zipfile

import numpy as np
import pytest

from cutgrammar.untrusted.archives import read_arrays
from cutgrammar.untrusted.memory import bounded_memory


def archive(**arrays):
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def with_header(shape, descr="<f8", content=b""):
    out, header = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": descr, "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.npy", header.getvalue() + content)
    return out.getvalue()


def test_arrays_come_back_as_they_were_written():
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([1], dtype=np.uint32), "c": np.zeros((0, 3))}
    found = read_arrays(archive(**arrays), 1000)
    assert list(found) == ["a", "b", "c"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"PK\x05\x06" + bytes(10),
        archive(a=np.array([print], dtype=object)),
        archive(a=np.array(["text"])),
        archive(a=np.zeros(1_000_000)),
        archive(**{f"a{i}": np.zeros(1) for i in range(100)}),
        with_header((10**15, 3)),
        with_header((10**15, 10**15), content=bytes(8)),
        with_header((-1,), content=bytes(8)),
        with_header((2,), content=bytes(8)),
        with_header((1,), "|O", content=bytes(8)),
    ],
)
def test_hostile_archives_are_value_errors(content):
    with pytest.raises(ValueError, match="."):
        read_arrays(content, 100_000)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no bound on data memory")
def test_memory_is_bounded_inside_the_block_only():
    with pytest.raises(ValueError, match="more than 50 MB"), bounded_memory(50 * 2**20):
        np.ones(100_000_000)
    assert np.ones(20_000_000).sum() == 20_000_000
    with bounded_memory(50 * 2**20):
        assert len(bytes(1000)) == 1000
