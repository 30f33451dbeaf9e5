"""A Ray of two cores on this machine."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from tests.helpers.required import needed


@contextmanager
def one_ray() -> Iterator[None]:
    """Started once, whoever asks for one meanwhile uses it."""
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ray = needed("ray", "RAY")
        ray.init(
            address="local",
            num_cpus=2,
            include_dashboard=False,
            log_to_driver=False,
            object_store_memory=300 * 2**20,
        )
    try:
        yield
    finally:
        ray.shutdown()
