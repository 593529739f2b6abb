"""One Mach-O file of two libraries, read as Apple's mach-o/fat.h says."""

from __future__ import annotations

import struct

from emcas_fmu.runtime.compiler import universal

PAGE = 1 << 14  # of Apple's processors


def library(cpu: int, subtype: int, size: int) -> bytes:
    """Return the beginning of a 64-bit Mach-O library, padded."""
    return struct.pack("<3I", 0xFEEDFACF, cpu, subtype).ljust(size, bytes([cpu & 0xFF]))


def test_each_library_is_whole_at_a_page() -> None:
    parts = [library(0x01000007, 3, 100), library(0x0100000C, 0, PAGE + 1)]
    made = universal(parts)
    assert struct.unpack_from(">2I", made) == (0xCAFEBABE, 2)
    offsets = []
    for k, (part, machine) in enumerate(zip(parts, [(0x01000007, 3), (0x0100000C, 0)])):
        cpu, subtype, offset, size, align = struct.unpack_from(">5I", made, 8 + 20 * k)
        assert (cpu, subtype) == machine
        assert (size, 1 << align) == (len(part), PAGE)
        assert made[offset:offset + size] == part
        offsets.append(offset)
    assert offsets == [PAGE, 2 * PAGE]
    assert len(made) == 3 * PAGE + 1
    assert not any(made[8 + 40:PAGE])
