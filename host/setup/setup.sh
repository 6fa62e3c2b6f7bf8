#!/bin/sh
# Brings a Jetson Nano (JetPack 4), an Orin Nano (JetPack 6) or a Raspberry Pi
# (Debian 12 or 13, 64 bit) to a running dart-hal. The guide: docs/build_guide/07_computer.md.
#
# Run it again at any time: what stands is left alone, and a run that was
# interrupted is continued. Every file is moved into its place when it is whole.
set -eu

usage() {
    cat <<'END'
usage: sh host/setup/setup.sh [options]      as the user who will drive, without sudo

  --dry-run     print every command and every file, change nothing
  --check       look at this computer only
  --car NAME    the car whose files are used; made from the example if it is new
  --with LIST   extras of the package: view (QR code), map, camera, fleet, ros, table, ...
                (default: view,map)
  --i2c N       number of the I2C bus with the PCA9685 (default: that of header pins 3 and 5)
  --ft232       the Nano has an FT232 bridge: neither ch341 nor brltty matter
  --uv FILE     use this uv instead of bringing one
  --remove      undo all of it; cars, Debian packages and groups stay
  -h, --help    this text

It never arms a car. Exit status: 0 done, 1 this computer or a step says no, 2 usage.
END
}

here=$(cd "$(dirname "$0")" && pwd)
checkout=$(cd "$here/../.." && pwd)
# For tests and for images of a memory card: everything outside the home goes below.
root=${DESTDIR:-}
PATH=$PATH:/usr/sbin:/sbin

# shellcheck source=host/setup/lib.sh
. "$here/lib.sh"
# shellcheck source=host/setup/checks.sh
. "$here/checks.sh"
# shellcheck source=host/setup/environment.sh
. "$here/environment.sh"
# shellcheck source=host/setup/system.sh
. "$here/system.sh"

value() { # OPTION VALUE PATTERN MEANING: the value of an option, or a usage error
    if [ -z "$2" ] || printf '%s' "$2" | tr '\n' ' ' | grep -qvE "^($3)\$"; then
        wrong "$1 wants $4, found '$2'"
    fi
    printf '%s' "$2"
}

dry=no job=setup car='' i2c='' extras='' ft232=no given_uv=''
while [ $# -gt 0 ]; do
    case $1 in
        --dry-run) dry=yes ;;
        --check) job=check ;;
        --remove) job=remove ;;
        --ft232) ft232=yes ;;
        --car) car=$(value --car "${2:-}" '[A-Za-z0-9][A-Za-z0-9_-]*' \
            'a name of letters, digits, - and _') || exit 2; shift ;;
        --with) extras=$(value --with "${2:-}" '[a-z]+(,[a-z]+)*' \
            'names of extras, as in view,camera') || exit 2; shift ;;
        --i2c) i2c=$(value --i2c "${2:-}" '[0-9]{1,3}' 'the number N of /dev/i2c-N') || exit 2
            shift ;;
        --uv) given_uv=$(value --uv "${2:-}" '/.*' 'the whole path of a uv program') || exit 2
            shift ;;
        -h | --help) usage; exit 0 ;;
        *) wrong "there is no option '$1'" ;;
    esac
    shift
done

on_linux
home_is_usable
data=$HOME/.local/share/dart-hal
state=$data/setup
environment=$root/etc/dart-hal.env
settings

if [ "$job" = remove ]; then
    single_run
    remove_all
    exit 0
fi

say "looking at this computer"
check_all
if [ "$stops" -gt 0 ]; then
    tell "$stops thing(s) to settle first; nothing was changed"
    [ "$dry" = yes ] || exit 1
    tell "what would follow then:"
fi
[ "$job" = setup ] || exit 0

single_run
step_packages
step_i2c
step_groups
name_environment
step_uv
step_python
step_package
step_car
step_settings
step_command
step_rules
step_sleep
step_service
finish
[ "$stops" -eq 0 ]
