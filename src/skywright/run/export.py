"""Exports a run for other programs: tables, a trajectory, a ROS 2 bag."""

from __future__ import annotations

import csv
import json
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.errors import InputError, neighbours
from skywright.run.results import Run, flatten

PLATFORM = "platform"


def _write_csv(run: Run, path: Path, _: str) -> None:
    columns = flatten(run.recording)
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    path.write_text(text.getvalue(), encoding="utf-8")


def _write_parquet(run: Run, path: Path, _: str) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "--format parquet needs pyarrow: pip install skywright[parquet]; valid without it: "
            + ", ".join(name for name in FORMATS if name != "parquet")
        ) from None
    pyarrow.parquet.write_table(pyarrow.table(flatten(run.recording)), path)


def _write_npz(run: Run, path: Path, _: str) -> None:
    with path.open("wb") as out:
        columns: Any = {c.name: run[c.name] for c in run.columns}
        np.savez_compressed(out, **columns)


def _write_tum(run: Run, path: Path, trajectory: str) -> None:
    """Lines of `timestamp tx ty tz qx qy qz qw`; s, m."""
    known = [n.removesuffix(".q_W") for n in run.names if n.endswith(".q_W")]
    if trajectory not in known:
        raise InputError(
            f"--trajectory {trajectory}: the run has none of that name with a place and an "
            f"attitude; valid: {neighbours(trajectory, known)}"
        )
    q_xyzw = np.roll(run[f"{trajectory}.q_W"], -1, axis=1)
    rows = np.column_stack([run["t"], run[f"{trajectory}.p_W"], q_xyzw])
    np.savetxt(path, rows, "%.9g", header="timestamp tx ty tz qx qy qz qw")


def _write_bag(run: Run, path: Path, _: str) -> None:
    """Write a folder that `ros2 bag` opens: a copy of the recording, and its metadata.yaml."""
    from mcap.reader import make_reader

    source = run.directory / "recording.mcap"
    if not run.recording.complete:
        raise InputError(
            f"{source}: was not finished, a bag needs its index; `mcap recover` (mcap.dev) adds "
            "it; valid for this run: csv, parquet, npz, tum"
        )
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None  # a finished recording has both
    s = summary.statistics
    text = _BAG.format(
        name=source.name, start=s.message_start_time, count=s.message_count,
        duration=s.message_end_time - s.message_start_time,
        topics="".join(
            _TOPIC.format(
                name=channel.topic, kind=summary.schemas[channel.schema_id].name,
                encoding=channel.message_encoding,
                # a JSON string is a quoted YAML scalar
                qos=json.dumps(channel.metadata.get("offered_qos_profiles", "")),
                count=s.channel_message_counts.get(channel.id, 0),
            )
            for channel in summary.channels.values()
        ),
    )  # fmt: skip
    path.mkdir()
    shutil.copyfile(source, path / source.name)
    (path / "metadata.yaml").write_text(text, encoding="utf-8")


# Version 5 of rosbag2's metadata: ROS 2 Humble and later read it.
_BAG = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: mcap
  relative_file_paths:
    - {name}
  duration:
    nanoseconds: {duration}
  starting_time:
    nanoseconds_since_epoch: {start}
  message_count: {count}
  topics_with_message_count:
{topics}  compression_format: ""
  compression_mode: ""
  files:
    - path: {name}
      starting_time:
        nanoseconds_since_epoch: {start}
      duration:
        nanoseconds: {duration}
      message_count: {count}
"""
_TOPIC = """    - topic_metadata:
        name: {name}
        type: {kind}
        serialization_format: {encoding}
        offered_qos_profiles: {qos}
      message_count: {count}
"""


class Format(NamedTuple):
    """A format and the ending of its file names."""

    write: Callable[[Run, Path, str], None]
    suffix: str


FORMATS = {
    "csv": Format(_write_csv, ".csv"),
    "parquet": Format(_write_parquet, ".parquet"),
    "tum": Format(_write_tum, ".txt"),
    "npz": Format(_write_npz, ".npz"),
    "rosbag2": Format(_write_bag, "-bag"),
}
"""By value of --format."""


def export_run(run: Run, form: str, out: Path | None = None, trajectory: str = PLATFORM) -> Path:
    """Write a run in a format of FORMATS; returns the file, or the folder of "rosbag2".

    `out` is by default the run's name with the format's ending, beside the run. `trajectory`
    selects the poses that "tum" writes: a name with `.p_W` and `.q_W` (`tip`,
    `reference.platform`). Raises InputError for an unknown format or trajectory, or if the file
    cannot be written or the run has no samples. Existing files are not overwritten.
    """
    if form not in FORMATS:
        raise InputError(f"--format {form}; valid: {', '.join(FORMATS)}")
    if not len(run.recording.samples):
        raise InputError(f"{run.directory}: the recording has no samples ({run.reason})")
    chosen, folder = FORMATS[form], run.directory
    if folder.name in ("", ".."):
        folder = folder.resolve()
    path = out or folder.with_name(f"{folder.name}{chosen.suffix}")
    fresh: list[Path] = []
    try:
        if path.exists():
            raise InputError(f"{path} already exists; give another --out or remove it")
        fresh = [parent for parent in path.parents if not parent.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        # an interrupted export leaves nothing: a partial file is in a folder of its own
        with tempfile.TemporaryDirectory(prefix=".export-", dir=path.parent) as partial:
            chosen.write(run, Path(partial) / "export", trajectory)
            (Path(partial) / "export").rename(path)
    except BaseException as error:
        for parent in fresh:
            with suppress(OSError):
                parent.rmdir()
        if not isinstance(error, OSError):
            raise
        why: object = error.strerror or error
        if isinstance(error, (FileExistsError, NotADirectoryError)):
            why = next((f"{p} is a file" for p in path.parents if p.is_file()), why)
        raise InputError(f"{path}: cannot be written: {why}") from None
    return path
