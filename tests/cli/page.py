"""Reads a report as a browser does: elements, their text, the pixels of its pictures. Whatever is not well-formed fails."""

import base64
import html.parser
import struct
import zlib

VOID = {"meta", "br", "img", "link", "input", "hr"}
EMPTY_SVG = {"rect", "circle", "path", "image"}
# Attributes that a browser would fetch, or run.
FETCHED = {"src", "href", "srcset", "data", "action", "poster", "background", "xlink:href", "formaction", "ping"}


class Element:
    def __init__(self, tag, attributes):
        self.tag, self.attributes, self.children, self.pieces = tag, dict(attributes), [], []

    def text(self):
        return "".join(piece if isinstance(piece, str) else piece.text() for piece in self.pieces)

    def all(self, tag):
        """All elements of that kind below this one, in their order."""
        found = []
        for child in self.children:
            if child.tag == tag:
                found.append(child)
            found += child.all(tag)
        return found


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.root = Element("document", [])
        self.stack = [self.root]
        self.declarations = []
        self.feed(text)
        self.close()
        assert len(self.stack) == 1, [element.tag for element in self.stack]
        assert self.declarations == ["DOCTYPE html"]

    def handle_decl(self, decl):
        self.declarations.append(decl)

    def unknown_decl(self, data):
        raise AssertionError(data)

    def handle_comment(self, data):
        raise AssertionError(data)

    def handle_pi(self, data):
        raise AssertionError(data)

    def add(self, tag, attributes):
        assert len({name for name, _ in attributes}) == len(attributes), attributes
        element = Element(tag, attributes)
        self.stack[-1].children.append(element)
        self.stack[-1].pieces.append(element)
        return element

    def handle_starttag(self, tag, attrs):
        element = self.add(tag, attrs)
        if tag not in VOID:
            self.stack.append(element)

    def handle_startendtag(self, tag, attrs):
        assert tag in EMPTY_SVG, tag
        self.add(tag, attrs)

    def handle_endtag(self, tag):
        assert self.stack[-1].tag == tag, f"</{tag}> ends <{self.stack[-1].tag}>"
        self.stack.pop()

    def handle_data(self, data):
        self.stack[-1].pieces.append(data)

    def elements(self):
        todo = [self.root]
        while todo:
            element = todo.pop()
            yield element
            todo += element.children

    def all(self, tag):
        return self.root.all(tag)

    def check(self):
        """What every report is: one page without scripts and requests, with a heading, tables with scopes, named pictures."""
        ids = [element.attributes["id"] for element in self.elements() if "id" in element.attributes]
        assert len(ids) == len(set(ids))
        for element in self.elements():
            assert element.tag not in {"script", "iframe", "object", "embed", "link", "base", "form", "foreignobject"}, element.tag
            for name, value in element.attributes.items():
                assert not name.startswith("on") and name != "style", (element.tag, name)
                if name in FETCHED:
                    assert element.tag == "image" and value.startswith("data:image/png;base64,"), (element.tag, name, value[:60])
                if name == "aria-labelledby":
                    assert value in ids
        style = "".join(element.text() for element in self.all("style"))
        assert "url(" not in style and "@import" not in style
        assert len(self.all("h1")) == 1 and len(self.all("title")[0].text()) > 0
        for cell in self.all("th"):
            assert cell.attributes.get("scope") in {"row", "col"}
        for picture in self.all("svg"):
            assert picture.attributes["role"] == "img" and len(picture.all("title")[0].text()) > 10
        for word in ("nan", "inf", "(null)"):
            assert word not in self.all("body")[0].text().lower().split(), word
        return self

    def figures(self):
        """The intervals of the table of all figures: label to those of A, of B and of both; None where there is none."""
        table = next(section for section in self.all("section") if section.attributes.get("aria-labelledby") == "figures")
        rows = {}
        for row in table.all("tbody")[0].all("tr"):
            rows[row.all("th")[0].text()] = [interval_of(cell) for cell in row.all("td")]
        return rows

    def verdict(self):
        return next(section for section in self.all("section") if "verdict" in section.attributes.get("class", ""))

    def section(self, label):
        return next(section for section in self.all("section") if section.attributes.get("aria-labelledby") == label)


def interval_of(cell):
    if "data-lower" not in cell.attributes:
        return None
    numbers = [cell.attributes["data-lower"], cell.attributes["data-upper"]]
    return tuple(float("nan") if number == "null" else float(number) for number in numbers)


def pixels_of(image):
    """The pixels of a picture with a palette: rows of colours, None where nothing is."""
    data = base64.b64decode(image.attributes["href"].split(",", 1)[1], validate=True)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed, palette = 8, b"", []
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + size]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0]
        at += 12 + size
        if kind == b"IHDR":
            width, height, depth, colours = struct.unpack(">IIBB", body[:10])
            assert (depth, colours) == (8, 3)
        elif kind == b"PLTE":
            palette = [tuple(body[i : i + 3]) for i in range(0, size, 3)]
        elif kind == b"tRNS":
            assert body == b"\0"
        elif kind == b"IDAT":
            packed += body
    rows, before, raw = [], bytes(width), zlib.decompress(packed)
    for y in range(height):
        line = bytearray(raw[y * (width + 1) : (y + 1) * (width + 1)])
        before = unfilter(line[0], line[1:], before)
        rows.append([palette[index] if index else None for index in before])
    return rows


def unfilter(kind, line, before):
    for x in range(len(line)):
        left, up, corner = (line[x - 1] if x else 0), before[x], (before[x - 1] if x else 0)
        if kind == 1:
            line[x] = (line[x] + left) & 255
        elif kind == 2:
            line[x] = (line[x] + up) & 255
        elif kind == 3:
            line[x] = (line[x] + (left + up) // 2) & 255
        elif kind == 4:
            guess = left + up - corner
            line[x] = (line[x] + min((left, up, corner), key=lambda value: abs(guess - value))) & 255
    return bytes(line)


def hues_of(rows):
    """The colours of a picture without their brightness, by how many pixels have them."""
    counts = {}
    for row in rows:
        for colour in row:
            if colour is None:
                continue
            greatest = max(max(colour), 1)
            hue = tuple(round(8 * part / greatest) for part in colour)
            counts[hue] = counts.get(hue, 0) + 1
    return counts
