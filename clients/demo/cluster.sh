#!/bin/sh
# The demo of several daemons: from a bare Debian 12 to a stream of bounds that outlives the daemon which computes them.
#
# Installs what is missing (PostgreSQL from Debian's packages), builds, starts a primary, a synchronous standby and three
# daemons that share them, all on loopback and in a temporary folder. It uploads two meshes at the first daemon, streams
# the bounds of their distance from the second, kills the daemon that computes them with SIGKILL, and shows how
# the stream goes on to its proven end. It stops everything in the end.
#
# Exit status: 0 when every step worked and the bounds hold, else 1.
set -eu
cd "$(dirname "$0")/../.."

docker/install-packages.sh cluster
if ! make -s -j"$(nproc)" all; then
    echo "demo: the build failed" >&2
    exit 1
fi
bin=$(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -V | tail -n 1)
[ -n "$bin" ] || { echo "demo: there is no PostgreSQL" >&2; exit 1; }

folder=$(mktemp -d)
daemons=
fail() {
    echo "demo: $1" >&2
    exit 1
}

# PostgreSQL does not run as root.
if [ "$(id -u)" -eq 0 ]; then
    chown postgres "$folder"
    pg() { setpriv --reuid=postgres --regid=postgres --init-groups "$@"; }
else
    pg() { "$@"; }
fi

finish() {
    status=$?
    trap - EXIT INT TERM
    for daemon in $daemons; do kill -TERM "$daemon" 2>/dev/null || true; done
    for daemon in $daemons; do wait "$daemon" 2>/dev/null || true; done
    for server in standby primary; do
        [ ! -d "$folder/$server" ] || pg "$bin/pg_ctl" -D "$folder/$server" -m immediate -s stop || true
    done
    [ "$status" -eq 0 ] || tail -n 5 "$folder"/n*.log "$folder"/*.pg.log >&2 2>/dev/null || true
    rm -rf "$folder"
    [ "$status" -ne 0 ] || echo "stopped"
    exit "$status"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

free_port() {
    python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'
}

# serve NAME PORT: starts the PostgreSQL of a folder.
serve() {
    pg "$bin/pg_ctl" -D "$folder/$1" -l "$folder/$1.pg.log" -s -w -o \
        "-p $2 -c listen_addresses=127.0.0.1 -c unix_socket_directories=$folder" start || fail "PostgreSQL does not start"
}

echo "1. PostgreSQL: a primary, and a standby that has every commit before it is answered"
primary=$(free_port)
standby=$(free_port)
pg "$bin/initdb" -D "$folder/primary" -U quadmeshd -A trust --encoding UTF8 --locale C >"$folder/initdb.log" 2>&1 ||
    fail "initdb failed"
serve primary "$primary"
pg "$bin/createdb" -h 127.0.0.1 -p "$primary" -U quadmeshd quadmeshd
pg "$bin/pg_basebackup" -h 127.0.0.1 -p "$primary" -U quadmeshd -D "$folder/standby" -R -X stream \
    -d "host=127.0.0.1 port=$primary user=quadmeshd application_name=standby" || fail "there is no copy for the standby"
serve standby "$standby"
pg "$bin/psql" -q -h 127.0.0.1 -p "$primary" -U quadmeshd quadmeshd \
    -c "ALTER SYSTEM SET synchronous_standby_names = 'ANY 1 (standby)'" -c "SELECT pg_reload_conf()" >"$folder/psql.log"
store=postgres://quadmeshd@127.0.0.1:$primary/quadmeshd

# member NAME: a member of the JSON object on standard input.
member() {
    python3 -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"
}

echo
echo "2. Three daemons: quadmeshd --store $store"
for name in n1 n2 n3; do
    build/quadmeshd --store "$store" --node-name "$name" --port 0 --port-file "$folder/$name.port" \
        --data-dir "$folder/$name" >"$folder/$name.log" 2>&1 &
    daemons="$daemons $!"
    eval "pid_$name=$!"
done
for name in n1 n2 n3; do
    for _ in $(seq 100); do
        [ -s "$folder/$name.port" ] && curl -sf -o "$folder/ready" "http://127.0.0.1:$(cat "$folder/$name.port")/readyz" && break
        sleep 0.1
    done
    [ -s "$folder/$name.port" ] || fail "the daemon $name does not start"
    eval "url_$name=http://127.0.0.1:$(cat "$folder/$name.port")"
done
sleep 2.5 # a beat of each, so that each knows the others
curl -sS "$url_n1/v1/info" | python3 -c 'import json, sys; print("  ", json.load(sys.stdin)["cluster"])'

echo
echo "3. Two spheres of 319200 curved quads, uploaded at n1; their distance, streamed from n2"
python3 clients/demo/models.py sphere 0 "$folder/a.off" 8
python3 clients/demo/models.py sphere 0.0039269908169872414 "$folder/b.off" 8
a=$(curl -sS --fail-with-body --data-binary "@$folder/a.off" "$url_n1/v1/meshes?name=a.off" | member id)
b=$(curl -sS --fail-with-body --data-binary "@$folder/b.off" "$url_n1/v1/meshes?name=b.off" | member id)
request="{\"type\":\"hausdorff\",\"a\":\"$a\",\"b\":\"$b\",\"quads\":\"bilinear\",\"gap\":1e-7}"
job=$(curl -sS --fail-with-body "$url_n1/v1/jobs" -d "$request" | member id)
clients/demo/follow_job.py "$url_n2" "$url_n3" "$job" >"$folder/stream" &
reader=$!

# The daemon that computes has a running job; the reader's must not be it, or its stream ends with it, which it survives, too.
victim=
for _ in $(seq 100); do
    for name in n1 n2 n3; do
        eval "url=\$url_$name"
        if curl -s "$url/metrics" 2>/dev/null | grep -q '^quadmeshd_jobs_running 1$'; then victim=$name; fi
    done
    [ -z "$victim" ] || [ "$(wc -l <"$folder/stream")" -lt 3 ] || break
    sleep 0.1
done
[ -n "$victim" ] || fail "no daemon computes"
tail -n 1 "$folder/stream"
eval "pid=\$pid_$victim"
echo "   kill -9 $victim, which computes; the others take it for dead after 10 s of silence"
kill -9 "$pid"
if ! wait "$reader"; then fail "the stream did not come to its end: $(tail -n 2 "$folder/stream")"; fi
grep -E 'another|again' "$folder/stream" | head -n 3
tail -n 1 "$folder/stream"
echo
echo "The stream has come to its proven end: no bound moved the wrong way, and the last ones are as close as was asked."
