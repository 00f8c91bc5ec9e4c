"""How the C library keeps memory between updates."""

import ctypes
import sys


def keep_freed_memory() -> None:
    """Tell glibc to keep activations' memory between updates: giving pages back and taking them
    again costs a fifth of an update.
    """
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        trim_threshold, mmap_threshold = -1, -3
        libc.mallopt(mmap_threshold, 32 << 20)
        libc.mallopt(trim_threshold, 1 << 30)
