#!/usr/bin/env python3
"""Writes what the command line answers about all real pairs, without times, so that two builds can be compared bit by bit.

Distances in all directions, both readings and both kinds of bounds, deviations, collisions and self-collisions, on one
thread, which makes a search take the same path each time. A result is a line: a key, a tab, the JSON.

usage: tests/pairs/results.py write QUADMESH FILE
       tests/pairs/results.py compare OLD NEW
Exit status: 0; 1 when results differ (each is printed); 2 usage.
"""
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys

from test_pairs import DATA, pairs

# What may differ between two runs of the same program.
TIMES = {'elapsed_ms', 'prepare_ms', 'parse_ms', 'bvh_ms', 'search_ms', 'timing', 'memory_bytes'}


def without_times(value):
    if isinstance(value, dict):
        return {name: without_times(member) for name, member in value.items() if name not in TIMES}
    if isinstance(value, list):
        return [without_times(member) for member in value]
    return value


def questions():
    """A key and the arguments of each."""
    for a, b in pairs():
        name = f'{a.parent.name}/{a.stem}-{b.stem}'
        for reading in ('triangles', 'bilinear'):
            both = [str(a), str(b), '--quads', reading, '--json', '--threads', '1']
            for direction in ('a_to_b', 'b_to_a', 'two_sided'):
                for bounds in ('cover', 'matching'):
                    # Matching is slow on large pairs; a part of the work shows as much.
                    if bounds == 'matching' and a.stat().st_size > 2_000_000:
                        continue
                    yield (f'{name} {reading} hausdorff {direction} {bounds}',
                           ['hausdorff', *both, '--direction', direction, '--bounds', bounds])
            yield f'{name} {reading} deviation', ['deviation', *both, '--pieces', '20000']
            yield f'{name} {reading} collide', ['collide', *both]


def answer(program, key, arguments):
    done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=1200)
    return f'{key}\t{json.dumps(without_times(json.loads(done.stdout)), sort_keys=True)}'


def write(program, out):
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as workers:
        lines = list(workers.map(lambda question: answer(program, *question), questions()))
    pathlib.Path(out).write_text('\n'.join(lines) + '\n')
    print(f'{len(lines)} results of {DATA}')


def compare(old, new):
    def read(path):
        return dict(line.split('\t', 1) for line in pathlib.Path(path).read_text().splitlines())

    before, after = read(old), read(new)
    differing = [key for key in sorted(before.keys() | after.keys()) if before.get(key) != after.get(key)]
    for key in differing:
        print(f'{key}\n  {before.get(key)}\n  {after.get(key)}')
    print(f'{len(before)} and {len(after)} results, {len(differing)} differ')
    return 1 if differing else 0


def main(arguments):
    if len(arguments) == 3 and arguments[0] == 'write':
        return write(arguments[1], arguments[2])
    if len(arguments) == 3 and arguments[0] == 'compare':
        return compare(arguments[1], arguments[2])
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
