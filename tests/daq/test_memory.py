"""What is freed goes back to the system, whatever was freed before."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# A block of 20 MB that is freed makes glibc keep later ones of up to that size; small ones lie between these.
CHURN = """
import ctypes, sys
if sys.argv[1] == "flat":
    from daq.memory import keep_flat
    assert keep_flat()
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_size_t], [ctypes.c_void_p]
def take(n):
    block = libc.malloc(n)
    ctypes.memset(block, 1, n)
    return block
libc.free(take(20 << 20))
large, small = [], []
for _ in range(200):
    large.append(take(200 << 10))
    small.append(take(1 << 10))
for block in large:
    libc.free(block)
for line in open("/proc/self/status"):
    if line.startswith("RssAnon"):
        print(int(line.split()[1]) // 1024)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have other allocators")
def test_large_blocks_go_back_also_where_small_ones_lie_between_them() -> None:
    # As by default, whatever was said to the allocator before: Dask's workers change it, through the environment.
    plain = {k: v for k, v in os.environ.items() if not k.startswith("MALLOC_")}

    def left_mib(how: str) -> int:
        command = [sys.executable, "-c", CHURN, how]
        said = subprocess.run(command, capture_output=True, text=True, check=True, env=plain)  # noqa: S603
        return int(said.stdout)

    # 40 MB were taken and freed.
    assert left_mib("flat") < left_mib("as it is") - 20
