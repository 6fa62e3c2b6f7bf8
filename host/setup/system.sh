# What needs root: Debian packages, I2C, groups, udev rules, the service.
# Sourced by setup.sh.
# shellcheck shell=sh disable=SC2154

packages="i2c-tools avrdude curl ca-certificates"
rules=$root/etc/udev/rules.d/80-dart.rules
unit=$root/etc/systemd/system/dart-hal.service
profile=$root/etc/profile.d/dart-hal.sh
modules=$root/etc/modules-load.d/dart-hal.conf
command_link=$root/usr/local/bin/dart-hal
units=$root/etc/systemd/system
sleep_targets="sleep.target suspend.target hibernate.target hybrid-sleep.target"

installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }

step_packages() {
    say "Debian packages"
    missing=''
    for package in $packages; do
        installed "$package" || missing="$missing $package"
    done
    [ -n "$missing" ] || return 0
    # shellcheck disable=SC2086 # a list of words is meant
    as_root apt-get install -y --no-install-recommends $missing && return
    as_root apt-get update || tell "some package lists are out of date; going on without them"
    # shellcheck disable=SC2086
    over_network sudo apt-get install -y --no-install-recommends $missing
}

step_i2c() {
    say "I2C"
    write_file "$modules" i2c <<END
i2c-dev
END
    if marked i2c; then
        as_root modprobe i2c-dev || tell "built into this kernel"
        unmark i2c
    fi
    [ ! -e "$root/dev/i2c-$i2c" ] || return 0
    ! on_raspberry || as_root raspi-config nonint do_i2c 0
    [ -e "$root/dev/i2c-$i2c" ] || note "sudo reboot: I2C was switched on and comes with it"
}

step_groups() { # i2c: the bus; dialout: the Nano's port
    say "groups of $user"
    for group in i2c dialout; do
        getent group "$group" >/dev/null || brought_by_package "$group" ||
            as_root groupadd --system "$group"
        case " $(id -nG "$user") " in
            *" $group "*) ;;
            *) as_root usermod -aG "$group" "$user"
                note "log out and in again: $user is now in the group $group" ;;
        esac
    done
}

brought_by_package() { # in a dry run only: i2c-tools, not there yet, makes the group i2c
    [ "$dry-$1" = yes-i2c ] && case $missing in *i2c-tools*) true ;; *) false ;; esac
}

step_settings() { # one file for the service and for every login
    say "settings of this car"
    write_file "$environment" service <<END
# Written by host/setup/setup.sh; change it by --car NAME, --i2c N, --with LIST.
DART_HAL_URL="serial:///dev/dart-nano?i2c=$i2c"
DART_HAL_CAR="$car"
DART_HAL_EXTRAS="$extras"
DART_CARS="$data/cars:$checkout/cars"
END
    write_file "$profile" login <<'END'
# Written by host/setup/setup.sh: which car this computer drives.
set -a
[ ! -r /etc/dart-hal.env ] || . /etc/dart-hal.env
set +a
END
    ! marked login || note "log out and in again: \$DART_HAL_URL and \$DART_HAL_CAR are set then"
    unmark login
}

step_command() {
    say "the command dart-hal"
    [ "$(readlink "$command_link" || true)" != "$data/current/bin/dart-hal" ] || return 0
    [ ! -e "$command_link" ] || [ -L "$command_link" ] ||
        fail "$command_link is another program's" "sudo mv $command_link $command_link.other"
    as_root mkdir -p "${command_link%/*}"
    as_root ln -sfn "$data/current/bin/dart-hal" "$command_link"
}

step_rules() {
    say "names of the Nano and the lidar: /dev/dart-nano, /dev/dart-lidar"
    write_file "$rules" rules <"$here/80-dart.rules"
    marked rules || return 0
    reload_rules
    unmark rules
}

reload_rules() {
    if [ ! -e "$root/run/udev/control" ]; then
        tell "udev does not run here: the rules count from the next start on"
        return 0
    fi
    as_root udevadm control --reload
    as_root udevadm trigger --action=change --subsystem-match=tty --subsystem-match=usb-serial
    as_root udevadm settle --timeout=10
}

step_sleep() { # a suspended computer stops no car; these links are what systemctl mask makes
    say "no suspend: a car would drive on while its computer sleeps"
    for target in $sleep_targets; do
        link=$units/$target
        [ "$(readlink "$link" || true)" != /dev/null ] || continue
        if [ -e "$link" ]; then
            note "sudo rm $link, then this script again: it lets the computer sleep"
            continue
        fi
        mark sleep
        [ "$dry" = yes ] || grep -qsx "$target" "$state/masked" || printf '%s\n' "$target" >>"$state/masked"
        as_root mkdir -p "$units"
        as_root ln -s /dev/null "$link"
    done
    marked sleep || return 0
    reload_units
    unmark sleep
}

let_it_sleep() { # only what step_sleep has masked
    [ -r "$state/masked" ] || return 0
    for target in $sleep_targets; do
        if grep -qx "$target" "$state/masked" && [ -L "$units/$target" ]; then
            as_root rm -f "$units/$target"
        fi
    done
    reload_units
}

step_service() {
    say "the service dart-hal, which stops a car that nobody drives any more"
    filled=$(sed -e "s|@USER@|$user|g" -e "s|@DATA@|$data|g" -e "s|@CHECKOUT@|$checkout|g" \
        "$here/dart-hal.service")
    write_file "$unit" service <<END
$filled
END
    systemctl is-enabled --quiet dart-hal.service 2>/dev/null || mark service
    marked service || return 0
    reload_units
    as_root systemctl enable dart-hal.service
    if [ -e "$root/dev/dart-nano" ]; then
        as_root systemctl restart dart-hal.service ||
            note "the service does not run; see: journalctl -u dart-hal -n 20"
    fi
    unmark service
}

reload_units() { # where systemd does not run (an image), it reads them at the next start
    [ ! -d "$root/run/systemd/system" ] || as_root systemctl daemon-reload
}

remove_all() {
    say "removing dart-hal from this computer"
    if [ -e "$unit" ]; then
        if [ -d "$root/run/systemd/system" ]; then
            as_root systemctl stop dart-hal.service
        fi
        as_root systemctl disable dart-hal.service
        as_root rm -f "$unit"
        reload_units
    fi
    let_it_sleep
    if [ -e "$rules" ]; then
        as_root rm -f "$rules"
        reload_rules
    fi
    for file in "$environment" "$profile" "$modules" "$unit.new" "$rules.new" "$environment.new" \
        "$profile.new" "$modules.new"; do
        [ ! -e "$file" ] || as_root rm -f "$file"
    done
    [ "$(readlink "$command_link" || true)" != "$data/current/bin/dart-hal" ] ||
        as_root rm -f "$command_link"
    for path in "$data/current" "$data"/venv-* "$data/bin" "$data/bin.new" "$data/python"; do
        [ ! -e "$path" ] && [ ! -L "$path" ] || run rm -rf "$path"
    done
    if [ "$dry" = yes ]; then
        tell "dry run: $changes changes, none was made"
    elif [ "$changes" -eq 0 ]; then
        say "nothing to do: nothing of it is here"
    else
        say "done: $changes changes"
    fi
    rm -rf "${state:?}/lock" 2>/dev/null || true
    [ "$dry" = yes ] || rm -rf "${state:?}"
    tell "left: your cars in $data/cars, the packages ($packages),"
    tell "      the groups (sudo gpasswd -d $user i2c ; sudo gpasswd -d $user dialout)"
}
