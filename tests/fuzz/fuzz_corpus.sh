#!/bin/sh
# fuzz_corpus.sh DATA CORPUS: copies the small mesh files of DATA to CORPUS with the byte of their format in front.
set -eu
data=$1 corpus=$2
mkdir -p "$corpus"
number=0
for name in obj ply stl off glb drc xyz; do
    number=$((number + 1))
    find "$data" -name "*.$name" -size -20k | while read -r file; do
        { printf "\\00$number"; cat "$file"; } >"$corpus/$(basename "$file")"
    done
done
