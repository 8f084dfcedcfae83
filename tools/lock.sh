#!/usr/bin/env bash
# Remake the locks from pyproject.toml: `tools/lock.sh`, or `tools/lock.sh --upgrade` for newer versions.
#
# One set of pins serves Python 3.10 to 3.13 on every platform; markers choose. The locks carry hashes and no address of a
# registry: whoever installs uses their own.
set -euo pipefail
cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.."

lock() {
    .venv/bin/uv pip compile --quiet --universal --python-version 3.10 --generate-hashes \
        --no-annotate --no-header --no-emit-index-url --no-emit-find-links "$@"
}

# The build backend belongs to the lock too: relight3d itself is installed without build isolation.
lock pyproject.toml requirements/build.in --extra test --output-file requirements/lock.txt "$@"
# The checkers' versions may not move the library's.
lock pyproject.toml requirements/build.in --extra dev --constraints requirements/lock.txt \
    --output-file requirements/dev-lock.txt "$@"

if grep -HnE '://|^ *(-i|--(extra-)?index-url|--find-links)' requirements/*.txt; then
    echo "tools/lock.sh: a lock names an address" >&2
    exit 1
fi
