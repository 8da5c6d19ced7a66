"""kill -9 at random moments of a build of two dives, then the same command again: does it end in the same map?"""

from __future__ import annotations

import os
import shutil
from multiprocessing import get_context
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.config import Config
from garbi_map.keys import digest_of
from garbi_map.log import LogWriter, open_log
from garbi_map.log.decode import stamp_of
from garbi_map.pipeline import build_map

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
SPANS = ((0.0, 5.5), (10.0, 15.5))
"""s of the sample log, which passes over the same ground again and again."""
LATER_NS = 1_000_000_000_000
_SERVER = get_context("forkserver")
_SERVER.set_forkserver_preload(["garbi_map.pipeline", "garbi_map.navigate.eskf", "open3d", "rerun"])


def kills(work: Path, count: int) -> dict[str, Any]:
    """How many of so many interrupted builds end in the map of the undisturbed one."""
    count = count or 50
    logs = [cut(work / f"dive{k}.mcap", *span, k * LATER_NS) for k, span in enumerate(SPANS)]
    _run(logs, work / "warm")  # compiled code is kept
    length = _run(logs, work / "undisturbed")
    wanted = contents(work / "undisturbed")
    moments = np.random.default_rng(5).uniform(0.05, 1.0, count) * length
    done = same = 0
    stages: dict[str, int] = {}
    try:
        for k, moment in enumerate(moments):
            out = work / f"killed{k}"
            stage = _killed(logs, out, moment, 2 if k % 5 == 4 else 1)
            _run(logs, out)
            done += 1
            same += contents(out) == wanted
            stages[stage] = stages.get(stage, 0) + 1
            print(
                f"{done}: killed after {moment:.1f} of {length:.1f} s of CPU time, {stage}; {same} the same", flush=True
            )
            shutil.rmtree(out)
    except KeyboardInterrupt:  # enough: what was done counts
        pass
    return {"kills": done, "same_map": same, "files_compared": len(wanted), "what_the_kill_left": stages}


def _killed(logs: list[Path], out: Path, moment: float, workers: int) -> str:
    """Start a build and kill it after so many seconds of CPU time; says how far it had come."""
    process = _started(logs, out, workers)
    while process.is_alive() and _spent(str(process.pid)) < moment:
        process.join(0.02)
    process.kill()
    process.join()
    return _stage(out)


def cut(path: Path, begin: float, end: float, later_ns: int) -> Path:
    """A stretch of the sample log, s, as a log of another time."""
    log = open_log([SAMPLE])
    with LogWriter(path) as writer:
        writer.attach("rig.yaml", "application/yaml", (log.rig_text or "").encode())
        for topic, raw in log.messages(set(log.topics)):
            kind = log.topics[topic].type
            message: Any = writer.types.deserialize_cdr(raw.data, kind)
            if topic == "/tf_static":
                writer.write(topic, kind, message, raw.log_time + later_ns)
                continue
            stamp = stamp_of(raw.data)
            if begin <= (stamp - log.begin_ns) * 1e-9 < end:
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp + later_ns, 1_000_000_000)
                writer.write(topic, kind, message, stamp + later_ns, raw.arrival(stamp) + later_ns)
    return path


def _run(logs: list[Path], out: Path) -> float:
    """A build to its end, and the CPU seconds that it took."""
    process, spent = _started(logs, out, 1), 0.0
    while process.is_alive():
        spent = max(spent, _spent(str(process.pid)))
        process.join(0.1)
    if process.exitcode:
        raise RuntimeError(f"a build ended with {process.exitcode}")
    return spent


def _spent(process: str) -> float:
    """CPU seconds of a process and of those that it has started: on a busy machine clocks say little."""
    try:
        own = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        tasks = Path(f"/proc/{process}/task").iterdir()
        children = [child for task in tasks for child in (task / "children").read_text().split()]
    except OSError:  # it has ended
        return 0.0
    return (int(own[11]) + int(own[12])) / os.sysconf("SC_CLK_TCK") + sum(map(_spent, children))


def _started(logs: list[Path], out: Path, workers: int) -> ForkServerProcess:
    """A build in a process of its own, which has the libraries loaded already: most of a short build's time."""
    process = _SERVER.Process(target=build_map, args=(logs, out, Config()), kwargs={"workers": workers})
    process.start()
    return process


def contents(out: Path) -> dict[str, str]:
    """Digests of every file that must be the same however the map was made."""
    files = [out / "trajectory.tum", out / "cloud.laz", out / "seabed.tif", *sorted(out.glob("db/*/*.parquet"))]
    return {str(file.relative_to(out)): digest_of(file.read_bytes()) for file in files}


def _stage(out: Path) -> str:
    """How far a killed run had come, as its folder shows."""
    if (out / "report.json").exists() and not (out / ".work").exists():
        return "finished"
    if any(out.glob(".work/files/*")):
        return "while the files were written"
    if (out / "db/catalogue.sqlite").exists():
        return "while the dives were joined and fused"
    if any(out.glob(".work/*/registered.npz")):
        return "registration done"
    if any(out.glob(".work/*/sweeps.json")):
        return "sweeps done"
    return "while sweeps were made" if any(out.glob(".work/*")) else "before anything was written"
