#!/bin/sh
# Runs a command with an address in QM_TEST_POSTGRES that leads through PgBouncer, in transaction mode, to the server that was
# in it before: each transaction may have another session. QM_TEST_PROXY is 1 then, and leaves tests out that need the server's
# own sessions.
#
# usage: tests/with_postgres.sh tests/with_pgbouncer.sh COMMAND...
# Exit status: that of the command; 1 when there is no PgBouncer or it does not start.
set -u

[ -n "${QM_TEST_POSTGRES:-}" ] || { echo "with_pgbouncer.sh: QM_TEST_POSTGRES names no server" >&2; exit 1; }
program=$(PATH="$PATH:/usr/sbin" command -v pgbouncer) || {
    echo "with_pgbouncer.sh: there is no pgbouncer; docker/install-packages.sh test installs it" >&2
    exit 1
}
folder=$(mktemp -d)
bouncer=
finish() {
    [ -z "$bouncer" ] || { kill "$bouncer"; wait "$bouncer"; } 2>/dev/null
    rm -rf "$folder"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

host=${QM_TEST_POSTGRES#*@}
server=${host%%/*}
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
echo '"quadmeshd" ""' >"$folder/users"
# Sessions of databases that are gone are not kept.
cat >"$folder/settings" <<END
[databases]
* = host=${server%%:*} port=${server##*:}
[pgbouncer]
listen_addr = 127.0.0.1
listen_port = $port
unix_socket_dir =
auth_type = trust
auth_file = $folder/users
pool_mode = transaction
default_pool_size = 8
max_client_conn = 1000
server_idle_timeout = 5
END
as=
if [ "$(id -u)" -eq 0 ]; then
    chown -R postgres "$folder"
    as="setpriv --reuid=postgres --regid=postgres --init-groups"
fi
$as "$program" -q "$folder/settings" >"$folder/log" 2>&1 &
bouncer=$!
address="postgres://quadmeshd@127.0.0.1:$port/${host#*/}"
tries=100
until psql -X -q -c "SELECT 1" "$address" >/dev/null 2>&1; do
    tries=$((tries - 1))
    if [ "$tries" -eq 0 ] || ! kill -0 "$bouncer" 2>/dev/null; then
        cat "$folder/log" >&2
        exit 1
    fi
    sleep 0.1
done
QM_TEST_POSTGRES=$address
QM_TEST_PROXY=1
export QM_TEST_POSTGRES QM_TEST_PROXY
"$@"
