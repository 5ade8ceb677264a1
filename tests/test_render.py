"""Still pictures: shapes where perspective puts them, hidden surfaces, glass, shadows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skywright.reports.render import Camera, Item, render_scene


def _ball(radius: float, centre: tuple[float, float, float], colour: tuple[float, ...]) -> Item:
    u, v = np.meshgrid(np.linspace(0, math.pi, 25), np.linspace(0, 2 * math.pi, 49), indexing="ij")
    p = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    n = 49
    i, j = (x.ravel() for x in np.meshgrid(np.arange(24), np.arange(48), indexing="ij"))
    a = i * n + j
    faces = np.concatenate(
        [np.column_stack([a, a + n, a + 1]), np.column_stack([a + 1, a + n, a + n + 1])]
    )
    vertices = radius * p.reshape(-1, 3) + np.array(centre)
    return Item(vertices, faces, np.broadcast_to(np.array(colour), vertices.shape))


EYE = Camera(np.array([-4.0, 0.0, 5.0]), np.array([0.0, 0.0, 5.0]), math.radians(30.0))


def _red(image: np.ndarray) -> np.ndarray:
    return (image[..., 0] > 1.5 * image[..., 1]) & (image[..., 0] > 30)


def test_ball_is_drawn_where_perspective_puts_it() -> None:
    image = render_scene([_ball(0.3, (0.0, 0.0, 5.0), (1.0, 0.05, 0.05))], EYE, 120, 90)
    shape = _red(image)
    # the silhouette of a ball: a circle of angular radius asin(r / d)
    radius = math.tan(math.asin(0.3 / 4.0)) * 45 / math.tan(math.radians(15.0))
    assert np.count_nonzero(shape) == pytest.approx(math.pi * radius**2, rel=0.06)
    rows, columns = np.nonzero(shape)
    assert rows.mean() == pytest.approx(44.5, abs=0.6)
    assert columns.mean() == pytest.approx(59.5, abs=0.6)


def test_what_is_nearer_hides_what_is_behind() -> None:
    near, far = _ball(0.3, (0.0, 0.0, 5.0), (1.0, 0.05, 0.05)), _ball(0.2, (1, 0, 5), (0, 0, 1.0))
    for items in ([near, far], [far, near]):
        image = render_scene(items, EYE, 60, 45)
        assert _red(image)[22, 30]
    glass = near._replace(opacity=0.5)
    pixel = render_scene([far, glass], EYE, 60, 45)[22, 30]
    assert pixel[0] > 60 and pixel[2] > 60  # both show


def test_shadow_falls_on_the_ground_away_from_the_sun() -> None:
    eye = Camera(np.array([0.01, 0.0, 8.0]), np.array([0.0, 0.0, 0.0]), math.radians(40.0))
    ball = _ball(0.3, (0.0, 0.0, 0.8), (1.0, 0.05, 0.05))
    image = render_scene([ball], eye, 120, 120).astype(int)
    free = ~_red(image)
    dark = free & (image.sum(axis=2) < image[2, 2].sum() - 60)
    assert dark.sum() > 50
    # the sun stands at -x, -y: seen from above with x up (towards the far side), shadow at +x, +y
    rows, columns = np.nonzero(dark)
    assert abs(rows.mean() - 60) + abs(columns.mean() - 60) > 8
