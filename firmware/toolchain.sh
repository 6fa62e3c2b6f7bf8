#!/bin/sh
# Brings the AVR compiler, simavr and avrdude, then builds firmware and
# emulator bridge. Where that is impossible, or the build fails, it prints a
# notice and exits 0: the package then uses MockNano, with a notice as well.
#   toolchain.sh              what `make` calls
#   toolchain.sh --apt PKG..  install Debian packages only (fails if it cannot)
set -u
here=$(cd "$(dirname "$0")" && pwd)
packages="gcc-avr avr-libc binutils-avr arduino-core-avr libsimavr-dev libelf-dev avrdude"

apt_install() {
    command -v apt-get >/dev/null || { echo "-- no apt-get here"; return 1; }
    sudo=""
    if [ "$(id -u)" -ne 0 ]; then
        sudo -n true 2>/dev/null || [ -t 0 ] || { echo "-- not root and no sudo"; return 1; }
        sudo="sudo"
    fi
    echo "-- installing Debian packages: $*"
    export DEBIAN_FRONTEND=noninteractive
    $sudo apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1 && return 0
    $sudo apt-get update -qq && $sudo apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

if [ "${1:-}" = "--apt" ]; then shift; apt_install "$@"; exit; fi

missing=""
command -v avr-gcc >/dev/null || missing="gcc-avr"
command -v avrdude >/dev/null || missing="$missing avrdude"
[ -e /usr/share/arduino/hardware/arduino/avr/cores/arduino/Arduino.h ] || missing="$missing arduino-core-avr"
[ -e /usr/include/simavr/sim_avr.h ] || missing="$missing libsimavr-dev"
if [ -n "$missing" ]; then
    # shellcheck disable=SC2086 -- a list of words is meant
    apt_install $packages || {
        echo "-- NOTICE: missing $missing. The emulated firmware is not available;"
        echo "   the Python MockNano takes its place. To install by hand:"
        echo "   sudo apt-get install --no-install-recommends $packages"
        exit 0
    }
fi
make -s -C "$here" hex emulator && exit 0
# Half a build is removed: the older firmware in it would run in the place of this one.
rm -f "$here/build/dart_nano.elf" "$here/build/dart_nano.hex" "$here/build/libdartemu.so"
echo "-- NOTICE: firmware or emulator bridge could not be built (see above). The emulated firmware"
echo "   is not available; the Python MockNano takes its place. To try again: make firmware"
