"""Peaks of sampled signals, to a fraction of a sample."""

from skywright.core.arrays import Array


def find_vertex(x: Array, i: int) -> float:
    """Return the maximum of the parabola through samples i - 1 to i + 1 of `x` (n,).

    The offset from i lies in -0.5 to 0.5 samples; it is 0 at an end, or if the parabola has no
    maximum.
    """
    if not 0 < i < x.size - 1:
        return 0.0
    a, b, c = float(x[i - 1]), float(x[i]), float(x[i + 1])
    bend = a - 2 * b + c
    return 0.0 if bend >= 0 else min(max(0.5 * (a - c) / bend, -0.5), 0.5)
