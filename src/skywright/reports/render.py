"""Software renderer for a still picture of a 3-D scene, without graphics card or display.

Triangles go through a depth buffer (perspective: linear interpolation of 1/z, Blinn, "Hyperbolic
interpolation", IEEE CG&A 12(4), 1992); shading is deferred; shadows come from a second depth buffer
seen from the sun (Williams, SIGGRAPH 1978). Colours are in 0..1.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Ints
from skywright.core.user_code import njit

SUN = np.array([-0.75, -0.6, 1.2]) / math.sqrt(0.75**2 + 0.6**2 + 1.2**2)
SHADOW_SIZE = 2048
GROUND = np.array([0.93, 0.935, 0.945])
SKY = np.array([1.0, 1.0, 1.0])


class Item(NamedTuple):
    """A mesh in W: vertices (n, 3) m, triangles (m, 3), colours (n, 3), one opacity."""

    vertices: Array
    faces: Ints
    colours: Array
    opacity: float = 1.0


class Camera(NamedTuple):
    """A pinhole camera at `position` that points at `look_at` (m, in W), z up."""

    position: Array
    look_at: Array
    fov: float = math.radians(30.0)  # vertical


@njit(cache=True)
def _fill_buffer(
    xy: Array, inverse: Array, faces: Ints, near: Array,
    triangle: Ints, weight: Array, test: Array,
) -> None:  # fmt: skip
    """Draw triangles into a buffer: nearest index, its barycentric weights, 1/z (larger: nearer).

    xy (n, 2) pixels; inverse (n,) 1/z; near (h, w) current 1/z; `test` (h, w): minimum 1/z to draw.
    """
    height, width = near.shape
    for k in range(faces.shape[0]):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        if inverse[a] <= 0.0 or inverse[b] <= 0.0 or inverse[c] <= 0.0:
            continue
        x0, y0, x1, y1, x2, y2 = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if abs(area) < 1e-12:
            continue
        left = max(math.floor(min(x0, x1, x2)), 0)
        right = min(math.ceil(max(x0, x1, x2)), width - 1)
        top = max(math.floor(min(y0, y1, y2)), 0)
        bottom = min(math.ceil(max(y0, y1, y2)), height - 1)
        for j in range(top, bottom + 1):
            for i in range(left, right + 1):
                px, py = i + 0.5, j + 0.5
                u = ((x1 - px) * (y2 - py) - (x2 - px) * (y1 - py)) / area
                v = ((x2 - px) * (y0 - py) - (x0 - px) * (y2 - py)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * inverse[a] + v * inverse[b] + w * inverse[c]
                if z <= near[j, i] or z < test[j, i]:
                    continue
                near[j, i] = z
                triangle[j, i] = k
                weight[j, i, 0] = u * inverse[a] / z
                weight[j, i, 1] = v * inverse[b] / z
                weight[j, i, 2] = w * inverse[c] / z


def render_scene(
    items: list[Item], camera: Camera, width: int, height: int, samples: int = 2
) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3) of the items on a ground at z = 0 in sunlight.

    `samples`: each pixel is the mean of samples x samples subpixels.
    """
    w, h = width * samples, height * samples
    axes, focal = _look(camera), 0.5 * h / math.tan(0.5 * camera.fov)
    solid = _merge([i for i in items if i.opacity >= 1.0])
    shadow = _build_shadow(solid)
    rays = _build_rays(axes, focal, w, h)
    image = _shade_ground(camera, rays, shadow)
    depth = np.zeros((h, w))
    _draw(image, depth, solid, camera, axes, focal, shadow, 1.0, write=True)
    for item in items:
        if item.opacity < 1.0:
            _draw(image, depth, item, camera, axes, focal, shadow, item.opacity, write=False)
    image = image.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(255.0 * image + 0.5, 0, 255), np.uint8)


def _look(camera: Camera) -> Array:
    """Return the camera axes as rows: right, down, forward, in W."""
    forward = camera.look_at - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def _merge(items: list[Item]) -> Item:
    starts = np.cumsum([0] + [len(i.vertices) for i in items[:-1]])
    return Item(
        np.concatenate([i.vertices for i in items]),
        np.concatenate([i.faces + s for i, s in zip(items, starts, strict=True)]),
        np.concatenate([i.colours for i in items]),
    )


def _build_rays(axes: Array, focal: float, w: int, h: int) -> Array:
    x, y = np.meshgrid(np.arange(w) + 0.5 - w / 2, np.arange(h) + 0.5 - h / 2)
    rays = np.stack([x / focal, y / focal, np.ones_like(x)], axis=-1) @ axes
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


class _Shadow(NamedTuple):
    """Depth map seen from the sun."""

    axes: Array  # rows: two across, one towards the sun
    low: Array  # (2,) m
    scale: float  # cells per m
    height: Array  # (size, size) m towards the sun, of the highest surface


