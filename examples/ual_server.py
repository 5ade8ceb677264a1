"""A hexarotor that is commanded from ROS 2 alone: UAL's services and topics by their names.

    python examples/ual_server.py [tcp/HOST:PORT]

Ctrl-C ends it. See docs/howto/ros2.md.
"""

import sys
from contextlib import suppress

import skywright

endpoint = sys.argv[1] if len(sys.argv) > 1 else True
live = skywright.Live(ros2=endpoint, wait_s=3600.0)
with suppress(KeyboardInterrupt), skywright.fly("hexarotor", live=live) as vehicle:
    while True:
        vehicle.tick()  # 20 ms
