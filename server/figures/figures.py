#!/usr/bin/env python3
"""Draws the figures of server/ARCHITECTURE.md as SVG files beside this script.

usage: server/figures/figures.py
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / 'engine/figures'))
from drawing import Figure

STYLE = """
.thread { fill: #1f5fa8; fill-opacity: .14; stroke: #1f5fa8; stroke-width: 1 }
.stored { fill: #2e8b57; fill-opacity: .16; stroke: #2e8b57; stroke-width: 1 }
.lock { fill: #c0392b; fill-opacity: .12; stroke: #c0392b; stroke-width: 1 }
@media (prefers-color-scheme: dark) {
.thread { fill: #79b4ff; stroke: #79b4ff }
.lock { fill: #ff7b6b; stroke: #ff7b6b }
}
"""


class ServerFigure(Figure):
    """Its texts are small and centred."""

    def __init__(self, width, height):
        super().__init__(width, height, STYLE)

    def text(self, x, y, text, anchor='middle', kind='small'):
        super().text(x, y, text, anchor, kind)


def job():
    f = ServerFigure(720, 330)
    f.stage(20, 100, 130, 'submitted', 'POST /v1/jobs')
    f.stage(210, 100, 130, 'queued', 'row without document', 'stored')
    f.stage(420, 100, 130, 'running', 'events: bounds, step', 'thread')
    f.stage(600, 20, 110, 'succeeded', 'event: result', 'stored')
    f.stage(600, 100, 110, 'canceled', 'result or error', 'stored')
    f.stage(600, 180, 110, 'failed', 'event: error', 'stored')
    f.stage(420, 230, 130, 'interrupted', 'server_shutdown')
    f.stage(210, 230, 130, 'claimed', 'server_restart', 'stored')
    f.arrow((150, 123), (210, 123))
    f.text(180, 116, 'insert')
    f.arrow((340, 123), (420, 123))
    f.text(380, 116, 'a worker')
    f.arrow((550, 113), (600, 43))
    f.arrow((550, 123), (600, 123))
    f.arrow((550, 133), (600, 203))
    f.arrow((85, 100), (85, 43), (600, 43))
    f.text(250, 36, 'a finished job of the same key and revisions answers it (cached)')
    f.arrow((310, 100), (310, 72), (655, 72), (655, 100))
    f.text(440, 85, 'DELETE before it ran')
    f.arrow((485, 146), (485, 230))
    f.text(490, 190, 'the daemon stops,', 'start')
    f.text(490, 204, 'or is killed', 'start')
    f.arrow((420, 253), (340, 253))
    f.text(380, 246, 'next start')
    f.arrow((275, 230), (275, 146))
    f.text(280, 190, 'queued again,', 'start')
    f.text(280, 204, 'higher seq', 'start')
    f.text(20, 306, 'green: the store has it before any client hears of it; blue: on a worker thread', 'start')
    f.save('job')


def threads():
    f = ServerFigure(760, 410)
    f.text(20, 18, 'threads', 'start', '')
    f.stage(20, 28, 150, 'connections (2)', 'libmicrohttpd', 'thread')
    f.stage(20, 94, 150, 'short lane (4)', 'waits for the disk', 'thread')
    f.stage(20, 160, 150, 'other lanes (2 each)', 'query, edit, send, decode', 'thread')
    f.stage(20, 226, 150, 'workers', 'jobs, niceness 5', 'thread')
    f.stage(20, 292, 150, 'notifier (1)', 'resumes connections', 'thread')
    f.stage(20, 358, 150, 'main loop', 'signals, timer 50 ms', 'thread')
    f.text(300, 18, 'outer locks', 'start', '')
    f.stage(300, 94, 170, 'jobs.submitting', 'one submission at a time', 'lock')
    f.stage(300, 160, 170, 'meshes.store_lock', 'who changes mesh rows', 'lock')
    f.stage(300, 226, 170, 'jobs.saving', 'one save of events', 'lock')
    f.text(570, 18, 'inner locks', 'start', '')
    f.stage(570, 28, 170, 'guard.lock', 'connections', 'lock')
    f.stage(570, 94, 170, 'jobs.lock', 'states, events, waiting', 'lock')
    f.stage(570, 160, 170, 'meshes.lock', 'list, references', 'lock')
    f.stage(570, 226, 170, 'store.lock', 'the database connection', 'lock')
    f.stage(570, 292, 170, 'pool.lock', 'the queue of a pool', 'lock')
    f.stage(570, 358, 170, 'reconstructions.lock', 'list, who works on one', 'lock')
    f.arrow((170, 117), (300, 117))
    f.arrow((170, 125), (300, 175))
    f.arrow((170, 133), (300, 239))
    f.arrow((170, 183), (300, 183))
    f.arrow((170, 241), (300, 193))
    f.arrow((170, 381), (200, 381), (300, 132), kind='dash')
    f.arrow((170, 388), (215, 388), (300, 260), kind='dash')
    f.arrow((470, 112), (570, 112))
    f.arrow((470, 122), (570, 236))
    f.arrow((470, 174), (570, 124))
    f.arrow((470, 183), (570, 183))
    f.arrow((470, 192), (570, 243))
    f.arrow((470, 240), (570, 128))
    f.arrow((470, 252), (570, 252))
    f.arrow((740, 117), (752, 117), (752, 315), (740, 315))
    f.text(250, 372, 'dashed: when the daemon stops', 'start')
    f.text(250, 388, 'any thread may take an inner lock alone', 'start')
    f.save('threads')


if __name__ == '__main__':
    job()
    threads()
