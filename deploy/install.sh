#!/bin/sh
# Installs spallwatch as a service, or takes it away; called by `make install-service` and `make uninstall-service`.
#
# PREFIX    the program, a virtual environment of its own below it      [/opt/spallwatch]
# CONFIG    a configuration a machine; nothing in it is overwritten     [/etc/spallwatch]
# DESTDIR   put before every path: for packages and for a trial without root
# PYTHON    the interpreter that the service will use, 3.11 or newer    [python3.11, else python3]
# BUILDER   a python with `build` and `hatchling`, to build the program's wheel
# PROGRAM   no: everything but the program                             [yes]
#
# Every CONFIG/NAME.toml becomes the service spallwatch@NAME with a daily backup (spallwatch-backup@NAME.timer), and
# spallwatch-page.service is their page: they are enabled and, where systemd runs, started anew. Services without their file are taken away. Doing it again gives the same.
# State and records (/var/lib/spallwatch) are never touched.
set -eu

PREFIX="${PREFIX:-/opt/spallwatch}"
CONFIG="${CONFIG:-/etc/spallwatch}"
DESTDIR="${DESTDIR:-}"
PROGRAM="${PROGRAM:-yes}"
SOURCE="$(cd "$(dirname "$0")/.." && pwd)"
UNITS=/etc/systemd/system
USERS=/etc/sysusers.d
WANTED="$DESTDIR$UNITS/multi-user.target.wants"
TIMERS="$DESTDIR$UNITS/timers.target.wants"

fail() {
    echo "install.sh: $*" >&2
    exit 2
}

