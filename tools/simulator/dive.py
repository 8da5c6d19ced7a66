"""A whole dive: scenario in; images, stripes, navigation, truth out. Open loop with `fly`, closed loop with `step`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
import simplejpeg
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats, Image, Mount, Navigation
from garbi_map.rig import Rig
from garbi_map.stripe.types import Stripe
from tools.simulator.guidance import PERIOD, pilot
from tools.simulator.motion import Motion
from tools.simulator.optics import Renderer, View, view_of
from tools.simulator.profiles import cast_stripe
from tools.simulator.rigs import make_rig, rig_mount
from tools.simulator.route import plan
from tools.simulator.scan import laser_angle
from tools.simulator.scenario import Scenario
from tools.simulator.seabed import make_scene
from tools.simulator.sensors import MOUNTS, Suite, to_ns
from tools.simulator.sheet import cast_slice, plane_at
from tools.simulator.vehicle import Command, Vehicle

FIRST_IMAGE = 0.02  # s
TAIL = 0.5  # s flown after the end, so that interpolation never runs out
T = TypeVar("T")


class Dive:
    """One simulated dive. What is random in an image depends on the seed and the image's number alone."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.rig: Rig = make_rig(scenario)
        self.reference = plan(scenario.route, scenario.duration)
        self.scene = make_scene(scenario, self.reference)
        self.suite = Suite(scenario)
        x, y, heading, _, _ = self.reference.at(0.0)
        self.vehicle = Vehicle(scenario, np.array([x, y, scenario.altitude]), heading)
        self._mount = rig_mount(scenario)

    @cached_property
    def renderer(self) -> Renderer:
        """The camera."""
        return Renderer(self.scenario, self.rig)

    @property
    def motion(self) -> Motion:
        """The true motion so far."""
        return self.vehicle.motion

    @property
    def mounts(self) -> dict[str, Mount]:
        """base_link <- sensor frames, the camera included."""
        camera = self.rig.camera
        turn = Rotation.from_quat(self._mount.quaternion)
        optical = Mount(
            self._mount.translation + turn.apply(camera.centre),
            (turn * Rotation.from_quat(camera.quaternion)).as_quat(),
        )
        return {"rig": self._mount, camera.frame_id: optical, **MOUNTS}

    def step(self, command: Command, dt: float) -> None:
        """Closed loop: the vehicle obeys for dt seconds; images and sensors may then be asked for up to then."""
        self.vehicle.step(command, dt)

    def fly(self) -> Dive:
        """Open loop: the pilot follows the route to the end."""
        while self.vehicle.time < self.scenario.duration + TAIL:
            self.vehicle.step(pilot(self.vehicle, self.reference, self.scenario.altitude), PERIOD)
        return self

    @property
    def exposures(self) -> Floats:
        """True moments (n,) s of the images."""
        count = int(np.ceil((self.scenario.duration - FIRST_IMAGE) * self.scenario.camera.rate))
        return FIRST_IMAGE + np.arange(count) / self.scenario.camera.rate

    def image(self, number: int) -> Image:
        """The image of that number, as the camera's driver sends it."""
        camera = self.scenario.camera
        time = FIRST_IMAGE + number / camera.rate
        view, alpha = self._seen_at(time)
        picture = self.renderer.image(view, alpha, np.random.default_rng([self.scenario.seed, 4, number]))
        data = simplejpeg.encode_jpeg(picture, camera.quality, "BGR", "420")
        stamp, arrival = to_ns(np.array([time + camera.clock_offset, time + camera.latency]))
        return Image(int(stamp), int(arrival), "jpeg", data)

    def stripe(self, number: int) -> Stripe:
        """What the detector would find in the image of that number, cast without rendering it."""
        camera = self.scenario.camera
        time = FIRST_IMAGE + number / camera.rate
        view, alpha = self._seen_at(time)
        stamp = int(to_ns(np.array([time + camera.clock_offset]))[0])
        rng = np.random.default_rng([self.scenario.seed, 6, number])
        return cast_stripe(self.renderer, view, alpha, stamp, rng)

    def images(self, workers: int = 2) -> Iterator[Image]:
        """All images of an open-loop dive, in order, rendered by that many processes."""
        return _in_order(self, _image, workers)

    def stripes(self, workers: int = 2) -> Iterator[Stripe]:
        """All stripes of an open-loop dive, in order, cast by that many processes."""
        return _in_order(self, _stripe, workers)

    def navigation(self, begin: float = 0.0, end: float | None = None) -> Navigation:
        """What the other sensors measured in [begin, end) s; ask for consecutive stretches, each once."""
        end = self.scenario.duration if end is None else end
        suite, motion = self.suite, self.motion
        return Navigation(
            encoder=suite.encoder.between(begin, end) if suite.encoder else None,
            imu=suite.imu.between(motion, begin, end) if suite.imu else None,
            pressure=suite.pressure.between(motion, begin, end) if suite.pressure else None,
            dvl=suite.dvl.between(motion, begin, end) if suite.dvl else None,
            mounts=self.mounts,
        )

    def seen(self, count: int = 60_000) -> Floats:
        """Points (count, 3) m, map, of the true surface that the camera saw lit, drawn evenly from rays and images."""
        rng = np.random.default_rng([self.scenario.seed, 7])
        times = self.exposures
        times = times[np.unique(np.linspace(0, len(times) - 1, 600).astype(int))]
        found = []
        for time in times:
            view, alpha = self._seen_at(time)
            laser = self.scenario.laser
            line = cast_slice(self.rig, plane_at(self.rig, alpha, laser), laser, 0.0, view.cast)
            position, rotation = self.rig_pose(time)
            points = line.point[line.seen]
            points = points[rng.permutation(len(points))[: 2 * count // len(times) + 1]]
            found.append(rotation.apply(points) + position)
            if self.scene.movers:
                found[-1] = found[-1][self.scene.on_ground(found[-1])]
        points = np.concatenate(found)
        return points[rng.permutation(len(points))[:count]]

    def rig_pose(self, time: float) -> tuple[Floats, Rotation]:
        """True position (3,) m and rotation map <- rig at a time (s)."""
        now = self.motion.at(time)
        rotation = now.rotation[0]
        return (
            now.position[0] + rotation.apply(self._mount.translation),
            rotation * Rotation.from_quat(self._mount.quaternion),
        )

    def _seen_at(self, time: float) -> tuple[View, float]:
        position, rotation = self.rig_pose(time)
        return view_of(self.scene, position, rotation, time), float(laser_angle(self.scenario.laser, time)[0])


@dataclass(frozen=True)
class Survey:
    """A dive without images: the rig, what the other sensors measured, and the stripes, cast as they are asked for."""

    rig: Rig
    navigation: Navigation
    stripes: Iterator[Stripe]


def cast_profiles(scenario: Scenario, workers: int = 2) -> Survey:
    """The quick way to a long survey: no image is rendered."""
    dive = Dive(scenario).fly()
    return Survey(dive.rig, dive.navigation(), dive.stripes(workers))


_own: Dive | None = None  # of a worker process


def _begin(scenario: Scenario) -> None:
    """A worker makes the same dive again from its seed: cheaper than to send a scene."""
    global _own
    _own = Dive(scenario).fly()


def _image(number: int) -> Image:
    assert _own is not None
    return _own.image(number)


def _stripe(number: int) -> Stripe:
    assert _own is not None
    return _own.stripe(number)


def _in_order(dive: Dive, job: Callable[[int], T], workers: int) -> Iterator[T]:
    """job(0), job(1), ... never more than some ahead. Processes, for ray casting holds Python's lock; and spawned, for
    its threads do not survive a fork."""
    numbers = range(len(dive.exposures))
    if workers == 0:
        own = dive.image if job is _image else dive.stripe
        yield from map(own, numbers)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, (dive.scenario,)) as pool:
        waiting: deque[Future[T]] = deque()
        for number in numbers:
            waiting.append(pool.submit(job, number))
            if len(waiting) > 16 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
