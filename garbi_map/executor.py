"""Who does the work: this process, several, or a Dask cluster, all behind `concurrent.futures.Executor`.

Jobs are functions of paths and settings that write files of their own and return little, so that a job whose worker died
is simply done again.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context, parent_process
from typing import Any, TypeVar

from garbi_map.errors import GarbiError

T = TypeVar("T")

_ATTEMPTS = 4
"""At a job whose worker dies: one that kills every worker is itself the fault."""


class Serial(Executor):
    """Does a job when it is submitted, here."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def beside() -> Iterator[tuple[Executor, Callable[[], None]]]:
    """A thread for what can be done beside the block, and what a job there should call from time to time: it raises
    CancelledError once the block has failed, which would otherwise wait for the job's end, an interrupt too."""
    failed = threading.Event()

    def still_wanted() -> None:
        if failed.is_set():
            raise CancelledError

    with ThreadPoolExecutor(1) as thread:
        try:
            yield thread, still_wanted
        except BaseException:
            failed.set()
            raise


class Workers:
    """An executor that is made anew when a worker's death has broken it."""

    def __init__(self, make: Callable[[], Executor]) -> None:
        self._make = make
        self._executor: Executor | None = None

    def run(
        self, job: Callable[..., T], of: Sequence[tuple[Any, ...]], done: Callable[[], None] = lambda: None
    ) -> list[T]:
        """All that `results` gives; `done` is called for each."""
        found = []
        for result in self.results(job, of):
            found.append(result)
            done()
        return found

    def results(self, job: Callable[..., T], of: Sequence[tuple[Any, ...]]) -> Generator[T, None, None]:
        """job(*arguments) of each, in order, each as soon as it is there. What a job raises is raised here.

        Raises GarbiError where the workers of the same job die again and again.
        """
        ready: dict[int, T] = {}
        given = 0
        for _ in range(_ATTEMPTS):
            futures: dict[int, Future[T]] = {}
            try:
                if self._executor is None:
                    self._executor = self._make()
                for k in range(given, len(of)):
                    if k not in ready:
                        futures[k] = self._executor.submit(job, *of[k])
                while given < len(of):
                    if given not in ready:
                        ready[given] = futures[given].result()
                    given += 1
                    yield ready.pop(given - 1)
                return
            except Exception as error:
                if not _died(error):
                    raise
                ready |= {k: future.result() for k, future in futures.items() if k >= given and _ended_well(future)}
                self.close()
            finally:
                for future in futures.values():
                    future.cancel()
        raise GarbiError(
            f"workers died {_ATTEMPTS} times at the same work, perhaps for want of memory; try fewer workers"
        )

    def close(self) -> None:
        """Let the workers go, when they have ended what they have begun."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None


@contextmanager
def open_workers(processes: int, dask: str | None = None) -> Iterator[Workers]:
    """So many processes of this machine, 1 being this one, or the workers of the Dask scheduler at an address.

    Raises GarbiError where Dask is not installed or does not answer.
    """
    if dask is not None:
        with _dask(dask) as workers:
            yield workers
        return
    spawned = partial(ProcessPoolExecutor, processes, get_context("spawn"), _end_with_parent)
    workers = Workers(Serial if processes <= 1 else spawned)
    try:
        yield workers
    finally:
        workers.close()


@contextmanager
def _dask(address: str) -> Iterator[Workers]:
    try:
        from distributed import Client
    except ImportError as error:
        raise GarbiError("--dask needs the extra: pip install 'garbi[dask]'") from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise GarbiError(f"--dask {address}: no scheduler answers there") from error
    with client:
        workers = Workers(lambda: client.get_executor(pure=False))
        try:
            yield workers
        finally:
            workers.close()


def _end_with_parent() -> None:
    """A process whose parent was killed would wait for work for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _ended_well(future: Future[Any]) -> bool:
    return future.done() and not future.cancelled() and future.exception() is None


def _died(error: Exception) -> bool:
    """Whether it is the worker that failed, not the job."""
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ in (
        "KilledWorker",
        "CommClosedError",
    )
