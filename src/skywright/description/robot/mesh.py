"""Triangle meshes with which parts of a robot are drawn: `[robot.meshes.NAME]`, from an import.

The file contains them as text, so that a robot file, a run's directory and a page require no other
file: counts (2 uint32), lower corner and step of a grid (4 float32), vertices on it (uint16), faces
(uint16), deflated, as base64.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from skywright.core.spec import Spec

MAX_TRIANGLES = 24_000
"""Limit per table and per imported robot: a page requires 64 bytes per triangle."""
MAX_VERTICES = 2**16
FAR = 20.0  # m, from the origin of the part
_HEAD = np.dtype([("n", "<u4"), ("m", "<u4"), ("low", "<f4", 3), ("step", "<f4")])
_LARGEST = _HEAD.itemsize + 6 * (MAX_VERTICES + MAX_TRIANGLES)


class MeshTable(Spec):
    """A mesh that is drawn instead of a part's shapes. It does not collide."""

    on: str = "platform"  # or the name of a link
    # colour of all its triangles, #rrggbb
    color: str = Field(default="#8a929c", pattern=r"^#[0-9a-fA-F]{6}$")
    data: str  # the triangles, in the frame of the part (description/robot/mesh.py)

    @field_validator("data")
    @classmethod
    def _holds_triangles(cls, data: str) -> str:
        decode_mesh(data)
        return data

    @property
    def rgb(self) -> tuple[float, float, float]:
        """Red, green, blue in 0 to 1."""
        r, g, b = (int(self.color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        return r, g, b


def encode_mesh(vertices: NDArray[Any], faces: NDArray[Any]) -> str:
    """Encode vertices (n, 3) m, rounded to 1/65535 of their extent, and triangles (m, 3)."""
    head = np.zeros(1, _HEAD)
    low = vertices.min(axis=0).astype("<f4")
    step = np.float32(max(float(np.max(vertices - low)) / 65535.0, 1e-9))
    head["n"], head["m"], head["low"], head["step"] = len(vertices), len(faces), low, step
    grid = np.clip(np.rint((vertices - low) / step), 0, 65535).astype("<u2")
    raw = head.tobytes() + grid.tobytes() + faces.astype("<u2").tobytes()
    return base64.b64encode(zlib.compress(raw, 9)).decode("ascii")


def decode_mesh(data: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (n, 3) m and triangles (m, 3); raises ValueError on anything else."""
    try:
        inflate = zlib.decompressobj()
        raw = inflate.decompress(base64.b64decode(data, validate=True), _LARGEST + 1)
    except (ValueError, zlib.error):
        raise ValueError("holds no triangles; `skywright import` writes them") from None
    head = np.frombuffer(raw[: _HEAD.itemsize].ljust(_HEAD.itemsize, b"\0"), _HEAD)[0]
    n, m, at = int(head["n"]), int(head["m"]), _HEAD.itemsize
    if not (0 < n <= MAX_VERTICES and 0 < m <= MAX_TRIANGLES) or len(raw) != at + 6 * (n + m):
        raise ValueError(f"holds {m} triangles of {n} vertices; valid: 1 to {MAX_TRIANGLES}, whole")
    grid = np.frombuffer(raw, "<u2", 3 * n, at).reshape(n, 3)
    faces = np.frombuffer(raw, "<u2", 3 * m, at + 6 * n).reshape(m, 3).astype(np.int64)
    vertices = head["low"].astype(float) + float(head["step"]) * grid
    if faces.max() >= n or not np.all(np.abs(vertices) <= FAR):
        raise ValueError(
            f"has a vertex that does not exist, or one that is farther away than {FAR:g} m"
        )
    return vertices, faces
