#!/bin/sh
# One fake for every command that would look at or change the real computer: it notes
# the call, keeps a little state in $BOX/state, and dies where the test wants it.
name=${0##*/}
printf '%s %s\n' "$name" "$*" >>"$BOX/calls"
if [ -n "${KILL_AT:-}" ] && [ "$(wc -l <"$BOX/calls")" -ge "$KILL_AT" ]; then
    kill -9 0 # the whole process group: script, pipes, this
fi
# shellcheck disable=SC2254 # a pattern is meant
if [ -n "${REFUSE:-}" ]; then case "$name $*" in $REFUSE) exit 9 ;; esac; fi
has() { grep -qsx "$1" "$BOX/state/$2"; }
case $name in
    install | mv | rm | ln | touch | mkdir) exec "$BOX/tools/$name" "$@" ;;
    env) exec "$BOX/tools/env" "$@" ;;
    sudo)
        [ "$1" != -n ] || exit "${SUDO_N:-0}"
        exec "$@" ;;
    uname)
        case $1 in
            -s) echo "${UNAME_S:-Linux}" ;;
            -m) echo "${UNAME_M:-aarch64}" ;;
            -r) echo 4.9.337-tegra ;;
        esac ;;
    id)
        case $1 in
            -u) echo "${ID_U:-1000}" ;;
            -un) echo driver ;;
            -nG) tr '\n' ' ' <"$BOX/state/groups" ;;
        esac ;;
    date) case $1 in +%Y) echo "${YEAR:-2026}" ;; *) echo "${YEAR:-2026}-01-31 12:00" ;; esac ;;
    getconf) echo "glibc ${GLIBC:-2.27}" ;;
    df) printf 'x\nx 1 1 %s 1 /\n' "${FREE_KB:-8000000}" ;;
    modinfo) has "$1" drivers ;;
    dpkg-query) has "$4" packages && echo "install ok installed" ;;
    apt-get)
        [ -z "${OFFLINE:-}" ] || exit 100
        [ "$1" != install ] || for word in "$@"; do
            case $word in i2c-tools) echo i2c >>"$BOX/state/known_groups" ;; esac
            case $word in install | -*) ;; *) echo "$word" >>"$BOX/state/packages" ;; esac
        done ;;
    getent) has "$2" known_groups ;;
    groupadd) echo "$2" >>"$BOX/state/known_groups" ;;
    usermod) echo "$2" >>"$BOX/state/groups" ;;
    raspi-config) : >"$BOX/system/dev/i2c-1" ;;
    curl)
        [ -z "${OFFLINE:-}" ] || exit 6
        while [ "$1" != -o ]; do shift; done
        # shellcheck disable=SC2016 # expanded by the installer
        printf 'mkdir -p "$UV_UNMANAGED_INSTALL"; cp "$BOX/uv" "$UV_UNMANAGED_INSTALL/uv"\n' >"$2" ;;
    uv)
        case $1 in
            --version) echo "uv 0" ;;
            python)
                case $2 in
                    find) [ -e "$BOX/state/python" ] || command -v python3.11 >/dev/null ;;
                    install) [ -z "${OFFLINE:-}" ] && : >"$BOX/state/python" ;;
                esac ;;
            venv)
                for last in "$@"; do :; done
                mkdir -p "$last/bin" ;;
            pip)
                [ -z "${OFFLINE:-}" ] || exit 2
                while [ "$1" != --python ]; do shift; done
                printf '#!/bin/sh\necho dart-hal 0\n' >"${2%/*}/dart-hal"
                chmod +x "${2%/*}/dart-hal" ;;
        esac ;;
    systemctl)
        case $1 in
            is-enabled) [ -e "$BOX/state/enabled" ] ;;
            enable) : >"$BOX/state/enabled" ;;
            disable) rm -f "$BOX/state/enabled" ;;
        esac ;;
esac
