"""SDF files: one model, with the parts of the models that it includes or contains."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from skywright.core.rotations import quat_from_rot
from skywright.errors import InputError
from skywright.models.importing.sdf_frames import Frames, find_canonical, read_pose
from skywright.models.importing.xml_input import MAX_ELEMENTS, MAX_INCLUDES, read_xml

RESOURCES = ("GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")
NEWEST = (1, 12)
"""Newest version of SDF that is read in preference to others of a model's folder."""
CHILD_FRAME = (1, 5)
"""First version of SDF that gives the axes of joints in the frame of the joint."""

Version = tuple[int, int]


def read_model(path: Path, root: ET.Element, above: tuple[Path, ...]) -> ET.Element:
    """Return the model of a file, merged with its nested and included models.

    `above` are the files that include this one, and this one. Raises InputError if a file is
    missing, invalid or circular.
    """
    if len(above) > MAX_INCLUDES:
        raise InputError(f"{path}: more than {MAX_INCLUDES} nested includes")
    models = root.findall("model")
    if len(models) != 1:
        raise InputError(f"{path}: {len(models)} models; an SDF file with one <model> is required")
    version = read_version(root.get("version", "1.9"), f"{path}: version")
    _merge(path, models[0], version < CHILD_FRAME, above)
    return models[0]


def read_version(text: str, what: str) -> Version:
    """Return major and minor number of a version (1.10 is after 1.9); InputError names `what`."""
    found = re.fullmatch(r"([0-9]{1,4})\.([0-9]{1,4})", text.strip())
    if found is None:
        raise InputError(f"{what} is {text.strip()[:80]!r}; valid: MAJOR.MINOR, for example 1.9")
    return int(found[1]), int(found[2])


def _merge(path: Path, model: ET.Element, old: bool, above: tuple[Path, ...]) -> None:
    """Add the parts of included and nested models to `model`."""
    for tag in model.iterfind("link//mesh/uri"):  # beside this file, not the one that includes it
        text = (tag.text or "").strip()
        if text and "://" not in text:
            tag.text = f"file://{(path.parent / text).resolve()}"
    for axis in model.iterfind("joint/axis"):
        if old or (axis.findtext("use_parent_model_frame") or "0") in ("1", "true"):
            xyz = axis.find("xyz")
            xyz = ET.SubElement(axis, "xyz") if xyz is None else xyz
            if not xyz.get("expressed_in"):
                xyz.set("expressed_in", "__model__")
    for element in model.findall("*"):
        if element.tag == "include":
            uri = (element.findtext("uri") or "").strip()
            if not uri:
                raise InputError(f"{path}: an <include> without <uri>")
            other = _find_model(path, uri).resolve()
            if other in above:
                raise InputError(f"{path}: includes itself by way of {uri!r}")
            inner = read_model(other, read_xml(other), (*above, other))
            inner.extend(element.findall("plugin"))  # they name the links of the included model
            name = (element.findtext("name") or inner.get("name") or "").strip()
            merged = element.get("merge") in ("1", "true")
        elif element.tag == "model":
            other, inner, name, merged = path, element, element.get("name", ""), False
            _merge(path, inner, old, above)
        else:
            continue
        frame = _place(path, other, element, inner, f"_merged__{name}__model__" if merged else name)
        scope = "" if merged else f"{name}::"
        canonical = find_canonical(inner)
        if canonical:
            frame.set("attached_to", scope + canonical)
        model.remove(element)
        model.append(frame)
        model.extend(_rename(inner, frame.get("name", ""), scope))
        if len(model) > MAX_ELEMENTS:
            raise InputError(f"{path}: more than {MAX_ELEMENTS} elements; a robot has fewer")


def _place(
    path: Path, other: Path, element: ET.Element, inner: ET.Element, name: str
) -> ET.Element:
    """Return the frame of a model `inner` of the file `other` in the model that contains it."""
    pose = element.find("pose")
    pose = inner.find("pose") if pose is None else pose
    at = read_pose(pose, f"{path}: pose of {name!r}")
    first = (element.findtext("placement_frame") or inner.get("placement_frame") or "").strip()
    if first:  # the frame of the included model that the pose refers to
        at = at.then(Frames(other, inner).pose_of(first).inverse())
    frame = ET.Element("frame", name=name)
    written = ET.SubElement(frame, "pose", rotation_format="quat_xyzw")
    w, *xyz_turn = (float(x) for x in quat_from_rot(at.R))
    written.text = " ".join(map(repr, [*at.p.tolist(), *xyz_turn, w]))
    base = "" if pose is None else pose.get("relative_to", "")
    written.set("relative_to", base or "__model__")  # and not to the link that it is attached to
    return frame


def _rename(inner: ET.Element, frame: str, scope: str) -> list[ET.Element]:
    """Return the parts of a model under their names in the surrounding model.

    `frame` is the inner model's own frame there; `scope` is the prefix of its names.
    """

    def full(name: str) -> str:
        name = name.strip()
        return frame if name == "__model__" else name if name in ("", "world") else scope + name

    parts = [child for child in inner if child.tag in ("link", "joint", "frame", "plugin")]
    for part in parts:
        for element in part.iter():
            for key in ("relative_to", "attached_to", "expressed_in"):
                if key in element.attrib:
                    element.set(key, full(element.get(key, "")))
            if element.tag in ("parent", "child", "linkName", "jointName"):
                element.text = full(element.text or "")
        if part.tag != "plugin":
            part.set("name", full(part.get("name", "")))
        if part.tag == "frame" and not part.get("attached_to"):
            part.set("attached_to", frame)
        if part.tag == "link":
            pose = part.find("pose")
            pose = ET.SubElement(part, "pose") if pose is None else pose
            if not pose.get("relative_to"):
                pose.set("relative_to", frame)
    return parts


def _find_model(path: Path, uri: str) -> Path:
    name = uri.removeprefix("model://").removeprefix("file://").rstrip("/")
    folders = [path.parent, path.parent.parent]
    for variable in RESOURCES:
        folders += [Path(f) for f in os.environ.get(variable, "").split(os.pathsep) if f]
    for folder in folders:
        listed = _read_config(folder / name / "model.config")
        places = [listed] if listed else [folder / name / "model.sdf"]
        for place in (*places, folder / f"{name}.sdf", folder / name):
            if place.is_file():
                return place
    raise InputError(
        f"{path}: included model {uri!r} was not found beside the file or in {', '.join(RESOURCES)}"
    )


def _read_config(config: Path) -> Path | None:
    """Return the SDF file that a model.config names: of several, the newest that is supported.

    None without such a file, or if it names none. Raises InputError for a file that is missing.
    """
    if not config.is_file():
        return None
    files = [
        (read_version(element.get("version", "1.0"), f"{config}: version of <sdf>"), name)
        for element in read_xml(config).findall("sdf")
        if (name := (element.text or "").strip())
    ]
    supported = [entry for entry in files if entry[0] <= NEWEST]
    if not files:
        return None
    _, name = max(supported or files, key=lambda entry: entry[0])
    if not (config.parent / name).is_file():
        raise InputError(f"{config}: names {name!r}, which is not beside it; add the file")
    return config.parent / name
