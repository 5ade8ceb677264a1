"""Figures of a report on a thickness survey: readings with their intervals, and A-scans."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from skywright.missions.bridge_contact.figures import FIGURES as CONTACT
from skywright.missions.bridge_contact.figures import describe_survey
from skywright.missions.skills.datum import list_datum_marks
from skywright.missions.skills.told import name_flight, tell_block
from skywright.missions.thickness_survey.plan import ThicknessWay
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.models.ultrasonic import SAMPLE_RATE
from skywright.reports.figures.style import BLACK, BLUE, GREY, ORANGE, WIDTH, new_figure
from skywright.run.kind import Chart, Figures, Mark
from skywright.run.result import RunResult

THIN, REFUSED = 0.6, (230, 159, 0)
"""Fraction of the nominal wall that is drawn darkest; colour of a rejected reading."""


def draw_readings(result: RunResult[ThicknessSurvey, ThicknessWay]) -> Figure | None:
    """Draw the thickness at each spot with its 95 % interval, and the true wall."""
    found = result.details or []
    good = [r for r in found if r.reading.accepted]
    if not good:
        return None
    figure = new_figure(WIDTH, 3.0)
    ax = figure.subplots()
    figure.subplots_adjust(left=0.075, right=0.985, top=0.96, bottom=0.17)
    x = np.arange(len(good))
    ax.errorbar(
        x, [1e3 * r.reading.thickness for r in good], yerr=[1e3 * r.reading.u95 for r in good],
        fmt="o", color=BLUE, capsize=4, label="reading and its 95 % interval",
    )  # fmt: skip
    ax.plot(x, [1e3 * r.true for r in good], "_", color=BLACK, ms=14, label="true wall")
    nominal = result.description.mission.task.procedure.nominal_m
    ax.axhline(1e3 * nominal, color=GREY, ls=":", lw=1.0, label="nominal")
    ax.set_xticks(x, [r.spot for r in good])
    ax.set(xlabel="spot", ylabel="wall thickness (mm)")
    ax.legend(loc="best")
    return figure


def draw_ascans(result: RunResult[ThicknessSurvey, ThicknessWay]) -> Figure | None:
    """Draw the A-scan of the last reading at each of up to six spots."""
    found = (result.details or [])[-6:]
    if not found:
        return None
    figure = new_figure(WIDTH, 1.1 * len(found) + 0.6)
    axes = np.atleast_1d(figure.subplots(len(found), 1, sharex=True))
    figure.subplots_adjust(left=0.075, right=0.985, top=0.97, bottom=0.5 / (len(found) + 0.6),
                           hspace=0.35)  # fmt: skip
    for ax, r in zip(axes, found, strict=True):
        t = 1e6 * np.arange(r.ascan.size) / SAMPLE_RATE
        ax.plot(t, 100 * r.ascan, color=BLUE if r.reading.accepted else ORANGE, lw=0.7)
        ax.set(ylim=(-110, 110), xlim=(0, t[-1]))
        said = (
            f"{1e3 * r.reading.thickness:.2f} mm" if r.reading.accepted else r.reading.reason
        )  # fmt: skip
        ax.annotate(f"{r.spot}: {said}", (0.99, 0.86), xycoords="axes fraction", ha="right",
                    fontsize=8)  # fmt: skip
    axes[len(axes) // 2].set_ylabel("amplitude (% of full screen)")
    axes[-1].set_xlabel("time (microseconds)")
    return figure


def describe(result: RunResult[ThicknessSurvey, ThicknessWay]) -> str:
    """Return a sentence on the readings and their accuracy."""
    m = result.metrics
    if "thickness.error_p95_mm" not in m:
        return f"{name_flight(result)} accepted no reading"
    return (
        f"{name_flight(result)} read {m['thickness.accepted_fraction'] * m['thickness.spots']:.0f} "
        f"of {m['thickness.spots']:.0f} spots within {m['thickness.error_p95_mm']:.3f} mm (95 %)"
    )


def list_notes(result: RunResult[ThicknessSurvey, ThicknessWay]) -> list[str]:
    """Return notes on procedure, block, rejected readings and survey."""
    p = result.description.mission.task.procedure
    out = [
        f"Procedure: {p.name}, revision {p.revision}. Reference block with steps of "
        f"{1e3 * p.block_thin_m:g} and {1e3 * p.block_thick_m:g} mm, {p.velocity_m_per_s:g} m/s; "
        f"nominal wall {1e3 * p.nominal_m:g} mm. Accepted are {p.steady_count} readings within "
        f"{1e3 * p.steady_m:g} mm over {p.steady_s:g} s, {p.snr_db:g} dB over the noise. The "
        "readings are simulated."
    ]
    after = result.found.get("block_after")
    if after:
        out.append(tell_block(after["reasons"]))
    refused = [r for r in result.details or [] if not r.reading.accepted]
    out += [f"{r.spot}: not accepted, {r.reading.reason}." for r in refused]
    return out + describe_survey(result)  # type: ignore[arg-type]


def list_marks(result: RunResult[ThicknessSurvey, ThicknessWay]) -> list[Mark]:
    """Return each reading at its place: dark (thin) to bright (nominal); rejected ones orange."""
    samples, found = result.samples, result.details or []
    nominal = result.description.mission.task.procedure.nominal_m
    marks = list_datum_marks(result)
    for r in found:
        i = min(int(np.searchsorted(samples["t"], r.reading.t)), len(samples) - 1)
        name, colour = "reading refused", REFUSED
        if r.reading.accepted:
            share = float(np.clip((r.reading.thickness / nominal - THIN) / (1.0 - THIN), 0.0, 1.0))
            red, green, blue, _ = colormaps["viridis"](share)
            colour = round(255 * red), round(255 * green), round(255 * blue)
            name = f"{1e3 * r.reading.thickness:.1f} mm"
        marks.append(Mark(name, colour, np.array(samples["est_p_WT"][i]), size_m=0.012,
                          since_s=r.reading.t))  # fmt: skip
    return marks


FIGURES = Figures(
    describe,
    notes=list_notes,
    phases=CONTACT.phases,
    title="Wall thickness",
    charts={
        "thickness-readings": Chart(
            "The readings",
            "Accepted readings with their stated 95 % interval. The black marks are the true wall "
            "under the probe, which only a simulation knows.",
            draw_readings,
        ),
        "thickness-ascans": Chart(
            "A-scans",
            "The A-scan of the last reading of a touch. The transmitter's pulse is at the left; "
            "the wall is the distance between the echoes. Orange: not accepted.",
            draw_ascans,
        ),
        "contact-force": CONTACT.charts["contact-force"],
    },
    marks=list_marks,
)
