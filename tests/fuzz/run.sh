#!/bin/sh
# Runs every fuzz target of build/fuzz under ASan and UBSan, two at a time.
#
#   FUZZ_SECONDS  for each target (30)
#   FUZZ_ONLY     names of targets, with blanks: codec-obj, json, ... (all)
#   FUZZ_JOBS     targets at the same time (2)
#
# A target starts from tests/fuzz/corpus/NAME and tests/fuzz/regressions/NAME, and keeps what it finds on the way in
# build/fuzz/corpus/NAME. Inputs that fail are left in build/fuzz/findings, for the folder of regressions; each run prints
# its seed. Exit status: 0; 1 when a target failed.
set -eu
cd "$(dirname "$0")/../.."
seconds=${FUZZ_SECONDS:-30}
all="codec-obj codec-ply codec-stl codec-off codec-glb codec-drc codec-xyz codec-pcd codec-3mf codec-gzip json soup layout quads"

run_one() { # NAME
    name=$1
    program=$(pwd)/build/fuzz/fuzz_${name%%-*}
    found=build/fuzz/corpus/$name
    log=build/fuzz/$name.log
    mkdir -p "$found" build/fuzz/findings
    set -- "$found"
    for kept in "tests/fuzz/corpus/$name" "tests/fuzz/regressions/$name"; do
        if [ -d "$kept" ]; then set -- "$@" "$kept"; fi
    done
    if [ -f "tests/fuzz/$name.dict" ]; then set -- "-dict=tests/fuzz/$name.dict" "$@"; fi
    status=0
    FUZZ_FORMAT=${name#*-} "$program" -max_total_time="$seconds" -len_control=0 -max_len=4000 -timeout=60 \
        -rss_limit_mb=4096 -artifact_prefix="build/fuzz/findings/$name-" "$@" >"$log" 2>&1 || status=$?
    seed=$(sed -n 's/^INFO: Seed: //p' "$log")
    if [ "$status" -eq 0 ]; then
        echo "ok $name, seed $seed, $(sed -n 's/^Done \([0-9]* runs\).*/\1/p' "$log")"
    else
        echo "FAILED $name, seed $seed"
        grep -vE 'NEW|REDUCE|pulse|RELOAD' "$log" | tail -40
    fi
    return "$status"
}

if [ "${1:-}" = one ]; then
    run_one "$2"
else
    echo ${FUZZ_ONLY:-$all} | tr ' ' '\n' | xargs -P "${FUZZ_JOBS:-2}" -I NAME "$0" one NAME
fi
