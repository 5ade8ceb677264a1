"""HTML page and files of a localisation."""

import json
import math
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.analysis.locate import figures
from skywright.analysis.locate.locate import Fusion, LocateReport
from skywright.analysis.locate.trajectory_error import TrajectoryError
from skywright.analysis.locate.trajectory_file import format_table, format_tum
from skywright.errors import InputError
from skywright.reports.figures.style import house_style
from skywright.reports.page import Picture, build_picture, render_page
from skywright.reports.terminal import format_number

FILES = ("trajectory.csv", "trajectory.tum", "locate.json", "locate.html")


class Section(NamedTuple):
    """A section of the page: text, a table, pictures."""

    title: str
    text: str = ""
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    pictures: Sequence[Picture] = ()


def write_locate(report: LocateReport, folder: Path) -> None:
    """Write trajectory, numbers and page into a folder. Raises InputError if writing fails."""
    page = render_locate_page(report)
    texts = {
        "trajectory.csv": _write_csv(report), "trajectory.tum": format_tum(report.trajectory),
        "locate.json": json.dumps(report.to_json(), indent=2, allow_nan=False) + "\n",
        "locate.html": page,
    }  # fmt: skip
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in FILES:
            (folder / name).write_text(texts[name], encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _write_csv(report: LocateReport) -> str:
    traj = report.trajectory
    names, columns, digits = ["t_s", "x_m", "y_m", "z_m"], [traj.t, *traj.p.T], [6, 5, 5, 5]
    if traj.q is not None:
        names += ["qw", "qx", "qy", "qz"]
        columns += [*traj.q.T]
        digits += [6] * 4
    if report.std is not None:
        names.append("std_m")
        columns.append(report.std)
        digits.append(5)
    return format_table(names, columns, digits)


def render_locate_page(report: LocateReport) -> str:
    """Return the HTML of the self-contained page."""
    with house_style():
        sections = _build_sections(report)
    try:
        installed = version("skywright")
    except PackageNotFoundError:
        installed = "of an unknown version"
    return render_page(
        "locate.html.j2",
        title=report.trajectory.name, headline=build_headline(report), intro=_introduce(report),
        notes=report.notes, sections=sections, version=installed,
    )  # fmt: skip


def build_headline(report: LocateReport) -> str:
    """Return the result in one sentence."""
    name = report.trajectory.name
    error = report.errors.get("fused") or report.errors.get("trajectory")
    if error is not None and report.reference is not None:
        return (
            f"{name}: {format_length(error.absolute.rms)} rms from {report.reference.name}, "
            f"{format_length(error.absolute.max)} at most"
        )
    assert report.std is not None
    return (
        f"{name}: standard deviation of the position "
        f"{format_length(float(np.median(report.std)))} (median, as stated by the filter)"
    )


def format_length(metres: float | None) -> str:
    """Format a length in mm or m; a missing value is a dash."""
    if metres is None or not math.isfinite(metres):
        return "–"
    return f"{1e3 * metres:.3g} mm" if metres < 0.0995 else f"{metres:.3g} m"


def _introduce(report: LocateReport) -> str:
    if report.fusion is None:
        return (
            f"{len(report.trajectory.t)} samples over {report.trajectory.duration:.1f} s, compared "
            "with the reference at their own times."
        )
    f = report.fusion
    which = (
        "the prism (give --prism to get the camera's place)"
        if report.point == "prism"
        else "the camera"
    )
    frame = "the time-consistent frame" if f.pose is not None else "the station's frame"
    return (
        f"{len(f.station.t)} positions from {f.station.name} and {len(f.camera.t)} from "
        f"{f.camera.name}. The result is the position of {which}, in {frame}, on the "
        "station's clock. Each estimate uses only measurements up to its time."
    )


def _build_sections(report: LocateReport) -> list[Section]:
    sections = []
    if report.errors:
        sections.append(_section_errors(report))
    sections.append(Section("Where it went", pictures=[
        build_picture("Where it went", figures.draw_paths(report),
                      "The path from above and from the side."
                 + (" Where the aligned camera deviates from the others, it has drifted."
                    if report.fusion is not None else "")),
    ]))  # fmt: skip
    if report.fusion is not None:
        sections += _section_fusion(report.fusion)
    return sections


def _section_errors(report: LocateReport) -> Section:
    rows = [[name, *(format_length(v) for v in e.absolute[:4]), _relative(e), _angle(e)]
            for name, e in report.errors.items()]  # fmt: skip
    first = next(iter(report.errors.values()))
    how = {
        "rigid": "after the rotation and offset that fit best",
        "similarity": "after the rotation, offset and scale that fit best",
    }.get("" if first.frame is None else first.frame.method, "as they are, without alignment")
    pictures = [
        build_picture(
            "Errors",
            figures.draw_errors(report),
            "" if report.fusion is None else "Red bands: station outages.",
        ),
        build_picture("Distribution of the errors", figures.draw_distribution(report), ""),
    ]
    return Section(
        "Errors against the reference",
        f"Absolute: distance from the reference {how}. Relative: error of the displacement over "
        f"{first.over:g} s. The reference's clock is {first.time_offset:+.4f} s from the "
        "trajectory's.",
        ["", "rms", "mean", "median", "largest", "relative, rms", "turn, rms"], rows, pictures,
    )  # fmt: skip


def _relative(e: TrajectoryError) -> str:
    return "–" if e.relative is None else format_length(e.relative.rms)


def _angle(e: TrajectoryError) -> str:
    angle = e.relative_angle
    return "–" if angle is None else f"{math.degrees(angle.rms):.2g} deg"


def _section_fusion(f: Fusion) -> list[Section]:
    c = f.calibration
    deg = math.degrees
    angle = float(np.arccos(np.clip((np.trace(c.frame.rotation) - 1.0) / 2.0, -1.0, 1.0)))
    outages = Section(
        "Outages of the station",
        "Distance between the first accepted measurement after the outage and each estimate just "
            "before it. The paper's filter and the aligned camera include the camera's drift "
            "since the calibration."
        if f.outages else "No outage of a second or longer.",
        ["from", "to", "for", "fused", "paper's filter", "aligned camera"],
        [[f"{o.start - f.events.t[0]:.1f} s", f"{o.end - f.events.t[0]:.1f} s",
          f"{o.end - o.start:.1f} s", *(format_length(v) for v in (o.fused, o.paper, o.camera))]
         for o in f.outages],
        [build_picture("Coordinates", figures.draw_coordinates(f), "Red bands: no station.")],
    )  # fmt: skip
    clocks = figures.draw_clocks(f)
    alignment = Section(
        "Clocks and frames",
        f"From {c.pairs} pairs over {c.span[1] - c.span[0]:.0f} s"
        + (f", {c.outliers} outliers left out" if c.outliers else "")
        + f". The points spread by {', '.join(format_length(x) for x in c.geometry.extent)} along "
        "their principal directions.",
        ["quantity", "value", "standard deviation"],
        [
            ["camera's clock minus station's", f"{c.time_offset:+.4f} s", f"{c.offset_std:.4f} s"],
            ["skew of the clocks", f"{1e6 * c.skew:+.0f} ppm", ""],
            ["scale: metres per unit of the camera", f"{c.frame.scale:.4f}", f"{c.scale_std:.4f}"],
            ["rotation", f"{deg(angle):.2f} deg", f"{deg(c.rotation_std):.2f} deg"],
            ["prism from the camera", ", ".join(f"{x:.3f}" for x in c.p_BP) + " m", ""],
            ["residual of the frame alone, rms", format_length(c.rms), ""],
            ["the paper's twelve numbers: shear", f"{100 * c.paper.shear:.1f} %", ""],
        ],
        [] if clocks is None else [
            build_picture("Clocks", clocks, "Speed is the same in every frame, so the "
                "correlation of the speeds gives the offset of the clocks. The line is the "
                "refined offset.")],
    )  # fmt: skip
    camera = Section(
        "Drift of the camera",
        "Drift, rotation and scale of the aligned camera since the calibration, estimated "
            "with the station. Red lines: jumps.",
        ["noise, each axis", "value"],
        [
            ["station", format_length(c.noise.station)],
            ["camera, each sample", format_length(f.model.camera)],
            ["drift per square root of a second", format_length(c.noise.per_sqrt_s)],
            ["drift per square root of a metre", format_length(c.noise.per_sqrt_m)],
        ],
        [build_picture("Camera", figures.draw_camera(f), "")],
    )  # fmt: skip
    parts = [outages, alignment, camera]
    if f.pose is not None:
        parts.append(_section_frame(f))
    return parts


def _section_frame(f: Fusion) -> Section:
    assert f.pose is not None
    pose = f.pose
    rows = [
        [p.name, *(f"{1e3 * x:+.1f} mm" for x in p.residual), f"{p.statistic:.1f}",
         format_number(1e3 * p.detectable, "mm"), "used" if p.used else "left out"]
        for p in pose.points
    ]  # fmt: skip
    return Section(
        "The time-consistent frame",
        f"The station stands at {', '.join(f'{x:.4f}' for x in pose.p_WS)} m. Residuals show "
        f"{format_length(pose.sigma)} a coordinate; the test of the whole gives "
        f"{pose.chi2:.1f}, at most {pose.chi2_limit:.1f}. A point is left out where its statistic "
        f"exceeds {pose.critical:.1f}; an offset of the length given would be found in 80 of 100 "
        "cases.",
        ["point", "x", "y", "z", "statistic", "found from", ""], rows,
    )  # fmt: skip
