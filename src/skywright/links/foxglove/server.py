"""The server for Foxglove: the messages of ROS 2, and the scene in Foxglove's types.

It listens on this computer only. A slow client loses messages: the SDK drops the oldest of its
queue.
"""

from __future__ import annotations

import sys
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.channels import SceneUpdateChannel

from skywright.errors import InputError
from skywright.links.broadcast.rows import Reader
from skywright.links.broadcast.topics import TEXTS
from skywright.links.foxglove.scene import build_forces, build_scene
from skywright.recordings.columns import Topic
from skywright.recordings.messages import definition, full_name
from skywright.recordings.sample_rows import build_message
from skywright.reports.frames import Arrow, list_arrows
from skywright.reports.scene3d import Scene3d

HOST = "127.0.0.1"
SCENE, FORCES = "/scene", "/scene/forces"
BACKLOG = 256  # messages queued for a slow client


class Clients:
    """Counts the subscriptions, and records when the scene must be sent again."""

    def __init__(self) -> None:
        self.subscribed: set[tuple[int, int]] = set()
        self.scene_due = False

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Add a subscription."""
        self.subscribed.add((client.id, channel.id))
        self.scene_due |= channel.topic == SCENE

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Remove a subscription."""
        self.subscribed.discard((client.id, channel.id))

    def __getattr__(self, name: str) -> Any:
        """Ignore all other requests of a client."""
        if name.startswith("on_"):
            return lambda *args: []
        raise AttributeError(name)


class FoxgloveServer:
    """The server of a flight."""

    def __init__(self, port: int) -> None:
        """Listen on a port, 0: a free one; raises InputError if it is in use."""
        self._context, self._clients = Context(), Clients()
        self._channels: dict[str, Channel] = {}
        self._arrows: list[Arrow] = []
        self._scene: Any = None
        try:
            self._server = foxglove.start_server(
                name="skywright", host=HOST, port=port, server_listener=self._clients,
                context=self._context, message_backlog_size=BACKLOG,
            )  # fmt: skip
        except (RuntimeError, OSError) as error:
            raise InputError(f"--foxglove {port}: cannot listen: {error}") from None
        url = f"ws://{HOST}:{self._server.port}"
        print(f"foxglove: listening on {url}", file=sys.stderr, flush=True)

    def declare(self, reader: Reader) -> None:
        """Declare the topics of a flight."""
        for encoder in reader.encoders.values():
            self._add(encoder.topic)
        for given in TEXTS:
            self._add(given.topic)
        self._scene = SceneUpdateChannel(SCENE, context=self._context)
        self._forces = SceneUpdateChannel(FORCES, context=self._context)
        setup = reader.setup
        self._built = build_scene(Scene3d(setup.robot, setup.world, setup.error), reader.drawing)
        self._arrows = list_arrows(setup.robot, frozenset(c.name for c in setup.columns))

    def _add(self, topic: Topic) -> None:
        text = definition(topic.kind, topic.types).encode()
        schema = Schema(name=full_name(topic.kind), encoding="ros2msg", data=text)
        self._channels[topic.name] = Channel(
            topic.name, schema=schema, message_encoding="cdr", context=self._context
        )

    @property
    def watched(self) -> bool:
        """Whether any topic has a subscriber."""
        return bool(self._clients.subscribed)

    def publish(self, reader: Reader) -> None:
        """Publish the newest row on the topics with subscribers."""
        ns = int(reader.ns[0])
        if self._clients.scene_due:
            self._clients.scene_due = False
            self._scene.log(self._built, log_time=ns)
        for name in reader.encoders:
            channel = self._channels[name]
            if channel.has_sinks():
                channel.log(reader.encode(name), log_time=ns)
        if self._forces.has_sinks():
            self._forces.log(build_forces(self._arrows, reader.row), log_time=ns)

    def tell(self, name: str, text: str, ns: int) -> None:
        """Publish a text (std_msgs/String)."""
        channel = self._channels.get(name)
        if channel is not None and channel.has_sinks():
            topic = Topic(name, "std_msgs/String", "", {}, {"data": text})
            channel.log(build_message(topic, ns), log_time=ns)

    def close(self) -> None:
        """Stop listening."""
        self._server.stop()
