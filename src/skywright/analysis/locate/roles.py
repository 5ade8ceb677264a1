"""Assignment of the files to station, camera and reference."""

from pathlib import Path
from typing import NamedTuple

from skywright.analysis.locate.trajectory_file import load_trajectory, split_topic
from skywright.analysis.locate.trajectory_mcap import find_own_roles, list_topics
from skywright.errors import InputError
from skywright.models.localisation.trajectory import Trajectory
from skywright.recordings.mcap_file import read_mcap

MOST_STATION_HZ = 25.0
"""Maximum rate (Hz) of a total station; the slower of two trajectories below it is the station."""


class Roles(NamedTuple):
    """Trajectories by their role."""

    station: Trajectory | None
    camera: Trajectory
    reference: Trajectory | None
    notes: tuple[str, ...]


def assign_roles(
    data: list[str], station: str | None, camera: str | None, reference: str | None
) -> Roles:
    """Load the files and identify station and camera. Raises InputError if that is ambiguous.

    Without a station, "camera" is a trajectory that is evaluated against the reference.
    """
    data = list(data)
    if len(data) == 1 and station is None and camera is None:
        path, topic = split_topic(data[0])
        if topic is None and path.is_file() and path.suffix.lower() == ".mcap":
            data, reference, note = _expand_recording(path, reference)
            if note:
                return Roles(
                    None, load_trajectory(data[0]), load_trajectory(str(reference)), (note,)
                )
    given = (station is not None) + (camera is not None)
    if given + len(data) > 2:
        raise InputError(
            f"{given + len(data)} files for station and camera; valid: two (a reference goes "
            "behind --reference)"
        )
    truth = load_trajectory(reference) if reference is not None else None
    if given + len(data) < 1:
        raise InputError("no data; valid: a station's and a camera's file")
    if given + len(data) == 1:
        only = load_trajectory((data + [station or camera or ""])[0])
        if truth is None:
            raise InputError(
                f"{only.name}: one trajectory only; give the other sensor's file, or "
                "--reference FILE"
            )
        return Roles(None, only, truth, ())
    if given == 2:
        assert station is not None and camera is not None
        return Roles(load_trajectory(station), load_trajectory(camera), truth, ())
    loaded = [load_trajectory(name) for name in data]
    if station is not None:
        return Roles(load_trajectory(station), loaded[0], truth, ())
    if camera is not None:
        return Roles(loaded[0], load_trajectory(camera), truth, ())
    return _tell_apart(loaded[0], loaded[1], truth)


def _expand_recording(path: Path, reference: str | None) -> tuple[list[str], str | None, str]:
    """Return the topics of a whole recording, and a note if its estimate is compared with its
    truth."""
    own = find_own_roles(path)
    if own and reference is None:
        note = f"{path.name}: a recording of Skywright: its estimate is compared with its truth"
        return [f"{path}:{own['estimate']}"], f"{path}:{own['reference']}", note
    topics = list_topics(read_mcap(path))
    if len(topics) == 2 and reference is None:
        return [f"{path}:{t.name}" for t in topics], None, ""
    return [str(path)], reference, ""


def _tell_apart(a: Trajectory, b: Trajectory, truth: Trajectory | None) -> Roles:
    """Identify the station of two trajectories: no orientation, or the lower rate."""
    if (a.q is None) != (b.q is None):
        station, camera = (a, b) if a.q is None else (b, a)
        why = "it gives no orientation"
    else:
        station, camera = (a, b) if a.rate < b.rate else (b, a)
        why = f"it is slower ({station.rate:.3g} Hz against {camera.rate:.3g} Hz)"
        if station.rate > MOST_STATION_HZ or station.rate > 0.7 * camera.rate:
            raise InputError(
                f"{a.name} ({a.rate:.3g} Hz) and {b.name} ({b.rate:.3g} Hz): the station "
                "cannot be recognised; give --station FILE, or --reference FILE to "
                "compare one with the other"
            )
    return Roles(station, camera, truth, (f"{station.name} is taken as the station: {why}",))
