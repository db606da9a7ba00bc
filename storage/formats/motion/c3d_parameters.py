"""The header and the parameter section of a C3D file, read without trusting a byte of them.

After "The C3D File Format" (Motion Lab Systems, 2008). The libraries that read C3D trust these
sections: `ezc3d` ends the whole process on about one in a hundred files with a few damaged
bytes, so no byte reaches memory here before it has been compared with the file's length.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError

BLOCK = 512
PROCESSORS = {84: "Intel", 85: "DEC", 86: "MIPS"}
"""The byte that says how numbers are written."""

_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}


@dataclass(frozen=True)
class Parameter:
    """One entry of the parameter section."""

    kind: int
    """-1 letters, 1 bytes, 2 integers, 4 floats."""
    shape: tuple[int, ...]
    """The fastest index first, as the file has it."""
    content: bytes
    """The bytes of its values."""


@dataclass(frozen=True)
class C3DHead:
    """All that stands before the data of a C3D file."""

    processor: int
    """84 Intel, 85 DEC, 86 MIPS."""
    header: bytes
    """The first block."""
    parameters: dict[str, Parameter]
    """By "GROUP:NAME", in capitals."""

    def word(self, number: int) -> int:
        """Return one 16-bit word of the header, counted from 1."""
        return struct.unpack_from(self._order + "H", self.header, 2 * number - 2)[0]

    def float_at(self, number: int) -> float:
        """Return the float of the header that begins at this word, counted from 1."""
        return float(floats(self.header[2 * number - 2 : 2 * number + 2], self.processor)[0])

    def integers(self, name: str) -> list[int]:
        """Return a parameter's values as unsigned integers; none where it is absent."""
        entry = self.parameters.get(name)
        if entry is None or entry.kind < 0:
            return []
        if entry.kind == 4:
            values = floats(entry.content, self.processor)
            return [int(value) for value in values if np.isfinite(value) and value >= 0]
        dtype = "u1" if entry.kind == 1 else self._order + "u2"
        return np.frombuffer(entry.content, dtype).tolist()

    def floats(self, name: str) -> list[float]:
        """Return a parameter's values as floats; none where it is absent."""
        entry = self.parameters.get(name)
        if entry is None or entry.kind != 4:
            return [float(value) for value in self.integers(name)]
        return floats(entry.content, self.processor).tolist()

    def words(self, name: str) -> list[bytes]:
        """Return a parameter's strings, stripped; none where it is absent.

        A parameter that became too long for one goes on in NAME2, NAME3, ...
        """
        found: list[bytes] = []
        for suffix in ("", *range(2, 1000)):
            entry = self.parameters.get(f"{name}{suffix}")
            if entry is None:
                break
            found += _words(entry)
        return found

    @property
    def _order(self) -> str:
        return ">" if self.processor == 86 else "<"


def floats(content: bytes, processor: int) -> NDArray[np.float64]:
    """Return the 4-byte floats of a file as its processor wrote them.

    Parameters
    ----------
    content : bytes
        A multiple of four bytes.
    processor : int
        84 and 86 wrote IEEE numbers, 85 the F format of the VAX, whose two 16-bit words are
        swapped and whose reserved operand becomes NaN.

    Returns
    -------
    (value,) float64
    """
    with np.errstate(all="ignore"):  # a damaged float may be a signaling NaN
        if processor != 85:
            return np.frombuffer(content, ">f4" if processor == 86 else "<f4").astype(float)
        halves = np.frombuffer(content, "<u2").astype(np.uint32)
        bits = (halves[0::2] << 16) | halves[1::2]
        exponent = ((bits >> 23) & 0xFF).astype(np.int32)
        fraction = ((bits & 0x7FFFFF) | 0x800000).astype(float)
        size = np.where(exponent > 0, np.ldexp(fraction, exponent - 152), 0.0)
        negative = bits >> 31 == 1
        return np.where(negative, np.where(exponent > 0, -size, np.nan), size)


