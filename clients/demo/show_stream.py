#!/usr/bin/env python3
"""Prints a stream of events (one JSON object a line on standard input) as a table that fills while they come.

With RAW=1 in the environment the lines themselves, cut to the width of the terminal.
"""
import json
import os
import shutil
import sys

COLUMNS = {
    'bounds': (('ms', 'elapsed_ms', '{:10.1f}'), ('lower', 'lower', '{:20.12g}'), ('upper', 'upper', '{:20.12g}')),
    'step': (('step', 'step', '{:10d}'), ('quads', 'quads', '{:10d}'), ('ms', 'step_ms', '{:10.1f}')),
}


def show_raw(line, width):
    print(line if len(line) <= width else line[:width - 1] + '…', flush=True)


class Table:
    def __init__(self):
        self.kind = None

    def show(self, event):
        kind = event.get('event')
        if kind == 'result' and 'lower' in (event.get('result') or {}):
            kind, event = 'bounds', event['result']
        if kind not in COLUMNS:
            return
        columns = [column for column in COLUMNS[kind] if isinstance(event.get(column[1]), (int, float))]
        if kind != self.kind:
            print('   ', *(title.rjust(len(form.format(0))) for title, _, form in columns))
            self.kind = kind
        print('   ', *(form.format(event[name]) for _, name, form in columns), flush=True)


def main():
    width = shutil.get_terminal_size().columns
    table = Table()
    for line in sys.stdin:
        line = line.rstrip('\n')
        if os.environ.get('RAW', '0') not in ('', '0'):
            show_raw(line, width)
            continue
        try:
            table.show(json.loads(line))
        except json.JSONDecodeError:
            print(line, flush=True)


if __name__ == '__main__':
    main()
