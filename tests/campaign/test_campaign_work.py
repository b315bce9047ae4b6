"""What a worker does about itself."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource
import numpy as np
from sagnac.campaign.work import keep_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100):
        np.ones(250_000)  # 2 MB, 488 pages
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

plain = faults()
keep_memory()
faults()
print(plain, faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library cannot be told to keep memory")
def test_the_memory_of_a_run_is_kept_for_the_next():
    """Below dask, whose nanny has arrays given back at once, each array would be new pages, all of them cleared."""
    environment = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"}
    done = subprocess.run([sys.executable, "-c", FAULTS], env=environment, capture_output=True, text=True, check=True)
    plain, kept = map(int, done.stdout.split())
    assert plain > 100 * 400
    assert kept < 100