def _build_shadow(solid: Item) -> _Shadow:
    across = np.cross(SUN, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(SUN, across), SUN])
    p = solid.vertices @ axes.T
    low, high = p[:, :2].min(axis=0) - 0.02, p[:, :2].max(axis=0) + 0.02
    scale = SHADOW_SIZE / float(np.max(high - low))
    base = float(p[:, 2].min()) - 1.0
    buffer = np.zeros((SHADOW_SIZE, SHADOW_SIZE))
    _fill_buffer(
        (p[:, :2] - low) * scale, p[:, 2] - base, solid.faces, buffer,
        np.full(buffer.shape, -1), np.zeros((*buffer.shape, 3)), np.zeros(buffer.shape),
    )  # fmt: skip
    return _Shadow(axes, low, scale, np.where(buffer > 0.0, buffer + base, -np.inf))


def _light(shadow: _Shadow, points: Array) -> Array:
    """Return the share (n,) of sunlight at points (n, 3), softened over a few cells."""
    p = points @ shadow.axes.T
    cell = (p[:, :2] - shadow.low) * shadow.scale
    total = np.zeros(len(points))
    offsets = [(x, y) for x in (-3.0, -1.0, 1.0, 3.0) for y in (-3.0, -1.0, 1.0, 3.0)]
    for x, y in offsets:
        i = np.floor(cell[:, 0] + x).astype(int)
        j = np.floor(cell[:, 1] + y).astype(int)
        inside = (i >= 0) & (j >= 0) & (i < SHADOW_SIZE) & (j < SHADOW_SIZE)
        top = np.full(len(points), -np.inf)
        top[inside] = shadow.height[j[inside], i[inside]]
        total += top < p[:, 2] + 0.012
    return total / len(offsets)


def _shade_ground(camera: Camera, rays: Array, shadow: _Shadow) -> Array:
    image = np.empty_like(rays)
    image[:] = SKY
    down = rays[..., 2] < -1e-3
    away = -camera.position[2] / rays[..., 2][down]
    points = camera.position + away[:, None] * rays[down]
    colour = GROUND * (0.80 + 0.20 * _light(shadow, points))[:, None]
    line = np.abs(points[:, :2] / 0.5 - np.round(points[:, :2] / 0.5)) * 0.5
    colour = np.where((line.min(axis=1) < 0.004)[:, None], 0.95 * colour, colour)
    start = float(np.linalg.norm(camera.look_at - camera.position))
    fade = np.clip((away - 1.1 * start) / (1.6 * start), 0.0, 1.0)[:, None]
    image[down] = (1.0 - fade) * colour + fade * SKY
    return image


def _draw(
    image: Array, depth: Array, item: Item, camera: Camera, axes: Array, focal: float,
    shadow: _Shadow, opacity: float, *, write: bool,
) -> None:  # fmt: skip
    """Draw one mesh over the image; `write`: it occludes later meshes."""
    h, w = depth.shape
    p = (item.vertices - camera.position) @ axes.T
    z = np.where(p[:, 2] > 0.05, p[:, 2], -1.0)
    xy = p[:, :2] / z[:, None] * focal + [w / 2, h / 2]
    triangle, weight = np.full(depth.shape, -1), np.zeros((h, w, 3))
    near = depth if write else np.zeros(depth.shape)
    _fill_buffer(xy, 1.0 / z, item.faces, near, triangle, weight, depth if not write else near * 0)
    hit = triangle >= 0
    corner = item.faces[triangle[hit]]
    u = weight[hit][:, :, None]
    points = np.sum(item.vertices[corner] * u, axis=1)
    colour = np.sum(item.colours[corner] * u, axis=1)
    normal = np.sum(_compute_normals(item)[corner] * u, axis=1)
    view = camera.position - points
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    normal *= np.where(np.sum(normal * view, axis=1) < 0.0, -1.0, 1.0)[:, None]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    lit = _light(shadow, points + 0.004 * normal) if write else np.ones(len(points))
    sun = np.clip(normal @ SUN, 0.0, None) * lit
    middle = view + SUN
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    shine = 0.22 * lit * np.clip(np.sum(normal * middle, axis=1), 0.0, None) ** 40
    ambient = 0.50 + 0.12 * normal[:, 2]
    shaded = colour * (ambient + 0.55 * sun)[:, None] + shine[:, None]
    image[hit] = (1.0 - opacity) * image[hit] + opacity * np.clip(shaded, 0.0, 1.0)


def _compute_normals(item: Item) -> Array:
    """Return vertex normals (n, 3), the mean over the triangles that share the vertex."""
    a, b, c = (item.vertices[item.faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    normals = np.zeros_like(item.vertices)
    for i in range(3):
        np.add.at(normals, item.faces[:, i], face)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
