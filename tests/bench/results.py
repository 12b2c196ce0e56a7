"""RESULTS.md: what the benchmark printed last, a section for each part, with the machine and the commit."""
import pathlib
import re

RESULTS = pathlib.Path(__file__).with_name("RESULTS.md")
HEAD = """# What `make bench` printed

Each section is what the last whole run of a part printed, and names the machine and the commit that it ran on.
`make bench` writes this file; a run of a few pairs or with other settings does not.
"""


def read():
    """The sections by name."""
    if not RESULTS.exists():
        return {}
    found = re.split(r"^<!-- (\w+) -->\n", RESULTS.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(found[1::2], found[2::2]))


def write(name, machine, tables, order):
    """Puts a section in place of the one of that name."""
    sections = read() | {name: f"{machine.strip()}\n\n{tables.strip()}\n\n"}
    names = [key for key in order if key in sections] + [key for key in sections if key not in order]
    RESULTS.write_text(HEAD + "".join(f"\n<!-- {key} -->\n{sections[key].rstrip()}\n" for key in names), encoding="utf-8")
