"""CRC-32C bit by bit, as it is defined."""

from __future__ import annotations


def crc32c_bitwise(data: bytes) -> int:
    """Divide the message by Castagnoli's polynomial, lowest bit first."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF
