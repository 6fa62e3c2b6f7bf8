# What this computer must be and have before anything is changed: sourced by
# setup.sh. A check prints one line, and for a fault what to type.
# shellcheck shell=sh disable=SC2154

stops=0
needed_mb=1000

good() { printf '   ok    %-14s %s\n' "$1" "$2"; }
odd() { printf '   warn  %-14s %s\n         try: %s\n' "$1" "$2" "$3"; }
bad() {
    stops=$((stops + 1))
    printf '   STOP  %-14s %s\n         try: %s\n' "$1" "$2" "$3"
}

check_all() {
    check_processor
    check_system
    check_glibc
    check_clock
    check_sudo
    check_space
    check_i2c
    check_bridge
    check_brltty
    check_nano
}

model() { # "NVIDIA Jetson Nano Developer Kit", "Raspberry Pi 4 Model B Rev 1.4"
    tr -d '\0' 2>/dev/null <"$root/proc/device-tree/model" || printf 'a board without a name'
}

check_processor() {
    case $(uname -m) in
        aarch64 | arm64) good processor "$(uname -m), $(model)" ;;
        armv*) bad processor "$(uname -m): a 32-bit system; Python's packages are built for 64 bit" \
            "write Raspberry Pi OS (64-bit) to the memory card" ;;
        *) bad processor "$(uname -m) is not the computer of a car (aarch64)" \
            "make setup    (the emulated car, on any computer)" ;;
    esac
}

check_system() {
    if ! command -v apt-get >/dev/null || ! command -v systemctl >/dev/null; then
        bad system "no apt-get or no systemd here" "JetPack 4, or Raspberry Pi OS (64-bit)"
        return
    fi
    id='' version='' name='an unnamed system'
    if [ -r "$root/etc/os-release" ]; then
        id=$(release ID) version=$(release VERSION_ID) name=$(release PRETTY_NAME)
    fi
    case $id-$version in
        ubuntu-18.04 | ubuntu-20.04 | ubuntu-22.04 | ubuntu-24.04 | debian-12 | debian-13) good system "$name" ;;
        *) odd system "$name: not a system that this was written for" \
            "go on; if a step fails: JetPack 4, JetPack 6, Raspberry Pi OS of 2023 or later" ;;
    esac
}

release() { sed -n "s/^$1=\"\{0,1\}\([^\"]*\)\"\{0,1\}\$/\1/p" "$root/etc/os-release" | head -n 1; }

check_glibc() { # numpy and scipy are built for 2.27, the one of JetPack 4
    found=$(getconf GNU_LIBC_VERSION 2>/dev/null | sed 's/^glibc //') || found=''
    minor=${found#2.}
    case $found in
        2.[0-9]*) [ "${minor%%.*}" -lt 27 ] || { good glibc "$found"; return 0; } ;;
    esac
    bad glibc "${found:-none}: Python's packages need 2.27" "JetPack 4.2 or later, or Bookworm"
}

check_clock() { # without a battery it starts years ago, and then no certificate is valid yet
    if [ "$(date +%Y)" -ge 2025 ]; then
        good clock "$(date '+%Y-%m-%d %H:%M')"
    else
        bad clock "$(date '+%Y-%m-%d %H:%M'): no certificate is valid yet" \
            "connect the network and wait a minute, or: sudo date -s '2030-01-31 12:00'"
    fi
}

check_sudo() {
    if ! command -v sudo >/dev/null; then
        bad sudo "there is no sudo here" "su -c 'apt-get install sudo ; usermod -aG sudo $user'"
    elif sudo -n true 2>/dev/null; then
        good sudo "without a password"
    elif [ -t 0 ]; then
        good sudo "will ask for the password of $user"
    else
        bad sudo "sudo wants a password and nobody is at a terminal" \
            "run this in a terminal; if it says 'not in the sudoers file': su -c 'usermod -aG sudo \
$user', then log in again"
    fi
}

check_space() {
    free_mb=$(df -Pk "$HOME" | awk 'NR == 2 { print int($4 / 1024) }')
    if [ -d "$data/current" ] || [ "${free_mb:-0}" -ge "$needed_mb" ]; then
        good space "$free_mb MB free"
    else
        bad space "$free_mb MB free, $needed_mb MB needed in $HOME" \
            "sudo apt-get clean ; du -xh --max-depth=1 $HOME | sort -h"
    fi
}

# The bus of pins 3 and 5 of the header; host/dart_hal/devices/links/computers.py has the same table.
header_bus() {
    case $(model) in
        *"Orin Nano"* | *"Orin NX"* | *"AGX Orin"*) echo 7 ;;
        *"Xavier NX"* | *"AGX Xavier"* | *Jetson-AGX*) echo 8 ;;
        *) echo 1 ;; # Jetson Nano, Raspberry Pi
    esac
}
known_board() {
    case $(model) in
        *"Orin Nano"* | *"Orin NX"* | *"AGX Orin"* | *"Xavier NX"* | *"AGX Xavier"* | *Jetson-AGX*) true ;;
        *"Jetson Nano"* | *"Raspberry Pi"*) true ;;
        *) false ;;
    esac
}

# At 0x40 of another bus of an Orin Nano sits its power monitor, bound by a driver.
claimed() { [ -e "$root/sys/bus/i2c/devices/$i2c-0040/driver" ]; }

on_raspberry() { case $(model) in Raspberry*) true ;; *) false ;; esac; }

check_i2c() {
    if claimed; then
        bad i2c "0x40 on /dev/i2c-$i2c belongs to the kernel \
($(cat "$root/sys/bus/i2c/devices/$i2c-0040/name" 2>/dev/null || echo 'a driver'))" \
            "--i2c $(header_bus), the bus of pins 3 and 5 here; or remove a PCA9685's overlay"
    elif [ -e "$root/dev/i2c-$i2c" ] && ! known_board; then
        odd i2c "/dev/i2c-$i2c; which bus is at pins 3 and 5 of this board is not known here" \
            "its manual, then --i2c N; dart-hal reads who answers before it writes"
    elif [ -e "$root/dev/i2c-$i2c" ] && [ "$i2c" = "$(header_bus)" ]; then
        good i2c "/dev/i2c-$i2c, pins 3 and 5 of the header"
    elif [ -e "$root/dev/i2c-$i2c" ]; then
        odd i2c "/dev/i2c-$i2c, chosen by --i2c; pins 3 and 5 of this board are bus $(header_bus)" \
            "--i2c $(header_bus), unless you wired it so"
    elif on_raspberry && [ "$i2c" = 1 ] && command -v raspi-config >/dev/null; then
        good i2c "off; will be switched on"
    else
        present=''
        for bus in "$root"/dev/i2c-*; do
            [ ! -e "$bus" ] || present="$present ${bus##*/}"
        done
        bad i2c "no /dev/i2c-$i2c; there: ${present:-none}" \
            "sudo modprobe i2c-dev ; another number with --i2c N (pins 3 and 5 here: $(header_bus))"
    fi
}

has_driver() { # NAME: loaded, built in, or to be loaded
    [ -d "$root/sys/module/$1" ] || modinfo "$1" >/dev/null 2>&1 ||
        grep -qs "/$1\\.ko" "$root/lib/modules/$(uname -r)/modules.builtin"
}

check_bridge() {
    driver=ch341
    [ "$ft232" = no ] || driver=ftdi_sio
    if has_driver "$driver"; then
        good bridge "kernel driver $driver"
    elif [ "$driver" = ch341 ]; then
        bad bridge "this kernel has no driver ch341: a Nano with a CH340 gets no /dev/ttyUSB0" \
            "a Nano with an FT232 and --ft232; or build the driver: 07_computer.md, 'No ch341'"
    else
        bad bridge "this kernel has no driver ftdi_sio" "sudo apt-get install --reinstall \
linux-image-$(uname -r)"
    fi
}

check_brltty() { # takes the CH340 for a braille display, and /dev/ttyUSB0 vanishes
    takes=$(grep -ElsR '^[^#]*1a86.*7523' "$root/lib/udev/rules.d" "$root/usr/lib/udev/rules.d" \
        "$root/etc/udev/rules.d" 2>/dev/null | grep brltty | head -n 1) || takes=''
    if [ "$ft232" = yes ] || [ -z "$takes" ]; then
        good brltty "leaves the Nano alone"
    else
        bad brltty "$takes takes the Nano's CH340 for a braille display" \
            "sudo apt-get remove brltty    (if nobody reads braille here), or an FT232 and --ft232"
    fi
}

check_nano() {
    for device in "$root"/sys/bus/usb/devices/*; do
        [ -r "$device/idVendor" ] || continue
        case $(cat "$device/idVendor" "$device/idProduct" | tr '\n' ':') in
            1a86:7523:) good nano "a CH340 is plugged in" && return ;;
            0403:6001:) good nano "an FT232 is plugged in" && return ;;
        esac
    done
    odd nano "no CH340 (1a86:7523) and no FT232 (0403:6001) is plugged in" \
        "plug it in when this is done; a cable that only charges shows nothing"
}
