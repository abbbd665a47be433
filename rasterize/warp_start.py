"""Start of Warp without its line about the driver on machines that have no GPU."""

import os
import sys
from functools import cache
from tempfile import TemporaryFile

import warp as wp

from rasterize.cache_folder import temporary_cache

NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"


@cache
def start_warp() -> None:
    """Initialize Warp once for this process.

    Its native part writes to the file descriptor of standard error whatever its log level is; its output is
    passed on without the line about a missing CUDA driver, which is normal on most machines.
    """
    wp.config.log_level = wp.LOG_WARNING
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with TemporaryFile() as heard:
            os.dup2(heard.fileno(), 2)
            try:
                _init()
            finally:
                os.dup2(kept, 2)
            heard.seek(0)
            for line in heard:
                if NO_DRIVER not in line:
                    os.write(2, line)
    finally:
        os.close(kept)


def _init() -> None:
    """Initialize Warp, with a temporary cache of its kernels where the user's cannot be written."""
    try:
        wp.init()
    except OSError:
        wp.config.kernel_cache_dir = str(temporary_cache("warp-cache"))
        wp.init()
