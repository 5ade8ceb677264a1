"""Geometries of the platform and its landing gear in a compiled scene."""

import mujoco


def pick_airframe_geoms(model: mujoco.MjModel, *starts: str) -> list[int]:
    """Return the geoms of the platform and its landing gear whose names begin with `starts`.

    A link may be named `leg1`, so names alone do not tell the gear.
    """
    bodies = {model.body("platform").id, model.body("gear").id}
    return [
        i for i in range(model.ngeom)
        if int(model.geom_bodyid[i]) in bodies and model.geom(i).name.startswith(starts)
    ]  # fmt: skip
