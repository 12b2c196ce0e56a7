#!/usr/bin/env python3
"""Counts how finely each folder's C code is cut: prints, never fails.

A function begins in the first column and its body between braces in the first column, as clang-format lays it out.
Columns: .c and .h files; lines; files a thousand lines; functions; their median and 90th percentile of lines, and the
longest; static functions that are named once beside their definition, in percent of all functions; assertions
(QM_ASSERT, QM_VALIDATE, assert and static assertions); extern functions whose first word after qm_ is, but for its
ending, in the name of neither the file nor its folder, in percent of the extern ones.

usage: tests/count_house.py [FOLDER ...]   (default: engine server clients/cli)
"""
import pathlib
import re
import statistics
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
HEAD = re.compile(r'^(?!typedef|struct|enum|union|#|/|\}|\{)(?P<static>static\s+)?(?P<type>[\w\s\*]+?)\b(?P<name>\w+)\(')
ASSERT = re.compile(r'\b(QM_ASSERT|QM_VALIDATE|_Static_assert|static_assert|assert)\s*\(')
COMMENT = re.compile(r'/\*.*?\*/', re.S)


class Function:
    def __init__(self, name, is_static, lines):
        self.name, self.is_static, self.lines = name, is_static, lines


def functions(text):
    """The functions that a file defines."""
    lines = text.split('\n')
    found, head = [], None
    begin = None
    for i, line in enumerate(lines):
        if begin is None:
            match = HEAD.match(line)
            if match and not line.rstrip().endswith(';'):
                head = match, i
            elif line == '{' and head:
                begin = i
            elif line.rstrip().endswith(';') or line == '':
                head = None
        elif line == '}':
            match, first = head
            is_static = 'static' in (match['static'] or '') or 'static' in match['type']
            found.append(Function(match['name'], is_static, i - first + 1))
            begin = head = None
    return found


class Count:
    def __init__(self):
        self.files = self.lines = self.asserts = self.once = self.extern = self.strangers = 0
        self.lengths = []

    def add(self, path):
        text = path.read_text()
        code = COMMENT.sub('', text)
        self.files += 1
        self.lines += text.count('\n')
        self.asserts += len(ASSERT.findall(code))
        names = set(re.split(r'\W|_', path.stem)) | set(path.parent.name.split('_'))
        for function in functions(text):
            self.lengths.append(function.lines)
            if function.is_static:
                self.once += len(re.findall(rf'\b{function.name}\b', code)) == 2
            elif function.name.startswith('qm_'):
                self.extern += 1
                first = function.name.split('_')[1]
                self.strangers += not any(len(n) > 1 and (first.startswith(n) or n.startswith(first)) for n in names)

    def merge(self, other):
        for key in ('files', 'lines', 'asserts', 'once', 'extern', 'strangers'):
            setattr(self, key, getattr(self, key) + getattr(other, key))
        self.lengths += other.lengths

    def row(self, name):
        lengths = sorted(self.lengths) or [0]
        ninth = lengths[min(len(lengths) - 1, 9 * len(lengths) // 10)]
        return (f'{name:28} {self.files:5} {self.lines:7} {1000 * self.files / max(1, self.lines):6.1f} {len(self.lengths):6} '
                f'{statistics.median(lengths):6.0f} {ninth:4} {lengths[-1]:5} {100 * self.once / max(1, len(self.lengths)):5.0f} % '
                f'{self.asserts:7} {100 * self.strangers / max(1, self.extern):5.0f} %')


def main():
    print(f'{"folder":28} {"files":>5} {"lines":>7} {"/1000":>6} {"funcs":>6} {"median":>6} {"p90":>4} {"max":>5} {"once":>7} '
          f'{"asserts":>7} {"prefix":>7}')
    for top in sys.argv[1:] or ['engine', 'server', 'clients/cli']:
        whole, parts = Count(), {}
        for path in sorted((ROOT / top).rglob('*.[ch]')):
            parts.setdefault(path.parent.relative_to(ROOT), Count()).add(path)
        for folder, count in parts.items():
            whole.merge(count)
            print(count.row(str(folder)))
        if len(parts) > 1:
            print(whole.row(f'{top}, all'))


if __name__ == '__main__':
    main()
