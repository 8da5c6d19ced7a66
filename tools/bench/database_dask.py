"""Many dives on a local Dask cluster of two single-threaded workers, beside one thread; and with a worker killed."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from garbi_map.config import Config
from garbi_map.pipeline import build_map
from tools.bench.database_kills import LATER_NS, contents, cut

_SPAN = 7.0
"""s of the sample log, which passes over the same ground again and again."""


def dask(work: Path, count: int) -> dict[str, Any]:
    """Wall clock of both, and whether the maps are the same to the byte. Only a quiet machine tells a speed-up."""
    from distributed import LocalCluster

    count = count or 12
    config = Config()
    begins = [1.5 * k for k in range(count)]
    logs = [cut(work / f"dive{k:02d}.mcap", at, at + _SPAN, k * LATER_NS) for k, at in enumerate(begins)]
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as alone:
        serial = {cores: alone.submit(_serial, logs, work / f"serial{cores}", cores).result() for cores in (1, 2)}
    wanted = contents(work / "serial1")
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        build_map(logs[:2], work / "warm cluster", config, workers=1, dask=cluster.scheduler_address)
        begin = time.monotonic()
        build_map(logs, work / "cluster", config, workers=1, dask=cluster.scheduler_address)
        parallel = time.monotonic() - begin
        killing = threading.Timer(0.35 * parallel, _kill_one, [cluster])
        killing.start()
        build_map(logs, work / "killed", config, workers=1, dask=cluster.scheduler_address)
        killing.join()
    return {
        "dives": count,
        "serial_s": round(serial[1], 1),
        "serial_with_a_core_for_its_libraries_s": round(serial[2], 1),
        "two_workers_s": round(parallel, 1),
        "speed_up": round(serial[1] / parallel, 2),
        "load_of_the_machine": [round(load, 1) for load in os.getloadavg()],
        "same_map": contents(work / "cluster") == wanted == contents(work / "serial2"),
        "same_map_with_a_worker_killed": contents(work / "killed") == wanted,
    }


def _serial(logs: list[Path], out: Path, cores: int) -> float:
    """Seconds of the build without workers on one core, which is one thread, or on all."""
    every = os.sched_getaffinity(0)
    if cores == 1:
        os.sched_setaffinity(0, {min(every)})  # what threads come to be later are there, too
    build_map(logs[:1], out.with_name(f"warm{cores}"), Config(), workers=1)
    begin = time.monotonic()
    build_map(logs, out, Config(), workers=1)
    return time.monotonic() - begin


def _kill_one(cluster: Any) -> None:
    nanny = next(iter(cluster.workers.values()))
    os.kill(nanny.pid, signal.SIGKILL)
