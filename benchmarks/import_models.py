"""Import public models, and write the result of each as one row of benchmarks/imported_models.csv.

    python benchmarks/import_models.py FOLDER

FOLDER contains checkouts of the repositories of MODELS, under the names given there. They are not
part of this repository. A model without a file keeps its old row.
"""

from __future__ import annotations

import argparse
import csv
import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from skywright.errors import SkywrightError
from skywright.evidence.bench.machine import read_commit
from skywright.models.importing.importer import Request, import_robot
from skywright.models.importing.looks import list_looks
from skywright.models.importing.opening import compile_spec, open_file

OUT = Path(__file__).parent / "imported_models.csv"
X500 = "PX4-gazebo-models/models/x500/model.sdf"
COMMIT = str(read_commit()["commit"])
HANGING = "0,0,-0.05,180,0,0"
HEXAGON = tuple(
    f"{0.25 * math.cos(a):.4f},{0.25 * math.sin(a):.4f},0.05,{'cw' if i % 2 else 'ccw'}"
    for i, a in enumerate(math.radians(60.0 * i + 30.0) for i in range(6))
)
"""Rotors of files without rotor positions."""


class Model(NamedTuple):
    """A public model and its import options."""

    name: str
    file: str  # below FOLDER: starts with the name of the repository
    options: dict[str, Any] = {}
    carrier: str = ""  # for an arm: the multirotor that carries it


MODELS = (
    Model("Skydio X2", "mujoco_menagerie/skydio_x2/x2.xml"),
    Model("Crazyflie 2", "mujoco_menagerie/bitcraze_crazyflie_2/cf2.xml", {
        "rotors": ("0.0325,-0.0325,0,ccw", "-0.0325,-0.0325,0,cw", "-0.0325,0.0325,0,ccw",
                   "0.0325,0.0325,0,cw")}),
    Model("Holybro X500", X500),
    Model("Omnicopter", "PX4-gazebo-models/models/omnicopter/model.sdf"),
    Model("Typhoon H480", "rotors_simulator/rotors_gazebo/models/typhoon_h480/typhoon_h480.sdf"),
    Model("Hector", "example-robot-data/robots/hector_description/robots/quadrotor_base.urdf", {
        "rotors": ("0.18,0.18,0.05,ccw", "-0.18,0.18,0.05,cw", "-0.18,-0.18,0.05,ccw",
                   "0.18,-0.18,0.05,cw")}),
    Model("Iris", "example-robot-data/robots/iris_description/robots/iris.urdf"),
    Model("Borinot, 2-joint arm",
          "example-robot-data/robots/borinot_description/urdf/borinot_flying_arm_2.urdf",
          {"rotors": HEXAGON}),
    Model("Hextilt, 5-joint arm",
          "example-robot-data/robots/hextilt_description/urdf/hextilt_flying_arm_5.urdf",
          {"rotors": HEXAGON}),
    Model("Crazyflie 2.x", "gym-pybullet-drones/gym_pybullet_drones/assets/cf2x.urdf"),
    Model("Panda", "mujoco_menagerie/franka_emika_panda/panda.xml", {}, X500),
    Model("UR5e", "mujoco_menagerie/universal_robots_ur5e/ur5e.xml", {}, X500),
    Model("Panda", "example-robot-data/robots/panda_description/urdf/panda.urdf", {}, X500),
    Model("UR5 with gripper", "example-robot-data/robots/ur_description/urdf/ur5_gripper.urdf", {},
          X500),
    Model("Z1", "example-robot-data/robots/z1_description/urdf/z1.urdf", {}, X500),
)  # fmt: skip


def try_model(folder: Path, model: Model, out: Path) -> dict[str, str]:
    """Import one model; return its row."""
    file = folder / model.file
    row = {"model": model.name, "from": model.file.split("/")[0], "format": "", "bodies": "",
           "rotors": "", "joints": "", "gripper": "", "meshes": "", "drawn": "", "not_read": "",
           "outcome": "",
           "deviation": "", "commit": COMMIT}  # fmt: skip
    try:
        opened = open_file(file)
        row["format"] = opened.kind
        row["bodies"] = str(compile_spec(file, opened.spec).nbody - 1)
        row["meshes"] = str(len(list_looks(opened, "")))
        if model.carrier:
            request = Request(folder / model.carrier, arm=file, mount=HANGING, assume=True)
        else:
            request = Request(file, assume=True)
        made = import_robot(request._replace(**model.options), out)
    except SkywrightError as error:
        row["outcome"] = "refused: " + str(error).replace(f"{folder}/", "")
        return row
    what, worst = made.deviations.worst()
    left_out = [note for note in made.notes if note.startswith("mesh left out")]
    row |= {
        "rotors": str(made.rotors), "joints": str(len(made.joints)),
        "drawn": str(made.meshes), "gripper": "yes" if made.gripper else "",
        "deviation": f"{worst:.0e} ({what})",
        "not_read": str(len(left_out)), "outcome": "imported",
    }  # fmt: skip
    return row


def main() -> None:
    """Import all models and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="checkouts of the repositories of MODELS")
    folder = parser.parse_args().folder
    if not any((folder / model.file).is_file() for model in MODELS):
        names = sorted({model.file.split("/")[0] for model in MODELS})
        parser.error(f"{folder}: has no file of MODELS; valid: a folder with {', '.join(names)}")
    old = {}
    if OUT.exists():
        with OUT.open(encoding="utf-8", newline="") as f:
            old = {(row["model"], row["from"]): row for row in csv.DictReader(f)}
    rows = []
    for model in MODELS:
        key = (model.name, model.file.split("/")[0])
        if (folder / model.file).is_file():
            with tempfile.TemporaryDirectory() as scratch:
                row = try_model(folder, model, Path(scratch) / "robot")
            print(row, flush=True)
            rows.append(row)
        elif key in old:
            rows.append({"commit": "", **old[key]})
    with OUT.open("w", encoding="utf-8", newline="") as f:
        writer = csv.DictWriter(f, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    mujoco.set_mju_user_warning(lambda _: None)
    main()
