#!/bin/sh
# Runs a command beside a PostgreSQL server of its own, whose address is in QM_TEST_POSTGRES: on loopback, in a temporary
# folder, as a user other than root, with the promises of a real one (fsync).
#
# usage: tests/with_postgres.sh COMMAND...
# Exit status: that of the command; 1 when there is no PostgreSQL or it does not start.
set -u

bin=$(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -V | tail -n 1)
[ -n "$bin" ] || { echo "with_postgres.sh: there is no PostgreSQL; docker/install-packages.sh test installs it" >&2; exit 1; }
folder=$(mktemp -d)
if [ "$(id -u)" -eq 0 ]; then
    chown postgres "$folder"
    pg() { setpriv --reuid=postgres --regid=postgres --init-groups "$@"; }
else
    pg() { "$@"; }
fi
finish() {
    pg "$bin/pg_ctl" -D "$folder/data" -m immediate -s stop 2>/dev/null
    rm -rf "$folder"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

pg "$bin/initdb" -D "$folder/data" -U quadmeshd -A trust --encoding UTF8 --locale C >"$folder/log" 2>&1 &&
    # As late as can be: until the server is up, another program may be given the port.
    port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])') &&
    pg "$bin/pg_ctl" -D "$folder/data" -l "$folder/data/log" -s -w \
        -o "-p $port -c listen_addresses=127.0.0.1 -c unix_socket_directories=$folder -c max_connections=300" start || {
    cat "$folder/log" >&2
    exit 1
}
export QM_TEST_POSTGRES="postgres://quadmeshd@127.0.0.1:$port/postgres"
# First: what Debian has in PATH is a script in Perl before each program, which takes several times its time.
export PATH="$bin:$PATH"
"$@"
