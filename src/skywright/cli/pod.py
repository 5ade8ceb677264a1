"""The command that says what an inspection would find."""

from pathlib import Path

import click

from skywright.cli.options import as_json_option, check_writable, print_json
from skywright.errors import InputError


class _Ceiling(click.ParamType):
    name = "ceiling"

    def convert(
        self, value: str, param: click.Parameter | None, context: click.Context | None
    ) -> float | str:
        """Return a number, "fit" or "contact"."""
        if value in ("fit", "contact"):
            return value
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r}; valid: fit, contact or a number from 0 to 1", param, context)


@click.command()
@click.argument("data", metavar="DATA.csv", type=click.Path(path_type=Path))
@click.option(
    "--columns", metavar="SPEC", help="The file's own names: size=Depth[mm],hit=Found,flaw=Id,..."
)
@click.option(
    "--model", type=click.Choice(["hit-miss", "a-hat"]), help="Data.  [default: the columns']"
)
@click.option(
    "--decision", type=float, metavar="Y", help="Signal from which a flaw is called (a-hat)."
)
@click.option("--left", type=float, metavar="Y", help="Signals up to Y are censored (a-hat).")
@click.option("--right", type=float, metavar="Y", help="Signals from Y on are censored (a-hat).")
@click.option(
    "--link",
    type=click.Choice(["logit", "probit"]),
    default="logit",
    show_default=True,
    help="Curve of hit/miss data.",
)
@click.option(
    "--size-axis", type=click.Choice(["linear", "log"]), help="Axis of size.  [default: by AIC]"
)
@click.option(
    "--signal-axis", type=click.Choice(["linear", "log"]), help="Axis of the signal, likewise."
)
@click.option(
    "--bounds",
    type=click.Choice(["wald", "likelihood"]),
    default="wald",
    show_default=True,
    help="Confidence bounds: Wald, or likelihood ratio.",
)
@click.option(
    "--ceiling",
    type=_Ceiling(),
    metavar="fit|contact|C",
    help="POD that no size exceeds.  [default: the column contact, else 1]",
)
@click.option("--group", metavar="COLUMN", help="A curve for each value of a column.")
@click.option("--out", type=click.Path(path_type=Path), help="Picture (.png or .svg).")
@as_json_option
def pod(
    data: Path, columns: str | None, model: str | None, decision: float | None, left: float | None,
    right: float | None, link: str, size_axis: str | None, signal_axis: str | None, bounds: str,
    ceiling: float | str | None, group: str | None, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Compute the probability of detection from inspections of known flaws.

    DATA.csv has one row an inspection: a size, and whether the flaw was found (hit) or its signal
    (ahat). Size 0 is a site without a flaw.
    """
    from skywright.analysis.pod.groups import compare_groups
    from skywright.analysis.pod.method import Method
    from skywright.analysis.pod.pod import compute_pod
    from skywright.analysis.pod.table import load_inspections

    table = load_inspections(data, columns)
    method = Method(
        model, link, size_axis, signal_axis, bounds, decision, left, right, ceiling
    )  # fmt: skip
    try:
        found = compute_pod(table, method)
        compared = None if group is None else compare_groups(table, group, method)
    except InputError as error:
        raise InputError(f"{data}: {error}") from None
    picture = None
    if out is not None or not as_json:
        from skywright.analysis.pod.figures import write_pod_figure

        picture = check_writable(out or Path(f"{data.stem}-pod.png"))
        write_pod_figure(found, compared, picture)
    if as_json:
        print_json(found.to_json() | ({} if compared is None else {"groups": compared.to_json()}))
    else:
        from skywright.analysis.pod.present import print_pod

        print_pod(found, compared, picture)
