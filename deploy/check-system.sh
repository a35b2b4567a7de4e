#!/bin/sh
# Checks for what pip cannot bring: a C++ compiler, Python's headers, an OpenGL library that renders
# without a display; for the tests of the web UI, Chromium; for those of the alerts, Prometheus, which is not left
# running; for those on other processors, cross compilers and qemu; for those of several machines, iproute2. As root on Debian or Ubuntu it installs what is missing; elsewhere it says how.
# usage: check-system.sh [PYTHON [browser|observability|cross|network]]
set -eu
python=${1:-python3}
what=${2:-}
missing=""

need() { # need PACKAGES COMMAND...: the packages are missing if the command fails
    packages=$1
    shift
    "$@" >/dev/null 2>&1 || missing="$missing $packages"
}

python_headers() {
    "$python" -c 'import os, sysconfig; assert os.path.exists(sysconfig.get_path("include") + "/Python.h")'
}

rendering() { # EGL with Mesa's or a vendor's driver behind it, or OSMesa
    libraries=$(/sbin/ldconfig -p)
    case $libraries in *libOSMesa.so*) return 0 ;; esac
    case $libraries in *libEGL.so.1*) ;; *) return 1 ;; esac
    case $libraries in *libOpenGL.so.0* | *libGL.so.1*) ;; *) return 1 ;; esac
    case $libraries in *libEGL_mesa.so.0* | *libEGL_nvidia.so.0*) return 0 ;; esac
    return 1
}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "bpn needs Python 3.11 or newer; $python is not: call make with PYTHON=/path/to/python" >&2
    exit 1
}
if [ "$what" = browser ]; then
    need chromium command -v chromium
fi
if [ "$what" = observability ]; then
    need prometheus sh -c 'command -v prometheus && command -v promtool'
fi
if [ "$what" = network ]; then # namespaces, and the cables between them
    need iproute2 command -v ip
fi
if [ "$what" = cross ]; then # compilers for aarch64 and armv7, and an emulator of both
    need g++-aarch64-linux-gnu command -v aarch64-linux-gnu-g++
    need g++-arm-linux-gnueabihf command -v arm-linux-gnueabihf-g++
    need qemu-user command -v qemu-aarch64
fi
need g++ command -v g++
need python3-venv "$python" -c 'import ensurepip'
need python3-dev python_headers
need "libegl1 libegl-mesa0 libgl1-mesa-dri libgl1 libopengl0" rendering

[ -n "$missing" ] || exit 0
install="apt-get update && apt-get install -y --no-install-recommends$missing"
case $missing in *prometheus*) # the tests start their own; without systemd nothing would be started
    if command -v systemctl >/dev/null; then install="systemctl mask prometheus.service; $install"; fi ;;
esac
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing:$missing"
    DEBIAN_FRONTEND=noninteractive sh -c "$install" >/dev/null
    exit 0
fi
echo "these are missing:$missing" >&2
echo "on Debian or Ubuntu: sudo sh -c '$install'" >&2
exit 1
