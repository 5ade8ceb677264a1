"""Commands that read recordings of instruments and flights."""

from pathlib import Path

import click

from skywright.cli.options import (
    as_json_option,
    check_folder,
    check_writable,
    print_json,
    trust_option,
)
from skywright.errors import InputError


@click.command()
@click.argument("data", metavar="DATA.csv|RUN", type=click.Path(path_type=Path))
@click.option(
    "--columns", metavar="SPEC", help="The file's own names and units: t=Time[ms],x=X[mm],re=R,..."
)
@click.option(
    "--calibrate", metavar="T0:T1", help="Time span (s) of an approach from air to contact."
)
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Calibration file of an earlier scan."
)
@click.option(
    "--surface", type=click.Path(path_type=Path), help="Cylinder file.  [default: fitted]"
)
@click.option("--lift-off", type=float, help="Contact threshold in the instrument's units.")
@click.option("--weld", "weld_threshold", type=float, help="Weld threshold, instrument's units.")
@click.option("--out", type=click.Path(path_type=Path), help="Map (.png or .svg).")
@click.option(
    "--nde", type=click.Path(path_type=Path), help="Impedance and places of a RUN (extra 'nde')."
)
@as_json_option
def weld(
    data: Path, columns: str | None, calibrate: str | None, calibration: Path | None,
    surface: Path | None, lift_off: float | None, weld_threshold: float | None, out: Path | None,
    nde: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Find a weld in an instrument's data.

    DATA.csv has the columns t_s, re, im, x_m, y_m, z_m in any order. RUN is the directory or the
    recording of a scan that Skywright flew.
    """
    from skywright.inspection.recorded_scan import is_recording
    from skywright.inspection.weld_data import process_file

    if nde is not None and not is_recording(data):
        raise InputError("--nde: valid for a RUN; a table names no frequency of its instrument")
    report = process_file(
        data,
        calibrate=calibrate,
        calibration_file=calibration,
        lift_off_threshold=lift_off,
        weld_threshold=weld_threshold,
        surface_file=surface,
        columns=columns,
    )
    if nde is not None:
        from skywright.inspection.files.nde import write_nde
        from skywright.inspection.files.weld_scan import build_eddy_scan

        write_nde(check_writable(nde, (".nde",)), build_eddy_scan(report))
    if out is not None or not as_json:
        from skywright.reports.weld_map import write_weld_map

        picture = check_writable(out or Path(f"{data.stem}-weld.png"))
        write_weld_map(report, picture)
    if as_json:
        print_json(report.to_json())
    else:
        from skywright.reports.terminal import print_weld

        print_weld(report, picture)


@click.command()
@click.argument("data", nargs=-1, metavar="DATA...")
@click.option("--station", metavar="FILE", help="File of the total station.")
@click.option("--camera", metavar="FILE", help="File of the camera.")
@click.option("--reference", metavar="FILE", help="Reference trajectory.")
@click.option(
    "--align",
    default="similarity",
    show_default=True,
    help="Frames: similarity, rigid, level, or affine (the paper's twelve numbers).",
)
@click.option("--calibrate", metavar="T0:T1", help="Time span (s) for the alignment.")
@click.option("--time-offset", type=float, help="Camera clock minus station clock (s).")
@click.option("--prism", metavar="X,Y,Z", help="Prism position in the camera frame (m).")
@click.option(
    "--frame",
    nargs=2,
    metavar="KNOWN MEASURED",
    type=click.Path(path_type=Path),
    help="Terrain points: known and newly measured positions.",
)
@click.option(
    "--compare",
    default="rigid",
    show_default=True,
    help="Alignment to the reference: rigid, similarity, none.",
)
@click.option("--reference-offset", type=float, help="Reference clock minus result clock (s).")
@click.option("--demo", is_flag=True, help="Generate and use files of a simulated flight.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: locate-NAME]")
@as_json_option
def locate(
    data: tuple[str, ...], station: str | None, camera: str | None, reference: str | None,
    align: str, calibrate: str | None, time_offset: float | None, prism: str | None,
    frame: tuple[Path, Path] | None, compare: str, reference_offset: float | None, demo: bool,
    out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Fuse total station and tracking camera, or test a trajectory.

    DATA: the station's and the camera's recording, or one trajectory with --reference. TUM, EuRoC,
    CSV with a header, or MCAP as FILE:TOPIC.
    """
    from skywright.analysis.locate.locate import locate as locate_files

    if demo:
        from skywright.analysis.locate.demo import write_demo

        if data or station or camera or reference:
            raise InputError("--demo generates its own files; give either --demo or DATA")
        out = out or Path("locate-demo")
        files = write_demo(check_folder(out))
        data, reference, compare = (str(files[0]), str(files[1])), str(files[2]), "none"
    elif not (data or station or camera):
        raise InputError("no data; valid: a station's and a camera's file, or --demo")
    if out is not None:
        check_folder(out)
    report = locate_files(
        list(data), station=station, camera=camera, reference=reference, align=align,
        span=calibrate, time_offset=time_offset, prism=prism, frame=frame, compare=compare,
        reference_offset=reference_offset,
    )  # fmt: skip
    if out is not None or not as_json:
        from skywright.analysis.locate.report import write_locate

        named = Path((station or (data or (camera or "",))[0]).partition(":/")[0]).stem
        out = out or Path(f"locate-{named}")
        write_locate(report, check_folder(out))
    if as_json:
        print_json({**report.to_json(), "directory": None if out is None else str(out)})
    else:
        from skywright.analysis.locate.present import print_locate

        assert out is not None
        print_locate(report, out)


@click.command()
@trust_option
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--robot", metavar="R", help="Robot: name or file (required for a ULog).")
@click.option("--mass", type=float, metavar="KG", help="Mass.  [default: the file's]")
@click.option("--out", type=click.Path(path_type=Path), help="Page.  [default: identify.html]")
@as_json_option
def identify(
    logs: tuple[Path, ...], robot: str | None, mass: float | None, out: Path | None, as_json: bool
) -> None:
    """Fit a robot's parameters to recorded flights.

    LOG is a run's directory, a recording.mcap, a PX4 ULog or a table (.csv); several flights of
    one robot add up.
    Beside the page a robot file is written (PAGE.toml) that a run takes as --robot; of a robot that
    is not built in, or was changed by --set, also its base (PAGE-base.toml). Existing ones are
    replaced only if an earlier identification wrote them.
    """
    from skywright.analysis.identify.identify import identify as identify_logs
    from skywright.analysis.identify.overrides import (
        build_overrides,
        check_replaceable,
        choose_base,
    )
    from skywright.analysis.identify.report import print_identification, write_identify_page
    from skywright.description.robot.loader import find_robot, load_robot, load_robot_layers

    spec = None if robot is None else load_robot(robot)[0]
    page = check_writable(out or Path("identify.html"), (".html",))
    robot_file = check_writable(page.with_suffix(".toml"), (".toml",))
    base = [] if robot is None else load_robot_layers(find_robot(robot))
    check_replaceable(robot_file, [Path(layer.label) for layer in base])
    found = identify_logs(logs, spec, mass)
    name, whole = choose_base(found, robot, robot_file)
    overrides = build_overrides(found, name)
    if whole:
        check_replaceable(robot_file.with_name(name), [])
        robot_file.with_name(name).write_text(whole, encoding="utf-8")
    write_identify_page(found, overrides, page)
    robot_file.write_text(overrides, encoding="utf-8")
    if as_json:
        files = {"page": str(page), "robot_file": str(robot_file)}
        base_file = str(robot_file.with_name(name)) if whole else None
        print_json({**found.to_json(), **files, "base_file": base_file})
    else:
        print_identification(found, page, robot_file)


@click.command()
@click.argument("what", type=click.Choice(["header", "matlab"]))
def gateway(what: str) -> None:
    """Print the packets of the UDP gateway as C or MATLAB code."""
    from skywright.links.udp.generate import build_c_header, build_matlab

    click.echo(build_c_header() if what == "header" else build_matlab(), nl=False)
