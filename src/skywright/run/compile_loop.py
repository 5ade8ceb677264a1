"""Program of a warm-up's process: `python -m skywright.run.compile_loop`, description on stdin."""

import pickle
import sys

from skywright.run.backends import build_vehicle

if __name__ == "__main__":
    build_vehicle(pickle.load(sys.stdin.buffer)).tick()
