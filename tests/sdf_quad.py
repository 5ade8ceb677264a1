"""A quadrotor in SDF, to which tests of the importer add parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import imported_models as models
from skywright.description.robot.loader import load_robot
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.sdf import Sdf, read_sdf
from skywright.models.importing.xml_input import read_xml

HUBS = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]
FIXED = '<joint name="pj" type="fixed"><parent>base</parent><child>pod</child></joint>'


def links(parent: str = "base") -> str:
    """The links and joints of four rotors of 20 g."""
    return "".join(
        f"""<link name="prop{i}"><pose>{x} {y} 0.05 0 0 0</pose>
{models.inertial("sdf", 0.02, "0 0 0", models.SMALL)}</link><joint name="spin{i}" type="revolute">
<parent>{parent}</parent><child>prop{i}</child><axis><xyz>0 0 1</xyz></axis></joint>"""
        for i, (x, y) in enumerate(HUBS)
    )


def plugins() -> str:
    return "".join(
        f"""<plugin filename="motor" name="m{i}"><jointName>spin{i}</jointName>
<linkName>prop{i}</linkName><turningDirection>{"ccw" if i % 2 else "cw"}</turningDirection>
<timeConstantUp>0.02</timeConstantUp><timeConstantDown>0.02</timeConstantDown>
<maxRotVelocity>1000</maxRotVelocity><motorConstant>9e-6</motorConstant>
<momentConstant>0.016</momentConstant></plugin>"""
        for i in range(4)
    )


def base() -> str:
    body = models.inertial("sdf", 1.5, "0 0 0", models.BODY)
    return f'<link name="base">{body}</link>{links()}'


def quad(folder: Path, extra: str, version: str = "1.9") -> Path:
    """A quadrotor of 1.58 kg, whose frame is that of the model."""
    text = f'<model name="q">{base()}{plugins()}{extra}</model>'
    return models.write(folder / "q" / "model.sdf", f'<sdf version="{version}">{text}</sdf>')


def take(file: Path, folder: Path) -> tuple[Imported, Any]:
    made = import_robot(Request(file, assume=True), folder / "made")
    return made, load_robot(made.path)[0]


def read(file: Path) -> Sdf:
    return read_sdf(file, read_xml(file))
