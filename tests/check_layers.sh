#!/bin/sh
# Proves the walls between the layers, by compiling and by reading the include lines:
#   - every header and file of engine/ compiles with the engine's own include paths;
#   - the engine's archive links with the C library and libm alone;
#   - engine/ includes only its own headers and those of the C library;
#   - each outside library is seen by its own files of server/ only.
#
# usage: tests/check_layers.sh ENGINE_ARCHIVE [FOLDER]   (FOLDER: the source tree, default this one)
# Exit status: 0 when all walls stand; 1 with a line for each hole; 2 usage.
set -eu

[ $# -ge 1 ] || {
    echo "usage: check_layers.sh ENGINE_ARCHIVE [FOLDER]" >&2
    exit 2
}
archive=$(realpath "$1")
cd "${2:-$(dirname "$0")/..}"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
touch "$scratch/holes"

hole() {
    echo "check-layers: $1" >&2
    echo "$1" >>"$scratch/holes"
}

# compile NAME FILE FLAG...: the file alone, with the engine's include paths and no others.
compile() {
    name=$1 file=$2
    shift 2
    ${CC:-gcc} -std=c17 -D_POSIX_C_SOURCE=200809L -Wall -Wextra -Werror -Iengine/include -Iengine/src \
        -DQM_ISA=portable -Wno-psabi "$@" -fsyntax-only "$file" ||
        hole "$name does not compile with the engine's own headers"
}

# A header is read through a file that includes nothing else: each must bring what it needs.
for header in $(find engine -name '*.h' | sort); do
    printf '#include "%s"\n' "$(realpath "$header")" >"$scratch/alone.c"
    compile "$header" "$scratch/alone.c" -Wno-unused-function
done
# The kernels are compiled once for each instruction set; the portable one shows what they include.
for file in $(find engine -name '*.c' | sort); do
    compile "$file" "$file"
done

cat >"$scratch/program.c" <<'PROGRAM'
#include "qm/context.h"

int main(void)
{
    qm_context ctx = qm_context_make();
    return ctx.cancel != 0;
}
PROGRAM
${CC:-gcc} ${LDFLAGS:-} -std=c17 -Iengine/include "$scratch/program.c" \
    -Wl,--whole-archive "$archive" -Wl,--no-whole-archive -lm -o "$scratch/program" || hole "the engine does not link with libm alone"

# includes FILE...: "FILE:HEADER" for each include line.
includes() {
    grep -HoE '^[[:space:]]*#[[:space:]]*include[[:space:]]*[<"][^>"]+[>"]' "$@" |
        sed -E 's/:[[:space:]]*#[[:space:]]*include[[:space:]]*/:/; s/[<>"]//g' || true
}

c_library="assert ctype errno fenv float inttypes limits locale math setjmp signal stdalign stdarg stdatomic
    stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time immintrin"
includes $(find engine -name '*.[ch]') >"$scratch/engine"
while IFS=: read -r file header; do
    base=${header##*/}
    case " $(echo $c_library) " in *" ${header%.h} "*) continue ;; esac
    [ -n "$(find engine -name "$base" -print -quit)" ] || hole "$file includes $header, which is not the engine's"
done <"$scratch/engine"

# Every other layer, with the file suffixes that may see a library of their own.
includes $(find server clients tests -name '*.[ch]' -o -name '*.cc') >"$scratch/others"

# only HEADER_PATTERN FILE_PATTERN: no file but these may include such a header.
only() {
    cat "$scratch/engine" "$scratch/others" | grep -E ":$1" | grep -vE "^($2):" >"$scratch/found" || true
    while IFS=: read -r file header; do
        hole "$file includes $header, which belongs to ${2#server/}"
    done <"$scratch/found"
}
only 'microhttpd\.h' 'server/http/http[a-z_]*\.[ch]'
only '(cjson/)?cJSON\.h' 'server/[a-z]*/(json(_[a-z_]*)?|gltf|kind_[a-z_]*)\.c'
only 'sqlite3\.h' 'server/store/store_[a-z_]*\.[ch]'
only 'postgresql/libpq-fe\.h' 'server/store/store_postgres[a-z_]*\.[ch]'
only 'curl/' '(server/store/place_s3|clients/cli/session)\.c'
only 'spng\.h' 'server/report/png\.c'
only 'zlib\.h' 'server/format/gzip\.c'
only 'zip\.h' 'server/format/archive\.c'
only 'expat\.h' 'server/format/codec_3mf\.c'
only 'draco/' 'server/format/codec_draco\.cc'

[ ! -s "$scratch/holes" ] || exit 1
echo "check-layers: the walls stand"
