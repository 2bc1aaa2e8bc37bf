"""A loaded kernel's function, called with addresses of NumPy arrays."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from nhpocp.arrays import Array


class Library:
    """Holds Python's lock while it works, so that its memory may be kept between calls."""

    def __init__(self, path: Path, name: str, kinds: str) -> None:
        """``kinds``: of the arguments of the function ``name``, "i" an integer and "p" an address.

        Errors: `OSError` or `AttributeError` where the file is no such kernel.
        """
        self.file = ctypes.PyDLL(str(path))
        self.call = self.file[name]
        self.call.restype = None
        self.call.argtypes = [ctypes.c_longlong if kind == "i" else ctypes.c_void_p for kind in kinds]
        self._room = np.zeros(0), 0

    def room(self, size: int) -> tuple[Array, int]:
        """Memory for so many numbers, and where it is; to be held, since another thread may ask for more meanwhile."""
        if self._room[0].size < size:
            more = np.zeros(size)
            self._room = more, address(more)
        return self._room


def address(array: Array) -> int:
    """Of a contiguous array that may be written to."""
    # array.ctypes takes three times as long
    return ctypes.addressof(ctypes.c_char.from_buffer(array)) if array.size else 0
