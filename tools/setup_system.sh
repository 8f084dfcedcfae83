#!/bin/sh
# Make sure of the system libraries that the wheels expect: probe first, install only what is missing, and only as root on
# Debian or Ubuntu. Usage: tools/setup_system.sh PYTHON
#
# Importing Open3D and pymeshlab needs `required`. The others have a fallback: without Vulkan frames are written without
# Open3D, without Xvfb the tests that open a window are skipped, without libgomp numba has its slowest threads.
set -eu
python=${1:-python3}

[ "$(uname -s)" = Linux ] || exit 0

# Prints one word per missing Debian package. The loader itself is asked (ctypes), for a file's name says nothing about its
# architecture. Vulkan without a driver makes Open3D abort, so the driver's description counts as much as the library.
probe() {
    "$python" - "$@" <<'PYTHON'
import ctypes, glob, os, shutil, sys

def loads(name):
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True

def has_vulkan_driver():
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    roots = ["/usr/share", "/usr/local/share", "/etc", *os.environ.get("XDG_DATA_DIRS", "").split(":")]
    return bool(named) or any(glob.glob(f"{root}/vulkan/icd.d/lvp_icd*.json") for root in roots if root)

required = {
    "libegl1": lambda: loads("libEGL.so.1"),
    "libgl1": lambda: loads("libGL.so.1"),
    "libopengl0": lambda: loads("libOpenGL.so.0"),
    "libusb-1.0-0": lambda: loads("libusb-1.0.so.0"),
}
optional = {
    "libgomp1": lambda: loads("libgomp.so.1"),
    "libvulkan1": lambda: loads("libvulkan.so.1"),
    "mesa-vulkan-drivers": has_vulkan_driver,
    "xvfb": lambda: shutil.which("Xvfb") is not None,
    "xauth": lambda: shutil.which("xauth") is not None,
}
wanted = {"required": required, "optional": optional}[sys.argv[1]]
print(*[package for package, is_there in wanted.items() if not is_there()])
PYTHON
}

required=$(probe required)
optional=$(probe optional)
[ -n "$required$optional" ] || exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "setup: installing system packages: $required $optional"
    export DEBIAN_FRONTEND=noninteractive
    log=$(mktemp)
    # shellcheck disable=SC2086  # one word per package
    if ! { apt-get -qq -o DPkg::Lock::Timeout=120 update &&
           apt-get -qq -o DPkg::Lock::Timeout=120 install -y --no-install-recommends $required $optional; } \
           >"$log" 2>&1 </dev/null; then
        tail -n 20 "$log" >&2
    fi
    rm -f "$log"
    required=$(probe required)
    optional=$(probe optional)
fi

how="as root: apt-get install --no-install-recommends"
if [ -n "$optional" ]; then
    echo "setup: some output falls back to plainer ways; for all of it, $how $optional" >&2
fi
if [ -n "$required" ]; then
    echo "setup: Open3D and pymeshlab need system libraries; $how $required" >&2
    exit 1
fi
