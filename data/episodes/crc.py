"""The CRC-32 of two pieces behind one another from those of the pieces.

A message lies in a chunk with a checksum and in a data section with one. Reading all
bytes for both would take a quarter of the time it takes to log them.
"""

from __future__ import annotations

from functools import lru_cache

_POLYNOMIAL = 0xEDB88320
"""CRC-32 as in zip, bits reversed."""

Matrix = tuple[int, ...]
"""32 columns of bits over GF(2): what happens to each bit of a checksum."""


def combined(first: int, second: int, second_size: int) -> int:
    """CRC-32 of a piece with the checksum `first` and one of `second_size` bytes."""
    return _times(_zeros_behind(second_size), first) ^ second


@lru_cache(maxsize=256)
def _zeros_behind(size: int) -> Matrix:
    """What `size` bytes of zeros behind a piece do to its checksum."""
    if size == 0:
        return tuple(1 << bit for bit in range(32))
    half = _zeros_behind(size // 2)
    double = _product(half, half)
    return _product(_one_byte(), double) if size % 2 else double


@lru_cache(maxsize=1)
def _one_byte() -> Matrix:
    """One bit shifts the checksum, and folds back what falls out; eight times."""
    bit = (_POLYNOMIAL, *(1 << place for place in range(31)))
    two = _product(bit, bit)
    four = _product(two, two)
    return _product(four, four)


def _product(left: Matrix, right: Matrix) -> Matrix:
    return tuple(_times(left, column) for column in right)


def _times(matrix: Matrix, vector: int) -> int:
    found = 0
    for column in matrix:
        if vector & 1:
            found ^= column
        vector >>= 1
    return found
