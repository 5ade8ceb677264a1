#!/bin/sh
# make_venv.sh [VENV [LOCK]]: make the virtual environment VENV with the exact versions of LOCK
# (requirements.lock) and this project, editable. Uses uv if it is there, else python3's venv and
# pip. `make` calls it only when a lock or pyproject.toml changed, so that later runs need no
# network.
set -eu
venv=${1:-.venv}
lock=${2:-requirements.lock}
set --  # options of the installer
# A flight compiles the modules that it imports by itself; all packages take 20 s, which a newcomer
# who waits for the first flight is spared.
compile=yes
[ "$lock" = requirements-run.lock ] && compile=no
in_range='import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))'

fail() {
    echo "error: $*" >&2
    exit 1
}

# An environment of an older Python is replaced, one in range is reused.
if [ -e "$venv" ] && ! "$venv/bin/python" -c "$in_range" 2>/dev/null; then
    rm -rf "$venv"
fi

if command -v uv >/dev/null 2>&1; then
    [ -e "$venv" ] || uv venv --quiet --python '>=3.11,<3.14' "$venv" ||
        fail "uv found no Python 3.11 to 3.13: run 'uv python install 3.12', then make again"
    [ $compile = no ] || set -- --compile-bytecode
    uv pip install --quiet "$@" --python "$venv/bin/python" --require-hashes -r "$lock"
    uv pip install --quiet --python "$venv/bin/python" --no-deps --no-build-isolation -e .
    exit 0
fi

if [ ! -e "$venv" ]; then
    python=
    for candidate in python3 python3.13 python3.12 python3.11; do
        if "$candidate" -c "$in_range" 2>/dev/null; then
            python=$candidate
            break
        fi
    done
    if [ -z "$python" ]; then
        found=$(python3 --version 2>/dev/null || echo "no python3")
        fail "Skywright needs Python 3.11 to 3.13 (found: $found): install one, or uv, then make again"
    fi
    if ! "$python" -m venv "$venv" >/dev/null 2>&1; then
        rm -rf "$venv"
        fail "'$python -m venv' failed: install python3-venv (Debian, Ubuntu) or uv, then make again"
    fi
fi
[ $compile = yes ] || set -- --no-compile
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@" --require-hashes \
    -r "$lock"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps \
    --no-build-isolation -e .
