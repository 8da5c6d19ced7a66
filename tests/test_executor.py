"""Work goes to this process, to several, or to a cluster; what a dead worker was at is done again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from pathlib import Path

import pytest

from garbi_map.errors import GarbiError
from garbi_map.executor import Serial, Workers, beside, open_workers


def double(number: int) -> int:
    """A job."""
    return 2 * number


def fatal_once(trace: Path, number: int) -> int:
    """A job whose worker dies the first time."""
    if number == 2 and not trace.exists():
        trace.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def refuse(number: int) -> int:
    """A job on bad input."""
    raise GarbiError(f"{number}: not usable")


def after(sign: Path, number: int) -> int:
    """A job of which the later ones wait for a sign."""
    while number > 0 and not sign.exists():
        time.sleep(0.01)
    return number


def test_a_result_is_there_while_others_are_still_made(tmp_path: Path) -> None:
    """The second is not done before the first was taken."""
    with (
        open_workers(2) as workers,
        closing(workers.results(after, [(tmp_path / "sign", k) for k in range(3)])) as found,
    ):
        assert next(found) == 0
        (tmp_path / "sign").touch()
        assert list(found) == [1, 2]


def test_what_nobody_waits_for_any_more_is_not_begun(tmp_path: Path) -> None:
    """One worker is at the second job when the results are given up; the third is never done."""
    begun: list[int] = []

    def job(number: int) -> int:
        begun.append(number)
        return after(tmp_path / "sign", number)

    workers = Workers(lambda: ThreadPoolExecutor(1))
    with closing(workers.results(job, [(0,), (1,), (2,)])) as found:
        assert next(found) == 0
    (tmp_path / "sign").touch()
    workers.close()
    assert 2 not in begun


def test_results_come_in_order_and_each_is_told() -> None:
    """In this process."""
    told: list[None] = []
    with open_workers(1) as workers:
        assert workers.run(double, [(k,) for k in range(5)], lambda: told.append(None)) == [0, 2, 4, 6, 8]
    assert len(told) == 5


def test_what_a_job_raises_is_raised_here() -> None:
    """Bad input stays one clear line, whoever read it."""
    with open_workers(1) as workers, pytest.raises(GarbiError, match="3: not usable"):
        workers.run(refuse, [(3,)])


def test_dead_process_is_replaced_and_its_work_done_again(tmp_path: Path) -> None:
    """kill -9 of a worker: every result is there."""
    with open_workers(2) as workers:
        assert workers.run(fatal_once, [(tmp_path / "died", k) for k in range(4)]) == [0, 2, 4, 6]
    assert (tmp_path / "died").exists()


def test_work_that_kills_every_worker_ends_in_one_line() -> None:
    """Not in an endless loop."""

    class Broken(Serial):
        def submit(self, fn: object, /, *args: object, **kwargs: object) -> Future:  # type: ignore[override]
            raise BrokenProcessPool("gone")

    with pytest.raises(GarbiError, match="workers died"):
        Workers(Broken).run(double, [(1,)])


def test_processes_end_with_the_one_that_started_them(tmp_path: Path) -> None:
    """kill -9 of the whole leaves no worker behind that would go on writing."""
    program = (
        "import os, time, signal\nfrom garbi_map.executor import open_workers\n"
        "if __name__ == '__main__':\n with open_workers(2) as w:\n"
        "  print(*w.run(os.getpid, [()]), flush=True); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    script = tmp_path / "program.py"
    script.write_text(program)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    ended = subprocess.run([sys.executable, script], stdout=subprocess.PIPE, text=True, check=False, env=environment)
    worker = int(ended.stdout)
    for _ in range(200):
        if not Path(f"/proc/{worker}").exists() or " Z " in Path(f"/proc/{worker}/stat").read_text():
            return
        time.sleep(0.05)
    pytest.fail("the worker is still there")


def test_dask_that_is_not_installed_or_does_not_answer_is_one_line() -> None:
    """What to install, or that nobody answers there."""
    with pytest.raises(GarbiError, match=r"garbi\[dask\]|no scheduler"), open_workers(1, "tcp://127.0.0.1:1"):
        pass


def test_dask_gives_the_same_results() -> None:
    """On a local cluster of one worker, where Dask is installed."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        open_workers(1, cluster.scheduler_address) as workers,
    ):
        assert workers.run(double, [(k,) for k in range(5)]) == [0, 2, 4, 6, 8]
        with pytest.raises(GarbiError, match="not usable"):
            workers.run(refuse, [(3,)])


def test_pool_of_processes_is_the_standard_one() -> None:
    """Anything with the interface of `concurrent.futures.Executor` can do the work."""
    with ProcessPoolExecutor(1) as pool:
        assert Workers(lambda: pool).run(double, [(4,)]) == [8]


def test_what_is_done_beside_stops_when_the_block_fails():
    """An interrupt does not wait for the end of a long job, and a block that ends well does."""
    steps: list[int] = []
    begun = threading.Event()

    def job(wanted: Callable[[], None], most: int) -> int:
        for step in range(most):
            wanted()
            steps.append(step)
            begun.set()
            time.sleep(0.001)
        return len(steps)

    with pytest.raises(KeyboardInterrupt), beside() as (thread, wanted):
        endless = thread.submit(job, wanted, 10**9)
        begun.wait()
        raise KeyboardInterrupt
    with pytest.raises(CancelledError):
        endless.result()
    steps.clear()
    with beside() as (thread, wanted):
        short = thread.submit(job, wanted, 20)
    assert short.result() == 20
