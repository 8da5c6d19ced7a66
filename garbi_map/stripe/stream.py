"""The stripes of a stream of images, decoded and searched by several threads, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

from garbi_map.log.records import Image
from garbi_map.stripe.decode import ImageLosses, UnusableImage, decode
from garbi_map.stripe.detector import StripeDetector
from garbi_map.stripe.types import Stripe

_AHEAD = 6
"""Images per thread that are in work at once: bounds the memory."""


def detect_all(
    images: Iterable[Image],
    detector: StripeDetector,
    alpha_of: Callable[[int], float] | None = None,
    workers: int = 2,
    losses: ImageLosses | None = None,
) -> Iterator[Stripe]:
    """The stripe of every usable image, in the order of the images; the others are counted in `losses`.

    Decoders and kernels release the interpreter's lock, so that threads are enough.
    """
    losses = ImageLosses() if losses is None else losses
    settings = detector.settings

    def work(image: Image) -> Stripe | str:
        try:
            pixels = decode(image, detector.image_size, settings.max_pixels)
        except UnusableImage as reason:
            return str(reason)
        return detector.detect(pixels, image.stamp_ns, None if alpha_of is None else alpha_of(image.stamp_ns))

    with ThreadPoolExecutor(workers) as pool:
        pending: deque[Future[Stripe | str]] = deque()
        try:
            for image in images:
                pending.append(pool.submit(work, image))
                if len(pending) >= _AHEAD * workers:
                    yield from _taken(pending, losses)
            while pending:
                yield from _taken(pending, losses)
        finally:
            for future in pending:
                future.cancel()


def _taken(pending: deque[Future[Stripe | str]], losses: ImageLosses) -> Iterator[Stripe]:
    found = pending.popleft().result()
    if isinstance(found, str):
        losses.reasons[found] += 1
    else:
        yield found
