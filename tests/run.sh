#!/bin/sh
# Everything that `make test` runs, from a bare Debian 12 on: installs what is missing, builds, checks, counts.
#
#   1. clang-format, the borders between the folders, and whether the measurements still load what they share with tests
#   2. unit tests under ASan and UBSan
#   3. random cases against certified references, for a minute; `make prove` takes a quarter of an hour
#   4. API and command-line tests against a real daemon under ASan and UBSan, those of the store with a shared one, too,
#      and with blobs in a folder; several daemons on one database, and the pairs of the data folder, in release
#   5. the types of the JavaScript client and the page; both against a real daemon, the page in Chromium
#   6. the unit tests that take long, optimized, with assertions and UBSan (config=check): in the background from 4 on
#   7. the fuzzers, half a minute each (FUZZ_SECONDS), as many at a time as there are processors
#
# Cases that need the folder of collected meshes (QM_TEST_DATA, or ../shared/data) are counted as not run where it is
# missing, and as failed with QM_REQUIRE_DATA=1.
#
# Exit status: 0 when everything passed. The last line counts: "N passed, N failed, N not run".
set -u
cd "$(dirname "$0")/.."

sh docker/install-packages.sh test || exit 1
# What is about a shared store has a PostgreSQL of its own.
[ -n "${QM_TEST_POSTGRES:-}" ] || exec sh tests/with_postgres.sh sh tests/run.sh
jobs=$(nproc)

# The sandbox forbids what sanitizers do, and they put their own memory in place of large pages.
released="test_sandbox test_large_pages"
# These search for long: ASan would make minutes of it. What takes longest is first, as several run at a time.
slow="test_noise test_cloud test_quad_layout test_unturn test_reconstruct test_bilinear_match
    test_hausdorff_adversarial test_align test_hausdorff_property test_layout_features test_hausdorff_parts
    test_comparison_sides test_deviation_piece test_walls
    test_bilinear_over test_hausdorff_overlay test_comparison test_deviation test_hausdorff test_hausdorff_invariance
    test_bilinear_pair test_quads test_collide test_deviation_loss test_deviation_regions
    test_deviation_sides test_distance test_extent test_fill_grids test_locator test_pairs test_project test_rigour
    test_wide"
sanitized=
for source in tests/unit/test_*.c; do
    name=$(basename "$source" .c)
    case " $(echo $slow $released) " in *" $name "*) ;; *) sanitized="$sanitized $name" ;; esac
done
programs() { # FOLDER NAMES
    for name in $2; do echo "$1/tests/$name"; done
}
make -j"$jobs" all $(programs build "$released") build/prove/prove >build-release.log 2>&1 ||
    { cat build-release.log; exit 1; }
make -j"$jobs" config=asan all $(programs build/asan "$sanitized") >build-asan.log 2>&1 ||
    { cat build-asan.log; exit 1; }
rm -f build-release.log build-asan.log

passed=0
failed=0
not_run=0
count() { # NAME STATUS
    if [ "$2" -eq 0 ]; then passed=$((passed + 1)); else
        failed=$((failed + 1))
        echo "FAILED: $1"
    fi
}

check() { # NAME COMMAND...
    name=$1
    shift
    echo "== $name"
    "$@"
    count "$name" $?
}

format_check() {
    git ls-files '*.c' '*.h' '*.cc' | xargs clang-format --dry-run -Werror
}

check "format" format_check
check "layers" make -s check-layers
check "measurements load" sh -c 'python3 tests/bench/run.py --help >/dev/null'

# cmocka prints a line for each test; only what failed and the sums are shown.
outputs=$(mktemp -d)
output=$outputs/output
through= # a command that runs the tests
row=     # the process that runs programs in the background
trap '[ -z "$row" ] || kill "$row" 2>/dev/null; rm -rf "$outputs"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
run_one='name=$(basename "$2"); $3 "$2" >"$1/$name" 2>&1; echo $? >"$1/$name.status"'
unit() { # PROGRAMS..., as many at a time as there are processors
    printf '%s\n' "$@" | xargs -P "$jobs" -I{} sh -c "$run_one" unit "$outputs" {} "$through"
    tally_all "$@"
}
tally_all() { # PROGRAMS...
    for program in "$@"; do
        echo "== $program${through:+ by $through}"
        tally "$outputs/$(basename "$program")"
    done
}
tally() { # FILE, beside which the exit status is
    status=$(cat "$1.status")
    good=$(grep -c '^\[       OK ' "$1")
    # A program may run several groups. No test skips itself: one that does has failed.
    bad=$(awk '/^\[  (FAILED|SKIPPED) *\] [0-9]+ test/ { sum += $(NF - 3) } END { print sum + 0 }' "$1")
    if [ "$status" -ne 0 ] && [ "$bad" -eq 0 ]; then bad=1; fi
    if [ "$bad" -ne 0 ]; then cat "$1"; fi
    passed=$((passed + good))
    failed=$((failed + bad))
    grep '^NOT RUN ' "$1"
    not_run=$((not_run + $(sed -n 's/^NOT RUN \([0-9]*\).*/\1/p' "$1" | awk '{ sum += $1 } END { print sum + 0 }')))
}

# All in one row: no processor waits for the last of a part.
unit $(programs build/asan "$sanitized") $(programs build "$released")

