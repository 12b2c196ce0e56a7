#!/usr/bin/env python3
"""Stores what an independent program says of each real pair: brackets.json, which test_pairs.py holds ours against.

CGAL's bounded_error_Hausdorff_distance, quads read as the two triangles of their first diagonal, both directions. It
is built like the benchmark's peers; the file keeps its version and the SHA-256 of each mesh, so that a bracket of
another mesh is not taken for that of this one.

usage: tests/pairs/brackets.py
"""
import hashlib
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / 'bench'))
import child
import measuring
import programs

from test_pairs import BRACKETS, pairs

SHARE = 1e-6  # of the diagonal of the source: the width of a bracket


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main():
    peer = programs.OUT / 'peer_cgal'
    fault = programs.make(peer.relative_to(programs.ROOT), 'build/bench/bench_engine')
    if fault:
        sys.exit(f'brackets: {fault}')
    found, files = [], {}
    for a, b in pairs():
        for source, target in ((a, b), (b, a)):
            arrays, facts = measuring.export(source)
            tolerance = SHARE * facts['diagonal']
            answer = child.run([peer, 'hausdorff', arrays, measuring.export(target)[0], repr(tolerance)], 1, 600)
            if 'failed' in answer:
                sys.exit(f'brackets: {source} -> {target}: {answer["failed"]}')
            names = [f'{path.parent.name}/{path.name}' for path in (source, target)]
            found.append({'source': names[0], 'target': names[1], 'lower': answer['lower'], 'upper': answer['upper']})
            files |= {name: digest(path) for name, path in zip(names, (source, target))}
            print(*names, answer['lower'], answer['upper'], flush=True)
    version = child.run([peer, 'version'])['version']
    BRACKETS.write_text(json.dumps({'program': f'CGAL {version}', 'files': files, 'brackets': found}, indent=1) + '\n')


if __name__ == '__main__':
    main()
