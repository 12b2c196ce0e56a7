#!/bin/sh
# The demo: from a bare Debian 12 to two Hausdorff distances with proven bounds, and to a quad mesh made of points.
#
# Installs what is missing, builds, starts the daemon on a free loopback port with a temporary data folder,
# uploads two pairs of meshes, streams the bounds of each with curl, and checks them. Then it uploads points and a
# layout of curves, streams how they become a quad mesh, measures that mesh against the points, and leaves it and a
# picture of it in build/. It stops the daemon in the end.
# With KEEP=1 the daemon stays until Ctrl-C, for a look at its page; with RAW=1 the streams are shown as they are, cut to
# the terminal's width.
#
# Exit status: 0 when every step worked and the bounds hold, else 1.
set -eu
cd "$(dirname "$0")/../.."

docker/install-packages.sh demo
if ! make -s -j"$(nproc)" all; then
    echo "demo: the build failed" >&2
    exit 1
fi

folder=$(mktemp -d)
daemon=
finish() {
    status=$?
    trap - EXIT INT TERM
    if [ -n "$daemon" ]; then
        kill -TERM "$daemon" 2>/dev/null || true
        if ! wait "$daemon"; then
            echo "demo: the daemon did not stop cleanly; its log:" >&2
            cat "$folder/log" >&2
            status=1
        fi
    fi
    rm -rf "$folder"
    [ "$status" -ne 0 ] || echo "stopped"
    exit "$status"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

fail() {
    echo "demo: $1" >&2
    exit 1
}

build/quadmeshd --port 0 --port-file "$folder/port" --data-dir "$folder/data" >"$folder/log" 2>&1 &
daemon=$!
url=
for _ in $(seq 100); do
    if [ -s "$folder/port" ]; then
        url=http://127.0.0.1:$(cat "$folder/port")
        curl -sf -o "$folder/ready" "$url/readyz" && break
    fi
    if ! kill -0 "$daemon" 2>/dev/null; then
        cat "$folder/log" >&2
        fail "the daemon did not start"
    fi
    sleep 0.1
done
[ -s "$folder/ready" ] || fail "the daemon was not ready within ten seconds"
echo "the daemon listens on $url/"

# member NAME: a member of the JSON object on standard input.
member() {
    python3 -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"
}

# upload FILE NAME: sends a file, tells what it is, and leaves the mesh's id in $mesh.
upload() {
    curl -sS --fail-with-body --data-binary "@$1" "$url/v1/meshes?name=$2" >"$folder/mesh.json" || {
        cat "$folder/mesh.json" >&2
        fail "the upload of $2 failed"
    }
    mesh=$(member id <"$folder/mesh.json")
    echo "  $2: $(member kind <"$folder/mesh.json"), $(member vertices <"$folder/mesh.json") vertices, id $mesh"
}

# measure A B: streams the bounds as they come; the events stay in $folder/stream.
measure() {
    request="{\"type\":\"hausdorff\",\"a\":\"$1\",\"b\":\"$2\"}"
    echo "  curl -N -H 'Accept: application/x-ndjson' $url/v1/jobs -d '$request'"
    {
        status=0
        curl -sS --fail-with-body -N -H 'Accept: application/x-ndjson' "$url/v1/jobs" -d "$request" || status=$?
        echo "$status" >"$folder/status"
    } | tee "$folder/stream" | python3 clients/demo/show_stream.py
    [ "$(cat "$folder/status")" -eq 0 ] || fail "the stream broke off"
}

echo
echo "1. Two spheres of quads, one turned by pi/100: the distance is 1 - cos(pi/100)"
python3 clients/demo/models.py sphere 0 "$folder/sphere_a.off"
python3 clients/demo/models.py sphere "$(python3 -c 'import math; print(math.pi / 100)')" "$folder/sphere_b.off"
upload "$folder/sphere_a.off" sphere_a.off
a=$mesh
upload "$folder/sphere_b.off" sphere_b.off
b=$mesh
measure "$a" "$b"
python3 clients/demo/check_stream.py --distance "1 - cos(pi/100)" <"$folder/stream"

echo
echo "2. A scanned bunny and a coarser mesh of it"
scan=/usr/share/glmark2/models/bunny.obj
python3 clients/demo/models.py coarsen "$scan" "$folder/coarse.obj" 40
upload "$scan" bunny.obj
a=$mesh
upload "$folder/coarse.obj" bunny_coarse.obj
b=$mesh
measure "$a" "$b"
python3 clients/demo/check_stream.py <"$folder/stream"

echo
echo "3. 40000 points of a ring and a layout of curves over them, to a quad mesh"
python3 clients/demo/models.py ring 40000 "$folder/ring.xyz" "$folder/ring.json"
upload "$folder/ring.xyz" ring.xyz
a=$mesh
sed "s/^{/{\"mesh\":\"$a\",/" "$folder/ring.json" >"$folder/request.json"
curl -sS --fail-with-body -d "@$folder/request.json" "$url/v1/layouts" >"$folder/layout.json" ||
    fail "the layout was refused: $(cat "$folder/layout.json")"
patches=$(python3 -c 'import json, sys; print(len(json.load(sys.stdin)["patches"]))' <"$folder/layout.json")
echo "  the layout: $patches patches found"
layout=$(member id <"$folder/layout.json")
curl -sS --fail-with-body -d "{\"layout\":\"$layout\"}" "$url/v1/reconstructions" >"$folder/made.json" ||
    fail "the reconstruction was refused: $(cat "$folder/made.json")"
made=$(member id <"$folder/made.json")
request="{\"type\":\"reconstruction_step\",\"reconstruction\":\"$made\",\"until\":{\"max_quads\":6000}}"
echo "  curl -N -H 'Accept: application/x-ndjson' $url/v1/jobs -d '$request'"
curl -sS --fail-with-body -N -H 'Accept: application/x-ndjson' "$url/v1/jobs" -d "$request" | tee "$folder/steps" |
    python3 clients/demo/show_stream.py
tail -n 1 "$folder/steps" | grep -q '"state":"succeeded"' || fail "the reconstruction broke off"
b=$(curl -sS "$url/v1/reconstructions/$made" | member mesh)
curl -sSL -o build/demo-ring.obj "$url/v1/reconstructions/$made/mesh?format=obj"
echo "  how far the points are from the mesh, and the mesh from the points:"
measure "$a" "$b"
python3 clients/demo/check_stream.py <"$folder/stream"
build/quadmesh reconstruct "$folder/ring.xyz" "$folder/ring.json" -o "$folder/ring.obj" --quads 6000 --no-measure \
    --picture build/demo-ring.png >"$folder/words" || fail "the command line does not make the same mesh"
grep '^[vf] ' build/demo-ring.obj >"$folder/one"
grep '^[vf] ' "$folder/ring.obj" | cmp -s "$folder/one" - || fail "the command line makes another mesh"

echo
curl -sSf -o "$folder/page" "$url/" || fail "the dashboard does not answer"
echo "the quad mesh: build/demo-ring.obj, its picture: build/demo-ring.png"
echo "the dashboard: $url/, the description of the API: $url/docs"
if [ "${KEEP:-0}" = 1 ]; then
    echo "the daemon stays until Ctrl-C"
    trap 'exit 0' INT
    wait "$daemon"
else
    echo "(make demo KEEP=1 leaves it running until Ctrl-C)"
fi