machines() { # the names of the configuration files, one a line
    for file in "$DESTDIR$CONFIG"/*.toml; do
        if [ -e "$file" ]; then basename "$file" .toml; fi
    done
}

check() {
    for path in "$PREFIX" "$CONFIG"; do
        case "$path" in
        /home | /home/* | /root | /root/*) fail "$path: the service sees no home folder; choose another place" ;;
        *[!A-Za-z0-9/._-]*) fail "$path: expected letters, digits and . _ - / only" ;;
        /?*) ;;
        *) fail "$path: expected an absolute path" ;;
        esac
    done
    for file in "$DESTDIR$CONFIG"/*.toml; do
        name="$(basename "$file" .toml)"
        case "$name" in
        '*') ;; # there is none
        *[!A-Za-z0-9:_.-]*) fail "$CONFIG/$name.toml: expected a name of letters, digits and : _ . - only" ;;
        esac
    done
    if [ -z "$DESTDIR" ] && [ "$(id -u)" -ne 0 ]; then
        fail "must be run by root (or with DESTDIR, for a trial)"
    fi
}

choose_python() {
    PYTHON="${PYTHON:-$(command -v python3.11 || command -v python3 || true)}"
    [ -n "$PYTHON" ] || fail "no python3.11 or python3 was found; set PYTHON=/path/to/python"
    "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$PYTHON: Python 3.11 or newer is needed"
    base="$("$PYTHON" -c 'import sys; print(sys.base_prefix)')"
    case "$base" in
    /home/* | /root/*) fail "$PYTHON lives in $base, and the service sees no home folder; set PYTHON=/usr/bin/python3" ;;
    esac
    PYTHON="$("$PYTHON" -c 'import os, sys; print(os.path.realpath(sys.executable))')"
}

# The new environment is made beside the old one and takes its place when it is whole.
install_program() {
    choose_python
    venv="$DESTDIR$PREFIX/venv"
    work="$(mktemp -d)"
    trap 'rm -rf "$work" "$venv.new"' EXIT
    "${BUILDER:-$PYTHON}" -m build --wheel --no-isolation --outdir "$work" "$SOURCE" >"$work/log" 2>&1 ||
        { cat "$work/log" >&2; fail "the wheel cannot be built"; }
    rm -rf "$venv.new"
    "$PYTHON" -m venv "$venv.new"
    "$venv.new/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
        -r "$SOURCE/deploy/requirements.lock"
    "$venv.new/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-index "$work"/*.whl
    # Its programs name their interpreter by its path.
    grep -lI "$venv.new" "$venv.new"/bin/* | while read -r file; do
        sed -i "s#$venv.new#$PREFIX/venv#g" "$file"
    done
    chmod -R u=rwX,go=rX "$venv.new"
    rm -rf "$venv.old"
    if [ -e "$venv" ]; then mv "$venv" "$venv.old"; fi
    mv "$venv.new" "$venv"
    mkdir -p "$DESTDIR/usr/local/bin"
    link="$DESTDIR/usr/local/bin/spallwatch"
    if [ ! -e "$link" ] || [ -L "$link" ]; then ln -sfn "$PREFIX/venv/bin/spallwatch" "$link"; fi
}

put() { # FROM TO: a file with the chosen places in it
    mkdir -p "$(dirname "$2")"
    sed -e "s#/opt/spallwatch#$PREFIX#g" -e "s#/etc/spallwatch#$CONFIG#g" "$1" >"$2"
    chmod 644 "$2"
}

install_files() {
    mkdir -p "$DESTDIR$PREFIX/doc" "$DESTDIR$CONFIG/secrets"
    chmod 755 "$DESTDIR$PREFIX" "$DESTDIR$PREFIX/doc" "$DESTDIR$CONFIG"
    chmod 700 "$DESTDIR$CONFIG/secrets"
    put "$SOURCE/deploy/systemd/spallwatch@.service" "$DESTDIR$UNITS/spallwatch@.service"
    put "$SOURCE/deploy/systemd/spallwatch-page.service" "$DESTDIR$UNITS/spallwatch-page.service"
    put "$SOURCE/deploy/systemd/spallwatch-backup@.service" "$DESTDIR$UNITS/spallwatch-backup@.service"
    put "$SOURCE/deploy/systemd/spallwatch-backup@.timer" "$DESTDIR$UNITS/spallwatch-backup@.timer"
    put "$SOURCE/deploy/systemd/spallwatch.slice" "$DESTDIR$UNITS/spallwatch.slice"
    for unit in spallwatch@ spallwatch-page spallwatch-backup@; do
        put "$SOURCE/deploy/systemd/common.conf" "$DESTDIR$UNITS/$unit.service.d/10-common.conf"
    done
    put "$SOURCE/deploy/systemd/backup.conf" "$DESTDIR$UNITS/spallwatch-backup@.service.d/20-backup.conf"
    put "$SOURCE/deploy/systemd/spallwatch.sysusers.conf" "$DESTDIR$USERS/spallwatch.conf"
    put "$SOURCE/deploy/machine.toml.example" "$DESTDIR$CONFIG/machine.toml.example"
    put "$SOURCE/docs/how-to/deployment.md" "$DESTDIR$PREFIX/doc/deployment.md"
    put "$SOURCE/config.toml" "$DESTDIR$PREFIX/doc/config.toml"
}

has_manager() { [ -z "$DESTDIR" ] && [ -d /run/systemd/system ]; }

make_user() {
    if [ -n "$DESTDIR" ] || id spallwatch >/dev/null 2>&1; then return; fi
    if command -v systemd-sysusers >/dev/null; then
        systemd-sysusers "$USERS/spallwatch.conf"
    else
        useradd --system --user-group --home-dir /var/lib/spallwatch --shell /usr/sbin/nologin spallwatch
    fi
}

enable() { # UNIT TEMPLATE FOLDER: what `systemctl enable` does, without systemd too
    mkdir -p "$3"
    ln -sfn "$UNITS/$2" "$3/$1"
}

enable_machines() {
    for name in $(machines); do
        enable "spallwatch@$name.service" spallwatch@.service "$WANTED"
        enable "spallwatch-backup@$name.timer" spallwatch-backup@.timer "$TIMERS"
    done
    if [ -n "$(machines)" ]; then enable spallwatch-page.service spallwatch-page.service "$WANTED"; fi
}

disable() { # [all]: the services whose configuration is gone, or all
    for link in "$WANTED"/spallwatch@*.service "$TIMERS"/spallwatch-backup@*.timer \
        "$WANTED/spallwatch-page.service" "$WANTED/spallwatch.service"; do
        if [ ! -L "$link" ]; then continue; fi
        unit="$(basename "$link")"
        name="${unit#*@}"
        case "$unit" in
        *@*) file="$DESTDIR$CONFIG/${name%.*}.toml" ;;
        spallwatch-page.service) file="$DESTDIR$CONFIG" ;;
        # The one service of all machines, of an older version.
        *) file=/nowhere ;;
        esac
        if [ "${1:-}" != all ] && [ -e "$file" ]; then continue; fi
        if has_manager; then systemctl stop "$unit" || true; fi
        rm -f "$link"
    done
}

install_all() {
    check
    umask 022
    if [ "$PROGRAM" = yes ]; then install_program; fi
    install_files
    make_user
    disable
    if has_manager && [ -e "$UNITS/spallwatch.service" ]; then systemctl stop spallwatch.service || true; fi
    rm -f "$DESTDIR$UNITS/spallwatch.service"
    enable_machines
    if has_manager; then systemctl daemon-reload; fi
    echo "installed: $PREFIX, $CONFIG, $UNITS/spallwatch@.service, $UNITS/spallwatch-page.service"
    if [ -z "$(machines)" ]; then
        echo "next: write $CONFIG/NAME.toml after $CONFIG/machine.toml.example, check it with"
        echo "  sudo spallwatch check --config $CONFIG/NAME.toml"
        echo "and repeat this command"
        return
    fi
    units="$(machines | sed 's/.*/spallwatch@&.service/') spallwatch-page.service"
    timers="$(machines | sed 's/.*/spallwatch-backup@&.timer/')"
    echo "enabled:" $units $timers
    echo "backups: /var/lib/spallwatch-backup; on another disk: see $PREFIX/doc/deployment.md"
    # shellcheck disable=SC2086 # several units
    if has_manager; then systemctl restart $units $timers || fail "not all of them run; see: systemctl status 'spallwatch*'"; fi
}

