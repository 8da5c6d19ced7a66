#!/bin/sh
# Sets up everything the project needs on a Debian-like machine: system libraries, a virtual environment, the project
# in it, and its compiled loops. Usage: setup.sh VENV
set -eu

venv=$1
python=${PYTHON:-python3}

say() { echo "setup: $*" >&2; }

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
    { say "Python 3.11 or newer is needed, '$python' is not; name one with PYTHON=..."; exit 1; }

has_library() { ldconfig -p 2>/dev/null | grep -q "$1" || ls /usr/lib/*/"$1"* /usr/lib/"$1"* >/dev/null 2>&1; }

missing=""
need() { has_library "$1" || missing="$missing $2"; }
need libusb-1.0.so.0 libusb-1.0-0
need libGL.so.1 libgl1
need libX11.so.6 libx11-6
need libgomp.so.1 libgomp1
"$python" -c 'import ensurepip' 2>/dev/null || missing="$missing python3-venv"
needed=$missing
# pictures without a screen; the tests that look at pictures skip where this is not to be had
need libvulkan_lvp.so mesa-vulkan-drivers
need libxkbcommon-x11.so.0 libxkbcommon-x11-0
# the test of the page for browsers; Ubuntu's package of this name is a snap, which containers cannot run
grep -qs '^ID=debian' /etc/os-release && ! command -v chromium >/dev/null && missing="$missing chromium"

if [ "$(id -u)" -eq 0 ]; then as_root=""; elif sudo -n true 2>/dev/null; then as_root="sudo"; else as_root=none; fi
command -v apt-get >/dev/null || as_root=none
install="apt-get update && apt-get install -y --no-install-recommends$missing"
if [ -n "$needed" ] && [ "$as_root" = none ]; then
    say "system packages are missing and cannot be installed from here; run this once, then make again:"
    say "    sudo sh -c '$install'"
    exit 1
fi
if [ -n "$missing" ] && [ "$as_root" != none ]; then
    say "installing$missing"
    DEBIAN_FRONTEND=noninteractive $as_root sh -c "$install" >/dev/null ||
        { say "apt-get failed; run: $install"; exit 1; }
fi

[ -x "$venv/bin/python" ] || { say "making the virtual environment $venv"; "$python" -m venv "$venv"; }
say "installing the project and what it stands on (about 1.5 GB, a minute or two)"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -e '.[dev]'
say "compiling the loops"
"$venv/bin/python" -m tools.warm
