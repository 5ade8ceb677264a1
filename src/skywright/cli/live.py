"""Live inputs: `play` a recording as streams, `receive` streams into files."""

import math
from pathlib import Path
from typing import Any

import click

from skywright.cli.options import as_json_option, print_json
from skywright.errors import InputError


@click.command()
@click.argument("data", nargs=-1, metavar="RUN|FILE...", required=True)
@click.option(
    "--to", required=True, metavar="ADDRESS",
    help="udp:[HOST:]PORT, mavlink:[HOST:]PORT (poses as ODOMETRY), or serial:PORT[:BAUD] "
    "(lines).",
)  # fmt: skip
@click.option("--speed", type=float, default=1.0, show_default=True, help="Factor of real time.")
@as_json_option
def play(data: tuple[str, ...], to: str, speed: float, as_json: bool) -> None:
    """Send recordings as live streams, at their recorded pace.

    RUN is the directory or recording of a flight; FILE is a scan (as for `weld`) or a trajectory
    (as for `locate`; MCAP as FILE:/topic). A trajectory's stream has the file's name.
    """
    if not (math.isfinite(speed) and 0.01 <= speed <= 1000.0):
        raise InputError(f"--speed {speed}; valid: 0.01 to 1000")
    from skywright.links.live.player import Target
    from skywright.links.live.player import play as send

    tracks = [track for text in data for track in _load(text)]
    target = Target(to)
    try:
        sent = send(tracks, target, speed)
    finally:
        target.close()
    if as_json:
        print_json({"sent": sent})
        return
    for name, n in sent.items():
        click.echo(f"{name}: {n} samples")


def _load(text: str) -> list[Any]:
    import numpy as np

    from skywright.analysis.locate.trajectory_file import load_trajectory, split_topic
    from skywright.links.live import sources
    from skywright.links.live.player import Track, make_name

    path, topic = split_topic(text)
    if not path.exists():
        raise InputError(f"{text}: no such file or directory")
    if topic is None and sources.is_run(path):
        return sources.load_run_tracks(path)
    if topic is None and sources.is_scan(path):
        return list(sources.load_scan_tracks(path))
    found = load_trajectory(text)
    name = make_name(path.stem if topic is None else topic.strip("/"))
    if found.q is None:
        return [Track("position", name, found.t, found.p, text)]
    return [Track("pose", name, found.t, np.hstack([found.p, found.q]), text)]


@click.command()
@click.argument("address", metavar="udp:[HOST:]PORT|serial:PORT[:BAUD]")
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder for the streams' files."
)
@click.option(
    "--seconds", type=click.FloatRange(0.0, 1e6, min_open=True),
    help="Duration (s) of the recording.  [default: until Ctrl-C]",
)  # fmt: skip
@click.option(
    "--idle", type=click.FloatRange(0.0, 1e6, min_open=True),
    help="End after this time (s) without a sample; counts from the first sample.",
)  # fmt: skip
@as_json_option
def receive(
    address: str, out: Path, seconds: float | None, idle: float | None, as_json: bool
) -> int:
    """Record live streams into files that `locate` and `weld` read.

    It recognises pose packets, MAVLink ODOMETRY and instrument lines.
    """
    from skywright.links.live.receiver import LiveReceiver
    from skywright.links.live.recorder import LiveRecorder, record

    receiver = LiveReceiver(address)
    try:
        recorder = LiveRecorder(out)
        click.echo(f"listening on {address}", err=True)
        record(receiver, recorder, seconds or math.inf, idle or math.inf)
        files = recorder.finish()
    finally:
        receiver.close()
    streams = [
        {
            "name": s.name, "kind": s.kind, "samples": s.count, "stale": s.stale, "lost": s.lost,
            "restarts": s.restarts,
        }
        for s in receiver.streams.values()
    ]  # fmt: skip
    refused = receiver.describe_refused()
    if receiver.failure:
        click.echo(f"skywright: {address}: {receiver.failure}", err=True)
    if as_json:
        print_json({"streams": streams, "refused": refused, "files": [str(f) for f in files]})
    else:
        for line in refused:
            click.echo(line, err=True)
        if not streams:
            click.echo(f"nothing was received on {address}", err=True)
        for s in streams:
            lost = f", {s['lost']} lost" if s["lost"] else ""
            click.echo(f"{s['name']}: {s['samples']} samples, {s['stale']} stale{lost}")
        for file in files:
            click.echo(str(file))
    return 0 if streams and not receiver.failure else 1
