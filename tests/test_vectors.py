"""Cross products of arrays of vectors against NumPy's own."""

import numpy as np
import pytest

from skywright.models.vectors import build_cross_matrix, compute_cross

SHAPES = [((3,), (3,)), ((0, 3), (0, 3)), ((5, 3), (3,)), ((4, 3), (2, 4, 3)), ((2, 1, 3), (4, 3))]


@pytest.mark.parametrize(("a", "b"), SHAPES)
def test_products_broadcast(a: tuple[int, ...], b: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    u, v = rng.standard_normal(a), rng.standard_normal(b)
    assert np.array_equal(compute_cross(u, v), np.cross(u, v))
    by_matrix = (build_cross_matrix(u) @ v[..., None])[..., 0]
    assert np.allclose(by_matrix, np.cross(u, v), rtol=0.0, atol=1e-14)
