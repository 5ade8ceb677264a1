"""What a warm-up's process does: `python -m skywright.run.compile_loop`."""

from skywright.description.loader import load_description
from skywright.run.run import build_vehicle

if __name__ == "__main__":
    # what is compiled does not depend on robot or world
    build_vehicle(load_description("pipe-weld-scan")).tick()
