#!/bin/sh
# Build the wheel, install it with what it declares into an environment of its own, and fly.
# A file that the wheel lacks, or a dependency that it does not declare, fails here.
set -eu
python=$(cd "${1:-.venv}/bin" && pwd)/python
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$python" -m hatchling build -t wheel -d "$work/dist" >/dev/null
"$python" -m venv "$work/env"
# The versions of the lock, without its hashes: they would be asked of the wheel too.
sed -n 's/^\([A-Za-z0-9._-]*==[^ ;\\]*\).*/\1/p' requirements.lock >"$work/versions.txt"
"$work/env/bin/python" -m pip install --quiet --disable-pip-version-check \
    -c "$work/versions.txt" "$work"/dist/*.whl
cd "$work" # no source tree beside it
export NUMBA_CACHE_DIR="$work/compiled"
env/bin/skywright run waypoints --out flown
env/bin/python -c "import skywright; assert skywright.evaluate(\"flown\").metrics"
test -s flown/report.html && test -s flown/recording.mcap
