# Words, commands, files: sourced by setup.sh. Every change of this computer
# goes through `run`, `as_root` or `write_file`, which print it first and,
# with --dry-run, do no more than that.
# shellcheck shell=sh disable=SC2034,SC2154

changes=0
failed=''
notes=''

say() { printf '== %s\n' "$*"; }
tell() { printf '   %s\n' "$*"; }
note() { notes="$notes   $*
"; }

fail() { # SENTENCE [what to type]: ends the run
    printf 'error: %s\n' "$1" >&2
    [ $# -lt 2 ] || printf '  try: %s\n' "$2" >&2
    failed=''
    exit 1
}

wrong() { # a command line that cannot be meant
    printf 'error: %s\n  try: sh %s/setup.sh --help\n' "$1" "$here" >&2
    exit 2
}

run() { # COMMAND...: print it, and do it unless this is a dry run
    changes=$((changes + 1))
    printf '   $ %s\n' "$*"
    [ "$dry" = no ] || return 0
    failed=$*
    "$@" || return
    failed=''
}

as_root() { run sudo "$@"; }

over_network() { # COMMAND...: as run; a failure names the network as what to look at
    run "$@" || fail "this needed the network and did not succeed: $*" \
        "ping -c 1 deb.debian.org ; nmcli device wifi connect NAME password WORD ; then the same \
command again: what is done stays"
}

write_file() { # FILE [MARK]: standard input becomes FILE, at once and whole; MARK is then set.
    # Never behind a pipe: a subshell would forget the mark.
    if [ "$dry" = yes ]; then new=$(mktemp); else new=$state/new; fi
    cat >"$new"
    if cmp -s "$new" "$1"; then
        rm -f "$new"
        return
    fi
    [ -z "${2:-}" ] || mark "$2"
    changes=$((changes + 1))
    printf '   > %s\n' "$1"
    if [ "$dry" = yes ]; then
        sed 's/^/     | /' "$new"
    else
        failed="writing $1"
        sudo install -D -m 0644 "$new" "$1.new"
        sudo mv -f "$1.new" "$1"
        failed=''
    fi
    rm -f "$new"
}

# A mark outlives an interruption between a file and what must be told about it.
marks=' '
mark() {
    marks="$marks$1 "
    [ "$dry" = yes ] || : >"$state/todo.$1"
}
marked() { [ -e "$state/todo.$1" ] || case $marks in *" $1 "*) true ;; *) false ;; esac; }
unmark() { [ "$dry" = yes ] || rm -f "$state/todo.$1"; }

single_run() { # one at a time, and a word when it is interrupted
    [ "$dry" = no ] || return 0
    mkdir -p "$state"
    if command -v flock >/dev/null; then
        exec 9>"$state/lock"
        flock -n 9 || fail "another run of this script is under way" "wait for it to end"
    fi
    trap 'failed=""
          printf "\ninterrupted: what is done stays; the same command again goes on\n" >&2
          exit 130' INT TERM HUP
    trap 'ended $?' EXIT
}

ended() { # STATUS: a command that nobody had a word for ends the run with one
    [ "$1" -eq 0 ] || [ -z "$failed" ] || fail "this did not succeed: $failed" \
        "see what it says above; then the same command again: what is done stays"
}

on_linux() {
    [ "$(uname -s)" = Linux ] || fail \
        "this sets up the computer on the car, which runs Linux; this one runs $(uname -s)" \
        "make setup    (the emulated car, on any computer)"
}

home_is_usable() {
    [ "$(id -u)" -ne 0 ] || fail "run this as the user who will drive, not as root" \
        "sh $here/setup.sh    (it calls sudo by itself where it must)"
    user=$(id -un)
    for path in "${HOME:-}" "$checkout"; do
        case $path in
            /*[!A-Za-z0-9._/-]* | '' | [!/]*)
                fail "the path '$path' has characters that systemd and udev would take apart" \
                    "mv it to a path of letters, digits, '.', '_' and '-' only" ;;
        esac
    done
}

settings() { # --car, --i2c and --with, else what an earlier run wrote, else the defaults
    old_car='' old_i2c='' old_extras=''
    if [ -r "$environment" ]; then
        old_car=$(sed -n 's/^DART_HAL_CAR="\(.*\)"$/\1/p' "$environment")
        old_i2c=$(sed -n 's/^DART_HAL_URL=.*[?&]i2c=\([0-9]*\)"$/\1/p' "$environment")
        old_extras=$(sed -n 's/^DART_HAL_EXTRAS="\(.*\)"$/\1/p' "$environment")
    fi
    car=${car:-${old_car:-dart-01}}
    i2c=${i2c:-${old_i2c:-$(header_bus)}}
    extras=${extras:-${old_extras:-view,map}}
    known=$(sed -n '/^\[project.optional-dependencies\]/,/^\[project.scripts\]/s/^\([a-z]*\) = .*/\1/p' \
        "$checkout/pyproject.toml" | tr '\n' ' ')
    for extra in $(printf '%s' "$extras" | tr ',' ' '); do
        case " $known" in
            *" $extra "*) ;;
            *) wrong "--with wants extras of the package ($known), found '$extra'" ;;
        esac
    done
}

finish() {
    [ "$dry" = no ] || { tell "dry run: $changes changes, none was made"; return 0; }
    if [ "$changes" -eq 0 ]; then
        say "nothing to do: everything stands"
    else
        say "done: $changes changes"
    fi
    printf '%s' "$notes"
    tell "next: dart-hal flash, then dart-hal doctor (docs/build_guide/08_flash_and_check.md)"
}
