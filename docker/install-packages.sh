#!/bin/sh
# Installs the Debian 12 packages that are missing and nothing else; quiet when there is nothing to do.
#
#   install-packages.sh build   what `make` needs
#   install-packages.sh test    ... and what `make test` needs
#   install-packages.sh demo    ... and what `make demo` needs
#   install-packages.sh cluster ... and what `make demo-cluster` needs
#   install-packages.sh bench   ... and what `make bench` compares with
#
# Exit status: 0 all there, 1 a package could not be installed, 2 usage.
set -eu

build="gcc g++ make pkg-config libmicrohttpd-dev libuv1-dev libcjson-dev libsqlite3-dev libdraco-dev
    libcurl4-openssl-dev nettle-dev libspng-dev zlib1g-dev libexpat1-dev libzip-dev libpq-dev"
# draco brings the encoder and decoder programs that files are compared with. The daemon loads meshoptimizer's library
# when a glTF file needs it (server/format/meshopt.h), libzip when a 3MF file does (server/format/archive.h), and libpq and
# libcurl, of which only the headers are needed here, when daemons share a store (server/store/store_postgres_library.h) and its
# blobs are in a bucket (server/store/place_s3.c).
# nginx and systemd check the files of this folder; chromium is what the page's tests drive.
test="libcmocka-dev python3-venv clang-format clang libclang-rt-14-dev draco libmeshoptimizer2d git locales nginx-light openssl systemd chromium postgresql-15 pgbouncer"
# glmark2-data holds a scanned bunny (GPL-3+, no dependencies).
demo="curl ca-certificates python3 glmark2-data"
cluster="curl ca-certificates python3 postgresql-15"
bench="python3-venv wrk util-linux libcgal-dev libembree-dev libfcl-dev cloudcompare"

# npm fetches three.js for the page. Node from elsewhere brings its own npm and forbids Debian's.
command -v npm >/dev/null || build="$build nodejs npm"

case "${1:-build}" in
build) wanted="$build" ;;
test) wanted="$build $test" ;;
demo) wanted="$build $demo" ;;
cluster) wanted="$build $cluster" ;;
bench) wanted="$build $bench" ;;
*)
    echo "usage: install-packages.sh [build|test|demo|cluster|bench]" >&2
    exit 2
    ;;
esac

if ! command -v apt-get >/dev/null; then
    echo "install-packages.sh: there is no apt-get here; install by hand: $(echo $wanted)" >&2
    exit 1
fi

is_installed() {
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

missing=
for package in $wanted; do
    is_installed "$package" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

as_root=
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "install-packages.sh: run as root, or install by hand:$missing" >&2
        exit 1
    fi
    as_root=sudo
fi

log=$(mktemp)
trap 'rm -f "$log"' EXIT
# A failing apt-get speaks; a successful one does not.
quietly() {
    $as_root env DEBIAN_FRONTEND=noninteractive "$@" >"$log" 2>&1 && return
    cat "$log" >&2
    exit 1
}

echo "installing:$missing" >&2
quietly apt-get update -q
quietly apt-get install -q -y --no-install-recommends $missing
