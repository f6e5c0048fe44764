"""Binary frames: `api/frames.md` has their layout."""

from __future__ import annotations

import sys
from array import array
from typing import Any, NamedTuple, Optional

_SCALARS = ("displacement_mm", "error_mm")


class Frame(NamedTuple):
    """Skin of one step."""

    #: Coordinates x, y, z of vertex 0, 1, …, LPS mm.
    positions_mm: array[float]
    #: Length of each vertex's displacement from rest, mm.
    displacement_mm: array[float]
    #: Signed distance to the reference, mm, negative behind it; None without an error map.
    error_mm: Optional[array[float]]


def decode_frame(data: bytes, vertices: int) -> Frame:
    """Decodes the answer of `get_step_frame`. Raises `ValueError` when the length does not fit the number of vertices."""
    values = array("f", data)
    _from_little_endian(values)
    scalars, rest = divmod(len(values) - 3 * vertices, vertices)
    if rest or not 1 <= scalars <= len(_SCALARS):
        expected = (16 * vertices, 20 * vertices, len(data))
        raise ValueError("a frame of %d vertices has %d or %d bytes, found %d" % ((vertices,) + expected))
    error = values[4 * vertices :] if scalars == 2 else None
    return Frame(values[: 3 * vertices], values[3 * vertices : 4 * vertices], error)


def decode_topology(data: bytes) -> array[int]:
    """Decodes the answer of `get_topology`: three vertex numbers for each triangle, counter-clockwise from outside."""
    values = array("I", data)
    _from_little_endian(values)
    return values


def _from_little_endian(values: array[Any]) -> None:
    if sys.byteorder == "big":
        values.byteswap()
