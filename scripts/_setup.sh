# Sourced by the scripts beside it, from the repository root: makes .venv and installs this checkout into it.
# Asks nothing, changes nothing outside .venv except that it installs system packages where it may: EGL and Vulkan to
# render without a display, and a browser for the tests of pages.

say() { echo "vispeg: $*" >&2; }

find_python() { # the first Python >= 3.11 that runs and can make an environment
    local candidate bare=""
    for candidate in ${PYTHON:-} python3.13 python3.12 python3.11 python3 python; do
        "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 || continue
        if "$candidate" -c 'import ensurepip, venv' >/dev/null 2>&1; then
            echo "$candidate"
            return 0
        fi
        bare=$("$candidate" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
    done
    if [ -n "$bare" ]; then
        say "error: $bare has no venv module; run: sudo apt-get install -y $bare-venv"
    else
        say "error: Python 3.11 or newer is needed; run: sudo apt-get install -y python3 python3-venv"
    fi
    return 1
}

setup() { # setup NAME TARGET: installs TARGET (`.` or `.[extras]`) once; again when what it depends on has changed
    local name=$1 target=$2 python stamp
    if ! .venv/bin/python -c pass 2>/dev/null; then # none yet, or its interpreter has gone
        python=$(find_python) || exit 1
        say "making .venv with $("$python" --version)"
        "$python" -m venv --clear .venv
    fi
    .venv/bin/python -m pip --version >/dev/null 2>&1 || .venv/bin/python -m ensurepip >/dev/null # a half-made one
    stamp=$(cat pyproject.toml constraints.txt scripts/_setup.sh | .venv/bin/python -c \
        'import hashlib, sys; print(hashlib.sha256(sys.stdin.buffer.read()).hexdigest())')
    if [ "$(cat ".venv/.installed-$name" 2>/dev/null)" != "$stamp" ]; then
        say "installing the packages (a minute or two, once)"
        .venv/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e "$target" || exit 1
        install_egl
        echo "$stamp" | tee ".venv/.installed-$name" >.venv/.installed-base # every target contains the base
    fi
}

apt() { # apt WHY PACKAGE...: installs system packages; fails where this user may not
    local as="" why=$1
    shift
    if [ "$(id -u)" != 0 ]; then
        as="sudo -n"
    fi
    command -v apt-get >/dev/null && { [ -z "$as" ] || $as true 2>/dev/null; } || return 1
    say "installing $*, $why"
    $as apt-get update -qq >&2 && DEBIAN_FRONTEND=noninteractive $as apt-get install -qq -y "$@" >&2
}

install_egl() { # pictures without a display need EGL, the Filament renderer Vulkan; everything else works without
    local packages=(libegl1 libopengl0 libgl1-mesa-dri libvulkan1 mesa-vulkan-drivers)
    [ "$(uname)" = Linux ] || return 0
    .venv/bin/python -c 'import ctypes; [ctypes.CDLL(n) for n in ("libEGL.so.1", "libOpenGL.so.0", "libvulkan.so.1")]' \
        2>/dev/null && return 0
    apt "to render without a display" "${packages[@]}" ||
        say "note: no EGL or no Vulkan, so pictures are ray-cast; to get them run: sudo apt-get update && sudo apt-get install -y ${packages[*]}"
}

install_browser() { # the tests of pages need one; without it they would be skipped in silence
    .venv/bin/python tests/browser.py >/dev/null && return 0
    apt "for the tests of pages" chromium || .venv/bin/python -m playwright install chromium >&2 || true
    .venv/bin/python tests/browser.py >/dev/null && return 0
    say "error: no Chromium, which the tests of pages need; run: sudo apt-get install -y chromium"
    exit 1
}
