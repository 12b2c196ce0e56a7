#!/usr/bin/env python3
"""Proves what the folders of engine/, server/ and clients/cli/ promise, by reading the code:

  - a folder includes headers of the folders that it may use, and of no others (ROOMS);
  - a name is defined in one header: types, functions and macros that begin with qm_ or QM_;
  - the first word after qm_ of a function that other files call is a word of its file's or its folder's name,
    but for its ending (job, jobs; encode, encoder);
  - files that comments name, and files that documents link to, exist.

usage: tests/check_rooms.py [FOLDER]   (the source tree, default this one)
Exit status: 0 when all holds; 1 with a line for each fault.
"""
import collections
import pathlib
import re
import sys

# Folder: the folders whose headers it may include, beside its own and engine/include.
ROOMS = {
    'engine/src/core': '',
    'engine/src/prim': 'core',
    'engine/src/bvh': 'core prim',
    'engine/src/mesh': 'core prim bvh',
    'engine/src/hausdorff': 'core prim bvh',
    'engine/src/deviation': 'core prim bvh hausdorff',
    'engine/src/collide': 'core prim bvh',
    'engine/src/align': 'core',
    'engine/src/matrix': 'core',
    'engine/src/layout': 'core prim bvh mesh',
    'engine/src/quads': 'core bvh mesh',
    'engine/src/tmesh': 'core bvh mesh layout quads',
    'engine/src/cloud': 'core bvh layout',
    'engine/src/reconstruct': 'core bvh mesh layout cloud tmesh',
    'server/base': '',
    'server/format': 'base',
    'server/ops': 'base format',
    'server/report': 'base ops',
    'server/store': 'base ops',
    'server/mesh': 'base format ops store',
    'server/layout': 'base format ops store mesh',
    'server/job': 'base ops store mesh layout',
    'server/http': 'base format ops report store mesh layout job',
    'server': 'base format ops report store mesh layout job http',
    'clients/cli': 'base format ops report',
}
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.M)
DEFINITION = re.compile(r'^(?!static\b|typedef\b)[a-z_][\w ]*[ *](qm_\w+)\([^;{}]*\)\s*\{', re.M)
COMMENT = re.compile(r'/\*.*?\*/|//[^\n]*', re.S)
NAMED_FILE = re.compile(r'\b([a-z][a-z0-9_]*(?:/[a-z0-9_]+)*\.(?:c|h|cc|py|sh|js))\b')


def fault(faults, path, what):
    faults.append(f'{path}: {what}')


def room_of(path):
    """The folder of the table that a file lies in."""
    for parent in path.parents:
        if str(parent) in ROOMS:
            return str(parent)
    return None


def check_edges(files, faults):
    for path, text in files.items():
        room = room_of(path)
        if room is None:
            continue
        top = {'engine': 'engine/src', 'server': 'server', 'clients': 'server'}[path.parts[0]]
        for header in INCLUDE.findall(text):
            if header.startswith('qm/') or '/' not in header:
                continue
            used = header.split('/')[0]
            if f'{top}/{used}' == room or (path.parts[0] != 'engine' and f'server/{used}' == room):
                continue
            if used not in ROOMS[room].split():
                fault(faults, path, f'includes {header}, and {room} may use {ROOMS[room] or "no other folder"} only')


def check_definitions(files, faults):
    where = collections.defaultdict(set)
    for path, text in files.items():
        if path.suffix != '.h':
            continue
        code = COMMENT.sub('', text)
        names = re.findall(r'^#define\s+(QM_\w+)', code, re.M)
        names += re.findall(r'^\}\s*(qm_\w+);', code, re.M)
        names += re.findall(r'^typedef\s[^;{]*?\(?\*?(qm_\w+)\)?\s*(?:\([^;]*\))?;', code, re.M)
        for name in set(names):
            where[name].add(path)
    for name, paths in sorted(where.items()):
        if len(paths) > 1 and name not in ('QM_KERNEL', 'QM_ISA'):
            fault(faults, sorted(paths)[0], f'defines {name}, and so does ' + ', '.join(str(p) for p in sorted(paths)[1:]))


def check_prefixes(files, faults):
    for path, text in files.items():
        if path.suffix not in ('.c', '.cc') or room_of(path) is None:
            continue
        words = set(path.stem.split('_')) | set(path.parent.name.split('_'))
        for name in DEFINITION.findall(COMMENT.sub('', text)):
            first = name.split('_')[1]
            if not any(len(word) > 1 and (first.startswith(word) or word.startswith(first)) for word in words):
                fault(faults, path, f'defines {name}, whose first word is in the name of neither the file nor the folder')


def check_named_files(root, files, faults):
    known = {p.name for top in ('engine', 'server', 'clients', 'tests', 'proto', 'docker') for p in (root / top).rglob('*.*')}
    for path, text in files.items():
        for comment in COMMENT.findall(text):
            for name in NAMED_FILE.findall(comment):
                if name.split('/')[-1] not in known and not name.startswith(('sys/', 'linux/')):
                    fault(faults, path, f'a comment names {name}, which does not exist')


def check_links(root, faults):
    for document in sorted(root.glob('*.md')) + sorted(p for top in ('engine', 'server') for p in (root / top).glob('*.md')) + [
            root / 'clients/README.md', root / 'tests/README.md']:
        for link in re.findall(r'\]\(([^)#]+)(?:#[^)]*)?\)', document.read_text()):
            if not link.startswith('http') and not (document.parent / link).exists():
                fault(faults, document.relative_to(root), f'links to {link}, which does not exist')


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent)
    files = {}
    for top in ('engine', 'server', 'clients/cli'):
        for path in sorted((root / top).rglob('*')):
            if path.suffix in ('.c', '.h', '.cc', '.inc'):
                files[path.relative_to(root)] = path.read_text()
    faults = []
    check_edges(files, faults)
    check_definitions(files, faults)
    check_prefixes(files, faults)
    check_named_files(root, files, faults)
    check_links(root, faults)
    for line in faults:
        print(f'check-rooms: {line}', file=sys.stderr)
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
