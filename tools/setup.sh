#!/bin/sh
# Make .venv inside the clone: locked wheels with hashes, and relight3d itself, editable.
# Usage: tools/setup.sh [--dev]    (--dev adds the checkers of `make check`)
set -eu
cd -- "$(dirname -- "$0")/.."
root=$(pwd -P)
stamp=.venv/.ready
[ "${1:-}" != --dev ] || stamp=.venv/.ready-dev

# A user's own settings must not leak in: another relight3d on PYTHONPATH, or pip writing somewhere else.
unset PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX PIP_REQUIRE_HASHES PIP_NO_BINARY || true
export PYTHONNOUSERSITE=1

# Two set-ups at once would spoil each other (where flock exists).
if [ "${RELIGHT3D_SETUP_LOCKED:-}" != "$root" ] && command -v flock >/dev/null; then
    RELIGHT3D_SETUP_LOCKED=$root exec flock "$root/tools/setup.sh" "$root/tools/setup.sh" "$@"
fi

# Python 3.11 is what the commands use; 3.10 to 3.13 work.
python=
for name in python3.11 python3 python3.12 python3.13 python3.10; do
    # Asked for its version, because a name on PATH may be a shim with nothing behind it.
    if "$name" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' >/dev/null 2>&1; then
        python=$name
        break
    fi
done
if [ -z "$python" ]; then
    echo "setup: no Python 3.10 to 3.13 found (on Debian: apt-get install python3 python3-venv)" >&2
    exit 1
fi

tools/setup_system.sh "$python"

# A .venv that was copied here from another path, or whose Python is gone, is made anew.
if [ -d .venv ] && ! { [ "$(cat .venv/.made-in 2>/dev/null)" = "$root" ] && .venv/bin/python -m pip --version >/dev/null 2>&1; }; then
    echo "setup: .venv does not belong to this folder, making it anew"
    rm -rf .venv
fi
if [ ! -d .venv ]; then
    if ! "$python" -c 'import venv, ensurepip' >/dev/null 2>&1; then
        # Debian ships Python without the two.
        package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
        if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
            echo "setup: installing $package"
            { apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$package"; } \
                >/dev/null </dev/null || true
        fi
        if ! "$python" -c 'import venv, ensurepip' >/dev/null 2>&1; then
            echo "setup: $python cannot make virtual environments (as root: apt-get install $package)" >&2
            exit 1
        fi
    fi
    "$python" -m venv .venv
    printf '%s\n' "$root" >.venv/.made-in
fi

pip() { .venv/bin/python -m pip --disable-pip-version-check --no-input "$@"; }

echo "setup: installing the locked packages into .venv"
pip install -qq --require-hashes --only-binary :all: -r requirements/lock.txt
[ "$stamp" = .venv/.ready ] || pip install -qq --require-hashes --only-binary :all: -r requirements/dev-lock.txt
pip install -qq --no-deps --no-build-isolation --editable .

touch .venv/.ready "$stamp"
