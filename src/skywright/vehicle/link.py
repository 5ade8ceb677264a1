"""The control link: delays and loses the packets between the robot and the controller.

Each control tick the robot sends one packet with all sensor outputs, and the controller sends one
with the drives. A packet takes `delay` plus normal jitter, arrives in order (a later packet waits
for an earlier one), and is lost with a fixed probability. Packets have time stamps, and the clocks
are synchronised. The fields of a record define how it is merged at the far end (component.py:
Output).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.description.world.spec import Link as LinkTable
from skywright.vehicle.bus import Clock, Drive
from skywright.vehicle.component import (
    Component,
    Draws,
    Fault,
    Normal,
    Out,
    Output,
    helper,
    integers,
    words,
)

DEPTH = 256
"""Most packets in transit in each direction; the longest delay needs fewer."""
MAX_PORTS = 24
"""Most records that a packet holds."""
MAX_ARRAYS = 8
"""Most arrays of a batch."""
LATEST, FRESH, BATCH = range(3)
"""Merging of a record: copied; copied if its first word marks it as new; appended."""


def get_rule(record: type[Record]) -> int:
    """Return how the far end of a link merges a record."""
    if issubclass(record, Drive):
        return LATEST
    names = tuple(record.dtype.names or ())
    return FRESH if names[:1] == ("fresh",) else BATCH if names[:2] == ("t", "n") else LATEST


class Reception(Output):
    """The newest packet that has arrived at the controller; a lost one leaves it unchanged."""

    sent: float  # s
    delay: float  # s, from the sending to the control tick of the arrival


class Carriage(Record):
    """A record in a packet."""

    source: int  # address
    target: int  # address
    at: int  # word in the packet
    words: int
    rule: int
    room: int  # rows of a batch
    n_arrays: int
    first: Annotated[Integers, MAX_ARRAYS]  # word in the record of an array of rows
    width: Annotated[Integers, MAX_ARRAYS]  # words a row


class Way(Record):
    """One direction of a link."""

    head: int
    tail: int
    last: float  # s, arrival of the newest packet in transit
    arrival: Annotated[Array, DEPTH]  # s
    sent: Annotated[Array, DEPTH]  # s
    newest: float  # s, sending of the newest packet that has arrived
    packets: int  # address of (DEPTH, packet_words)
    packet_words: int
    n: int
    carried: Annotated[Carriage, MAX_PORTS]


class ControlLink(Component):
    """Delays or loses the records that a `[world.link]` carries."""

    group, side, Table = "link", "plant", LinkTable
    slots = {"up": "link", "down": "downlink"}

    class Me(Record):
        delay: float  # s
        jitter: float  # s, 1 sigma
        loss: float  # fraction
        begun: int
        upward: Way
        downward: Way

    class Chance(Normal):
        stream = "link"
        jitter_up: float
        jitter_down: float
        loss_up: float  # uniform
        loss_down: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Lay out the packets of both directions."""
        me.delay, me.jitter, me.loss = table.delay_s, table.jitter_s, table.loss_fraction
        self._packets: list[Array] = []
        down = [c for c in context.carried if issubclass(c.record, Drive)]
        self._lay_out(me.upward, [c for c in context.carried if c not in down], context)
        self._lay_out(me.downward, down, context)

    def _lay_out(self, way: Any, carried: Any, context: Any) -> None:
        at = 0
        way.n = len(carried)
        for i, c in enumerate(carried):
            x, dtype = way.carried[i], c.record.dtype
            x["source"], x["target"] = c.source, c.target
            x["at"], x["words"], x["rule"] = at, dtype.itemsize // 8, get_rule(c.record)
            if x["rule"] == BATCH:
                arrays = dtype.names[2:]
                x["room"], x["n_arrays"] = dtype[arrays[0]].shape[0], len(arrays)
                for k, name in enumerate(arrays):
                    x["first"][k] = dtype.fields[name][1] // 8
                    x["width"][k] = dtype[name].itemsize // 8 // dtype[name].shape[0]
            at += dtype.itemsize // 8
        way.packet_words = at
        packets = np.zeros((DEPTH, max(at, 1)))
        self._packets.append(packets)
        way.packets = context.keep(packets)

    def save(self) -> Any:
        """Return the packets in transit."""
        return [packets.copy() for packets in self._packets]

    def restore(self, saved: Any) -> None:
        """Restore the packets in transit."""
        for packets, were in zip(self._packets, saved, strict=True):
            packets[:] = were

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Draw the random numbers of both directions, first the jitter, then the loss."""
        return np.hstack([rng.standard_normal((n, 2)), rng.random((n, 2))])

    @staticmethod
    def up(me: Me, clock: Clock, chance: Chance, reception: Out[Reception]) -> None:
        if me.begun == 0:  # the first packet has no delay: the controller has the initial state
            me.begun = 1
            send(me.upward, clock.t, 0.0)
        elif chance.loss_up >= me.loss:
            delay = max(me.delay + me.jitter * chance.jitter_up, 0.0)
            send(me.upward, clock.t, delay)
        deliver(me.upward, clock.t)
        if me.upward.newest > reception.sent:
            reception.sent = me.upward.newest
            reception.delay = clock.t - reception.sent

    @staticmethod
    def down(me: Me, clock: Clock, chance: Chance) -> None:
        if chance.loss_down >= me.loss:
            delay = max(me.delay + me.jitter * chance.jitter_down, 0.0)
            send(me.downward, clock.t, delay)
        deliver(me.downward, clock.t)

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield a link if it has a delay, jitter or loss, or if a fault needs one."""
        link = context.world.link
        asked = any(isinstance(part, Fault) and part.needs_link for part in context.named)
        if asked or link.delay_s > 0.0 or link.jitter_s > 0.0 or link.loss_fraction > 0.0:
            yield cls("link", link)


