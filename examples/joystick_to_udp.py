"""Send a joystick's state to `skywright run tool-install --operator udp:9870`.

    python examples/joystick_to_udp.py /dev/input/js0 9870

Linux only: it reads the kernel's joystick device (Documentation/input/joydev/joystick-api.rst),
which gamepads and, as a rule, a Space Navigator have. Right, back and down are positive there. A
gamepad's right stick often is axis 4: --axes 1,0,4. A key is taken from SKYWRIGHT_GATEWAY_KEY.
"""

import argparse
import struct
import threading
import time

from skywright.links.udp.address import load_key
from skywright.links.udp.client import ArmsClient

EVENT = struct.Struct("<IhBB")  # ms, value, type, number
BUTTON, AXIS, AT_START = 1, 2, 0x80
DEAD = 0.05  # of the deflection: a stick at rest is not quite in its middle
PERIOD = 0.02  # s


def main() -> None:
    """Read events in one thread, send the state they add up to in another."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("device")
    parser.add_argument("port", type=int)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--axes", default="1,0,2", help="numbers of those for ahead, left, up")
    arguments = parser.parse_args()
    ahead_left_up = [int(number) for number in arguments.axes.split(",")]
    axes: dict[int, float] = {}
    pressed: set[int] = set()
    gone = threading.Event()

    def send() -> None:
        with ArmsClient(arguments.host, arguments.port, load_key(None), timeout_s=300.0) as arms:
            while not gone.is_set():
                values = [-axes.get(number, 0.0) for number in ahead_left_up]
                values = [x if abs(x) > DEAD else 0.0 for x in values]
                arms.send_stick(values, int(bool(pressed)))
                arms.poll()
                time.sleep(PERIOD)

    sender = threading.Thread(target=send)
    with open(arguments.device, "rb", buffering=0) as device:
        sender.start()
        try:
            while len(data := device.read(EVENT.size)) == EVENT.size:
                _, value, kind, number = EVENT.unpack(data)
                if kind & ~AT_START == AXIS:
                    axes[number] = max(value / 32767.0, -1.0)
                elif kind & ~AT_START == BUTTON:
                    (pressed.add if value else pressed.discard)(number)
        except (KeyboardInterrupt, OSError):  # stopped, or unplugged
            pass
        finally:
            gone.set()


if __name__ == "__main__":
    main()
