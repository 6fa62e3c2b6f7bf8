# The home of the user who drives: uv, Python 3.11, the package, the car's
# files. Sourced by setup.sh. Below ~/.local/share/dart-hal:
#   bin/uv          if this computer had none
#   python/         if this computer had no Python 3.11
#   venv-HASH/      one environment; .complete is written last
#   current         the environment in use: moved to a new one in one step
#   cars/           the builder's; never touched once it is there
# shellcheck shell=sh disable=SC2154

python_version=3.11
installer=https://astral.sh/uv/install.sh

name_environment() { # changes when the environment must be made anew
    hash=$({ cat "$checkout/pyproject.toml" "$here/constraints.txt"
        printf '%s' "$checkout" "$python_version" "$extras"; } | sha256sum | cut -c 1-12)
    venv=$data/venv-$hash
}

step_uv() {
    say "uv, which brings Python $python_version"
    [ ! -e "$venv/.complete" ] || return 0
    uv=$given_uv
    [ -n "$uv" ] || [ ! -x "$data/bin/uv" ] || uv=$data/bin/uv
    [ -n "$uv" ] || uv=$(command -v uv) || uv=''
    if [ -n "$uv" ]; then
        "$uv" --version >/dev/null 2>&1 || fail "$uv is not a uv that runs here" \
            "rm $uv, or name another with --uv FILE"
        return
    fi
    uv=$data/bin/uv
    over_network curl -fsSL --retry 2 -o "$state/uv-install.sh" "$installer"
    run rm -rf "$data/bin.new"
    over_network env UV_UNMANAGED_INSTALL="$data/bin.new" sh "$state/uv-install.sh"
    run rm -f "$state/uv-install.sh"
    run mv "$data/bin.new" "$data/bin"
}

in_home() { # uv with its interpreters in our folder, deaf to a project around us
    over_network env UV_PYTHON_INSTALL_DIR="$data/python" UV_NO_CONFIG=1 "$uv" "$@"
}

has_python() {
    [ -x "$uv" ] || { command -v "python$python_version" >/dev/null; return; }
    (cd / && env UV_PYTHON_INSTALL_DIR="$data/python" UV_NO_CONFIG=1 \
        UV_PYTHON_DOWNLOADS=never "$uv" python find --system "$python_version") >/dev/null 2>&1
}

step_python() {
    say "Python $python_version"
    [ -e "$venv/.complete" ] || has_python || in_home python install "$python_version"
}

step_package() {
    say "dart-hal in an environment of its own"
    if [ ! -e "$venv/.complete" ]; then
        [ ! -e "$venv" ] || run rm -rf "$venv"
        in_home venv --quiet --python "$python_version" "$venv"
        in_home pip install --quiet --python "$venv/bin/python" --only-binary :all: \
            --no-binary dart-hal \
            --constraint "$here/constraints.txt" --editable "${checkout}[$extras]"
        run "$venv/bin/dart-hal" --version
        run touch "$venv/.complete"
    fi
    if [ "$(readlink "$data/current" || true)" != "${venv##*/}" ]; then
        mark service
        run ln -sfn "${venv##*/}" "$data/current.new"
        run mv -fT "$data/current.new" "$data/current"
    fi
    for old in "$data"/venv-*; do
        [ "$old" = "$venv" ] || [ ! -e "$old" ] || run rm -rf "$old"
    done
}

step_car() {
    say "files of the car $car"
    for folder in "$data/cars" "$checkout/cars"; do
        [ ! -e "$folder/$car/car.toml" ] || return 0
    done
    run mkdir -p "$data/cars/$car"
    changes=$((changes + 1))
    printf '   > %s\n' "$data/cars/$car/car.toml"
    note "edit $data/cars/$car/car.toml: it is a copy of the example (09_weigh_and_describe.md)"
    [ "$dry" = no ] || return 0
    sed "s/^name = \"dart-01\"/name = \"$car\"/" "$checkout/cars/dart-01/car.toml" \
        >"$data/cars/$car/car.toml.new"
    mv "$data/cars/$car/car.toml.new" "$data/cars/$car/car.toml"
}