@helper
def send(way: Any, t: float, delay: float) -> None:
    """Send a packet; it does not overtake the packet before it."""
    i = way.head
    following = (i + 1) % DEPTH
    if following == way.tail:  # full: the oldest is lost
        way.tail = (way.tail + 1) % DEPTH
    way.last = max(t + delay, way.last)
    way.arrival[i], way.sent[i] = way.last, t
    for p in range(way.n):
        c = way.carried[p]
        source = words(c.source, c.words)
        packet = words(way.packets + 8 * (i * way.packet_words + c.at), c.words)
        for k in range(c.words):
            packet[k] = source[k]
    way.head = following


@helper
def deliver(way: Any, t: float) -> None:
    """Merge the packets that have arrived by `t`: the newest state, all samples of batches."""
    for p in range(way.n):
        c = way.carried[p]
        if c.rule == FRESH:
            words(c.target, 1)[0] = 0.0
        elif c.rule == BATCH:
            integers(c.target, 2)[1] = 0
    while way.tail != way.head and way.arrival[way.tail] <= t + 1e-9:
        for p in range(way.n):
            c = way.carried[p]
            merge(c, way.packets + 8 * (way.tail * way.packet_words + c.at))
        way.newest = way.sent[way.tail]
        way.tail = (way.tail + 1) % DEPTH


@helper
def merge(c: Any, packet: int) -> None:
    """Merge one record of a packet into the record at the far end."""
    new, held = words(packet, c.words), words(c.target, c.words)
    if c.rule == BATCH:
        came, have = integers(packet, 2), integers(c.target, 2)
        held[0] = new[0]
        for r in range(came[1]):
            if have[1] < c.room:
                for a in range(c.n_arrays):
                    first, width = c.first[a], c.width[a]
                    for k in range(width):
                        held[first + have[1] * width + k] = new[first + r * width + k]
                have[1] += 1
    elif c.rule == LATEST or new[0] > 0.0:
        for k in range(c.words):
            held[k] = new[k]


class Freshness(Component):
    """Starts each tick with stale samples and empty batches."""

    slot, side = "clear", "plant"

    class Me(Record):
        n: int
        n_batches: int
        addresses: int  # of the outputs' addresses, batches last

    def build(self, me: Any, table: Any, context: Any) -> None:
        """List the outputs by their fields."""
        found = [(r, x) for (r, _), x in context.records.items() if issubclass(r, Output)]
        fresh = [x.ctypes.data for r, x in found if get_rule(r) == FRESH]
        batches = [x.ctypes.data for r, x in found if get_rule(r) == BATCH]
        me.n, me.n_batches = len(fresh), len(batches)
        me.addresses = context.keep(np.array([*fresh, *batches, 0], np.int64))

    @staticmethod
    def step(me: Me) -> None:
        at = integers(me.addresses, me.n + me.n_batches)
        for i in range(me.n):
            words(at[i], 1)[0] = 0.0
        for i in range(me.n, me.n + me.n_batches):
            integers(at[i], 2)[1] = 0

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for every vehicle."""
        yield cls("freshness")
