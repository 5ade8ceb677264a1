"""What a warm-up's process does: `python -m skywright.run.compile_loop`, a description on stdin."""

import pickle
import sys

from skywright.run.backends import build_vehicle

if __name__ == "__main__":
    build_vehicle(pickle.load(sys.stdin.buffer)).tick()
