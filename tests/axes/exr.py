"""Reads the channels of an OpenEXR image with the standard library alone.

Scan lines, uncompressed or ZIP, of one part or several, of 16- and 32-bit floats and 32-bit integers: more than
`pileus render` writes, less than the format allows. What is not read raises `Unreadable`.
"""
import struct
import zlib
from array import array
from itertools import accumulate

# Lines in a chunk by the number of the compression.
LINES = {0: 1, 2: 1, 3: 16}
# Numbers of pixel types, their size and the letter of `struct`.
PIXELS = {0: (4, "I"), 1: (2, "e"), 2: (4, "f")}


class Unreadable(Exception):
    """The file is no OpenEXR image, or of a kind that is not read here."""


def _text(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode("utf-8"), end + 1


def _header(data, at):
    """Attributes of one part (name to bytes), and where the next begins; None at the end of headers."""
    attributes = {}
    while data[at] != 0:
        name, at = _text(data, at)
        _, at = _text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def _channels(attribute):
    channels, at = [], 0
    while attribute[at] != 0:
        name, at = _text(attribute, at)
        kind, _, across, down = struct.unpack_from("<iiii", attribute, at)
        if kind not in PIXELS or (across, down) != (1, 1):
            raise Unreadable(f"channel {name}: pixels of type {kind}, one in {across} x {down}")
        channels.append((name, *PIXELS[kind]))
        at += 16
    return channels


def _unzipped(data, size):
    """Undoes OpenEXR's ZIP: differences of bytes, even and odd ones apart."""
    if len(data) == size:
        return data
    coded = zlib.decompress(data)
    coded = bytes(accumulate(coded, lambda sum, step: (sum + step - 128) & 255))
    half = (len(coded) + 1) // 2
    plain = bytearray(len(coded))
    plain[0::2], plain[1::2] = coded[:half], coded[half:]
    return bytes(plain)


def read(path):
    """Width, height and planes (full name of a channel to an array of doubles, row by row) of an image.

    A channel that has no layer in its name, in a part other than the first, is named `PART.CHANNEL`.
    """
    data = open(path, "rb").read()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630:
        raise Unreadable(f"{path}: not an OpenEXR image")
    several = bool(version & 0x1000)
    if version & 0xA00:
        raise Unreadable(f"{path}: tiles or deep pixels")
    parts, at = [], 8
    while True:
        attributes, at = _header(data, at)
        parts.append(attributes)
        if not several:
            break
        if data[at] == 0:
            at += 1
            break
    layouts = []
    for number, attributes in enumerate(parts):
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
        compression = attributes["compression"][0]
        if compression not in LINES:
            raise Unreadable(f"{path}: compression {compression}")
        width, height, lines = right - left + 1, bottom - top + 1, LINES[compression]
        prefix = ""
        if number > 0 and "name" in attributes:
            prefix = attributes["name"].rstrip(b"\0").decode("utf-8") + "."
        layouts.append((width, height, top, lines, _channels(attributes["channels"]), prefix))
        if layouts[0][:2] != (width, height):
            raise Unreadable(f"{path}: parts of different sizes")
    chunks = [-(-height // lines) for _, height, _, lines, _, _ in layouts]
    offsets = struct.unpack_from(f"<{sum(chunks)}Q", data, at)
    width, height = layouts[0][:2]
    planes, first = {}, 0
    for layout, count in zip(layouts, chunks):
        _, _, top, lines, channels, prefix = layout
        names = [name if "." in name else prefix + name for name, _, _ in channels]
        for name in names:
            planes[name] = array("d", bytes(8 * width * height))
        for place in offsets[first:first + count]:
            place += 4 if several else 0
            line, size = struct.unpack_from("<ii", data, place)
            rows = min(lines, height - (line - top))
            whole = rows * width * sum(size for _, size, _ in channels)
            pixels = _unzipped(data[place + 8:place + 8 + size], whole)
            at = 0
            for row in range(line - top, line - top + rows):
                for name, (_, size, letter) in zip(names, channels):
                    values = struct.unpack_from(f"<{width}{letter}", pixels, at)
                    planes[name][row * width:(row + 1) * width] = array("d", values)
                    at += width * size
        first += count
    return width, height, planes


def read_render(image):
    """An image of `pileus render` as `read` gives it, with the layers of the file beside it."""
    width, height, planes = read(image)
    beside = image.with_suffix(".layers.exr")
    if beside.exists():
        planes = {**read(beside)[2], **planes}
    return width, height, planes