uninstall_all() {
    check
    if has_manager; then systemctl stop spallwatch.slice spallwatch.service 2>/dev/null || true; fi
    disable all
    rm -f "$DESTDIR$UNITS/spallwatch-backup@.timer" "$DESTDIR$UNITS/spallwatch-backup@.service.d/20-backup.conf"
    for unit in spallwatch@ spallwatch-page spallwatch-backup@; do
        rm -f "$DESTDIR$UNITS/$unit.service" "$DESTDIR$UNITS/$unit.service.d/10-common.conf"
        rmdir "$DESTDIR$UNITS/$unit.service.d" 2>/dev/null || true
    done
    rm -f "$DESTDIR$UNITS/spallwatch.slice" "$DESTDIR$UNITS/spallwatch.service" "$DESTDIR$USERS/spallwatch.conf"
    rm -f "$DESTDIR$CONFIG/machine.toml.example" "$DESTDIR$PREFIX/doc/deployment.md" "$DESTDIR$PREFIX/doc/config.toml"
    rm -rf "$DESTDIR$PREFIX/venv" "$DESTDIR$PREFIX/venv.old" "$DESTDIR$PREFIX/venv.new"
    link="$DESTDIR/usr/local/bin/spallwatch"
    if [ -L "$link" ] && [ "$(readlink "$link")" = "$PREFIX/venv/bin/spallwatch" ]; then rm -f "$link"; fi
    for folder in "$PREFIX/doc" "$PREFIX" "$CONFIG/secrets" "$CONFIG"; do
        rmdir "$DESTDIR$folder" 2>/dev/null || true
    done
    if has_manager; then systemctl daemon-reload; fi
    echo "uninstalled; left as they are: configurations in $CONFIG, state and records in /var/lib/spallwatch, backups, the user spallwatch"
}

case "${1:-}" in
install) install_all ;;
uninstall) uninstall_all ;;
*) fail "usage: install.sh install|uninstall" ;;
esac
