#!/bin/sh
# try_pythons.sh [VENV]: fly a mission and run the quick tests with the other Pythons that Skywright
# supports and that this machine has, each in an environment VENV-3.x that is kept. Versions that are
# not installed are listed and left out.
set -eu
cd "$(dirname "$0")/.."
venv=${1:-.venv}
ours=$("$venv/bin/python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')

# Whether $2 is a Python of version $1 that can make environments.
is_version() {
    "$2" -c "
import ensurepip, sys, venv
sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null
}

# The path of a working Python of version $1: on the PATH, of uv, or of pyenv.
find_python() {
    for candidate in "$(command -v "python$1" || true)" "$(uv python find "$1" 2>/dev/null || true)" \
        "${PYENV_ROOT:-${HOME:-/root}/.pyenv}/versions/$1".*/bin/python; do
        if is_version "$1" "$candidate"; then
            echo "$candidate"
            return
        fi
    done
}

for version in 3.11 3.12 3.13; do
    [ "$version" != "$ours" ] || continue
    python=$(find_python "$version")
    if [ -z "$python" ]; then
        echo "Python $version: not installed here, not tried"
        continue
    fi
    other=$venv-$version
    if ! is_version "$version" "$other/bin/python"; then
        rm -rf "$other"
        "$python" -m venv "$other"
    fi
    # An environment exists, so that make_venv.sh chooses no Python and skips what is installed.
    sh scripts/make_venv.sh "$other" requirements.lock
    echo "Python $version: a flight and the quick tests"
    folder=$(mktemp -d)
    "$other/bin/skywright" run waypoints --out "$folder/flown" >/dev/null
    rm -rf "$folder"
    "$other/bin/pytest" -n 2 --dist loadfile --quick -q
done
