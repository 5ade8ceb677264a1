"""Array types that most modules use."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Samples = NDArray[Any]
"""Rows of a recording, with its columns as fields."""
Table = NDArray[Any]
"""Rows of a reference over time, with its columns as fields."""
