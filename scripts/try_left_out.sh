#!/bin/sh
# try_left_out.sh VENV learn|cuda: run the tests of a mark that `make test` leaves out because of the
# size of what they need, which is installed into an environment VENV-learn or VENV-cuda that is kept.
set -eu
cd "$(dirname "$0")/.."
venv=$1
other=$venv-$2

# Install into the other environment.
install() {
    if command -v uv >/dev/null 2>&1; then
        uv pip install --quiet --python "$other/bin/python" "$@"
    else
        "$other/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
    fi
}

case $2 in
learn)
    sh scripts/make_venv.sh "$other" requirements.lock
    install --no-build-isolation -e '.[learn]'
    "$other/bin/pytest" -q -m learn tests/test_learning.py
    ;;
cuda)  # the tests call the other Python: numba-cuda is not beside what they use themselves
    sh scripts/make_venv.sh "$other" requirements-run.lock
    install numba-cuda nvidia-nvvm nvidia-cuda-nvrtc nvidia-cuda-nvcc
    for bin in "$other"/lib/python3.*/site-packages/nvidia/cu*/bin; do
        PATH=$bin:$PATH  # ptxas: one of an older toolkit refuses what nvrtc writes
    done
    PATH=$PATH SKYWRIGHT_CUDA=$other/bin/python "$venv/bin/pytest" -q -m cuda tests/test_cuda.py
    ;;
*)
    echo "error: $2: no such mark; valid: learn, cuda" >&2
    exit 2
    ;;
esac