echo "== prove"
make -s prove PROVE_SECONDS=60 PROVE_JOBS="$jobs" >"$output" 2>&1
status=$?
cat "$output"
good=$(grep -c '^ok [a-z]*/.* tries' "$output")
bad=$(grep -c '^FAILED [a-z]*/.* tries' "$output")
if [ "$status" -ne 0 ] && [ "$bad" -eq 0 ]; then bad=1; fi
passed=$((passed + good))
failed=$((failed + bad))

# What only computes takes the time that the tests from here on leave, which often wait: the builds of the long searches and of
# the fuzzers, and the searches in one row. No search uses what only the daemon has (SERVER_ARCHIVE), which is not built for them.
# timeout ends all of its group when this script ends before them.
searches=$(programs build/check "$slow")
export jobs outputs run_one searches
timeout 1d nice -n 19 sh -c '
    make -j"$jobs" config=check SERVER_ARCHIVE= $searches >"$outputs/build" 2>&1 &&
    make -s -j"$jobs" config=fuzz fuzz-programs >"$outputs/build" 2>&1 || exit 1
    printf "%s\n" $searches | xargs -P "$jobs" -I{} sh -c "$run_one" unit "$outputs" {} ""' &
row=$!

[ -x build/venv/bin/pytest ] || python3 -m venv build/venv
build/venv/bin/pip install --quiet --disable-pip-version-check -r tests/cluster/requirements.txt || exit 1
api() { # BUILD FOLDER_OR_FILES
    echo "== $2${QM_TEST_STORE:+ and others, on a store of the kind $QM_TEST_STORE}${through:+ by $through}"
    build=$1
    shift
    QM_BUILD=$build $through build/venv/bin/pytest -q -p no:cacheprovider "$@" --junitxml "$output.xml"
    status=$?
    sums=$(sed -n 's/.*<testsuite [^>]*errors="\([0-9]*\)" failures="\([0-9]*\)" skipped="\([0-9]*\)" tests="\([0-9]*\)".*/\1 \2 \3 \4/p' "$output.xml")
    rm -f "$output.xml"
    set -- ${sums:-1 0 0 1}
    bad=$(($1 + $2 + $3)) # no test skips itself
    if [ "$status" -ne 0 ] && [ "$bad" -eq 0 ]; then bad=1; fi
    passed=$((passed + $4 - bad))
    failed=$((failed + bad))
}
api build/asan tests/api -n "$jobs"
# Once more what depends on the store most, on a shared one.
export QM_TEST_STORE=shared
api build/asan $(cat tests/api/shared_store.txt) -n "$jobs"
# And with the bytes of meshes and results in a folder.
export QM_TEST_STORE=folder
api build/asan $(for name in meshes content deform readers reconstructions; do echo "tests/api/test_$name.py"; done) -n "$jobs"
unset QM_TEST_STORE
# Through PgBouncer, which gives each transaction another session.
through=tests/with_pgbouncer.sh
unit $(programs build/asan "test_store_contract test_store_nodes test_store_copies test_store_places")
api build/asan tests/api/test_moving.py tests/api/test_two_nodes.py -n "$jobs" --dist loadfile
through=
api build/asan tests/cli -n "$jobs"
api build/asan tests/pressure
# Several daemons, which mostly wait: three of these tests at a time.
api build tests/cluster -n 3
# In a build that has points of failure by name.
api build/asan tests/cluster/test_points.py -n 3
data=${QM_TEST_DATA:-../shared/data}
if [ -d "$data/pairs" ]; then api build tests/pairs -n "$jobs"; else
    missing=$(cat tests/pairs/test_*.py tests/api/test_collection.py tests/api/test_plans.py | grep -c '^def test_')
    echo "NOT RUN $missing: there is no $data/pairs"
    not_run=$((not_run + missing))
    if [ "${QM_REQUIRE_DATA:-0}" != 0 ]; then failed=$((failed + missing)); fi
fi

make -s npm || exit 1
check "types" make -s check-types
# Each test file has its own daemon and, for the page, its own browser: as many at a time as there are processors, and the
# largest file first, which takes longest.
ls -S tests/browser/*.test.js | QM_BUILD=build/asan xargs -P "$jobs" -I{} sh -c \
    'name=$(basename "$1"); node --test --test-reporter=tap "$1" >"$outputs/$name" 2>&1; echo $? >"$outputs/$name.status"' page {}
for file in tests/browser/*.test.js; do
    echo "== $file"
    told=$outputs/$(basename "$file")
    status=$(cat "$told.status")
    good=$(sed -n 's/^# pass //p' "$told")
    bad=$(awk '/^# (fail|cancelled|skipped|todo) / { sum += $3 } END { print sum + 0 }' "$told")
    if [ "$status" -ne 0 ] && [ "$bad" -eq 0 ]; then bad=1; fi
    if [ "$bad" -ne 0 ]; then cat "$told"; fi
    passed=$((passed + ${good:-0}))
    failed=$((failed + bad))
done

wait "$row" || { cat "$outputs/build"; exit 1; }
row=
tally_all $searches

echo "== fuzzers"
FUZZ_JOBS=$jobs tests/fuzz/run.sh >"$output" 2>&1
cat "$output"
passed=$((passed + $(grep -c '^ok ' "$output")))
failed=$((failed + $(grep -c '^FAILED ' "$output")))

echo "$passed passed, $failed failed, $not_run not run"
[ "$failed" -eq 0 ]
