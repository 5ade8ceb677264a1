"""Terminal output of `skywright locate`."""

import math
from pathlib import Path

from skywright.analysis.locate.locate import LocateReport
from skywright.analysis.locate.report import build_headline, format_length
from skywright.reports.terminal import new_console, new_table


def print_locate(report: LocateReport, folder: Path) -> None:
    """Print the result, its accuracy and the written file."""
    console = new_console()
    console.print(build_headline(report), style="bold")
    if report.errors:
        table = new_table(
            "Errors against the reference", "", "rms", "median", "largest", "over 1 s"
        )
        for name, e in report.errors.items():
            relative = "-" if e.relative is None else format_length(e.relative.rms)
            a = e.absolute
            table.add_row(name, *(format_length(v) for v in (a.rms, a.median, a.max)), relative)
        console.print(table)
    f = report.fusion
    if f is not None:
        c = f.calibration
        table = new_table("Alignment", "quantity", "value", "standard deviation")
        offset = (f"{c.time_offset:+.4f} s", f"{c.offset_std:.4f} s")
        table.add_row("camera's clock minus station's", *offset)
        table.add_row("scale of the camera", f"{c.frame.scale:.4f}", f"{c.scale_std:.4f}")
        table.add_row("rotation", "", f"{math.degrees(c.rotation_std):.2f} deg")
        table.add_row("noise of the station", format_length(c.noise.station), "")
        console.print(table)
        for o in f.outages:
            off = ", ".join(
                f"{name} {format_length(v)}"
                for name, v in (("fused", o.fused), ("paper's filter", o.paper),
                                ("aligned camera", o.camera)) if v is not None
            )  # fmt: skip
            console.print(f"without the station for {o.end - o.start:.1f} s"
                          + (f"; off when it came back: {off}" if off else ""))  # fmt: skip
        if f.pose is not None:
            place = ", ".join(f"{x:.4f}" for x in f.pose.p_WS)
            console.print(f"station at ({place}) m in the time-consistent frame")
    for note in report.notes:
        console.print(f"note: {note}")
    console.print(f"{folder / 'locate.html'}")
