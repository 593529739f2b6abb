"""A universal Mach-O file contains two libraries, in the format of Apple's mach-o/fat.h."""

from __future__ import annotations

import struct

from emcas_fmu.runtime.compiler import universal

PAGE = 1 << 14  # bytes, on Apple's processors


def library(cpu: int, subtype: int, size: int) -> bytes:
    """Return the beginning of a 64-bit Mach-O library, padded."""
    return struct.pack("<3I", 0xFEEDFACF, cpu, subtype).ljust(size, bytes([cpu & 0xFF]))


def test_each_library_is_complete_and_begins_at_a_page() -> None:
    parts = [library(0x01000007, 3, 100), library(0x0100000C, 0, PAGE + 1)]
    file = universal(parts)
    assert struct.unpack_from(">2I", file) == (0xCAFEBABE, 2)
    offsets = []
    for k, (part, machine) in enumerate(zip(parts, [(0x01000007, 3), (0x0100000C, 0)])):
        cpu, subtype, offset, size, align = struct.unpack_from(">5I", file, 8 + 20 * k)
        assert (cpu, subtype) == machine
        assert (size, 1 << align) == (len(part), PAGE)
        assert file[offset:offset + size] == part
        offsets.append(offset)
    assert offsets == [PAGE, 2 * PAGE]
    assert len(file) == 3 * PAGE + 1
    assert not any(file[8 + 40:PAGE])
