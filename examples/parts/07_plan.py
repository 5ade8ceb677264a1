"""A motion planned in your own scene of shapes."""

import skywright
from skywright import Box, Cylinder, Sphere

scene: list[Box | Cylinder | Sphere] = [
    Box(centre=(2.0, 0.0, 1.0), size=(0.2, 2.0, 2.0)),
    Cylinder(start=(2.0, 2.0, 0.0), end=(2.0, 2.0, 3.0), radius=0.1),
    Sphere(centre=(2.0, -2.0, 1.0), radius=0.3),
]
way = skywright.plan_motion("othex", (0.0, 0.0, 1.0, 0.0), (4.0, 0.0, 1.0, 0.0), scene, margin=0.2)
print(f"{len(way.p_WB)} corners, {way.clearance:.2f} m from everything")
print(way.p_WB.round(2))