def read_head(path: Path, data: bytes) -> C3DHead:
    """Return what stands before the data of a C3D file.

    Raises
    ------
    InputError
        These bytes are no C3D file, or its parameter section is damaged.
    """
    if len(data) < 2 * BLOCK or data[1] != 0x50:
        raise InputError(
            f"{path} is not a C3D file (its second byte is not 50 hex, or it ends within the "
            "header); bring a C3D file"
        )
    start = (data[0] - 1) * BLOCK
    if start < BLOCK or start + 4 > len(data):
        raise InputError(
            f"{path} says that its parameters are in block {data[0]}, where there is none in "
            f"its {len(data):,} bytes; export it again"
        )
    processor = data[start + 3]
    if processor not in PROCESSORS:
        raise InputError(
            f"{path} says that processor {processor} wrote it, where 84 (Intel), 85 (DEC) or "
            "86 (MIPS) is wanted; its parameter section is damaged, export it again"
        )
    return C3DHead(processor, data[:BLOCK], _entries(path, data, start + 4, processor))


def _entries(path: Path, data: bytes, at: int, processor: int) -> dict[str, Parameter]:
    """Return the parameters by group and name, following each record's pointer to the next."""
    order = ">H" if processor == 86 else "<H"
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Parameter | str]] = []
    last = False
    while not last and at + 2 <= len(data):
        length, group = struct.unpack_from("bb", data, at)
        length = abs(length)  # a negative length locks the name
        if length == 0 or group == 0:
            break
        pointer = at + 2 + length
        name = data[at + 2 : pointer]
        if pointer + 2 > len(data) or not _plain(name):
            raise _damaged(path, f"the name at byte {at + 2} is no name")
        step = struct.unpack_from(order, data, pointer)[0]
        last = step == 0
        key = name.decode("latin-1").strip().upper()
        if group < 0:
            groups[-group] = key
        else:
            found.append((group, key, _entry(data, pointer, step)))
        at = pointer + max(step, 2)
    named: dict[str, Parameter] = {}
    for group, key, entry in found:
        full = f"{groups.get(group, '')}:{key}"
        if isinstance(entry, Parameter):
            named.setdefault(full, entry)
        elif full.startswith(("POINT:", "TRIAL:")):  # damage elsewhere is no concern of ours
            raise _damaged(path, f"{full} {entry}")
    if "POINT:LABELS" not in named and "POINT:USED" not in named:
        raise _damaged(path, "it has no group POINT")
    return named


def _entry(data: bytes, pointer: int, step: int) -> Parameter | str:
    """Return the parameter whose pointer to the next one stands here, or what is wrong."""
    if pointer + 4 > len(data):
        return "reaches beyond the file"
    kind, dimensions = struct.unpack_from("bB", data, pointer + 2)
    begin = pointer + 4 + dimensions
    shape = tuple(data[pointer + 4 : begin])
    if kind not in _SIZES or dimensions > 7 or len(shape) != dimensions:
        return "is of no known kind"
    size = _SIZES[kind]
    for extent in shape:
        size *= extent
    # The description after the values may be missing, but the next record may not begin in them.
    if begin + size > (pointer + step if step else len(data)):
        return "is longer than its place"
    return Parameter(kind, shape, data[begin : begin + size])


def _words(entry: Parameter) -> list[bytes]:
    """Return the strings of one parameter."""
    if entry.kind != -1 or not entry.content:
        return []
    width = entry.shape[0] if len(entry.shape) > 1 else len(entry.content)
    content = entry.content
    return [content[at : at + width].strip(b" \0") for at in range(0, len(content), width)]


def _plain(name: bytes) -> bool:
    """Tell whether these can be the letters of a name."""
    return bool(name.strip()) and all(letter >= 32 and letter != 127 for letter in name)


def _damaged(path: Path, what: str) -> InputError:
    """Return the error of a parameter section that cannot be right."""
    return InputError(f"{path} has a damaged parameter section: {what}; export it again")
