"""A log of many hours without the disk that it would take: a dive is played again and again, its images thinned and
followed by a hole in the file that is as long as the images that were left out.

    python -m tools.bench.long_log DIVE.mcap LONG.mcap [--hours 12] [--gigabytes 30]

Navigation keeps its rates. An image with zeros behind it is still that image, to the log an image of so many bytes.
"""

from __future__ import annotations

import argparse
import struct
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from garbi_map.log import open_log
from garbi_map.log.decode import stamp_of
from garbi_map.log.types import standard_types

IMAGE = "/camera/image/compressed"
HOLE = 1 << 16  # bytes of zeros worth a hole
CHUNK = 100_000  # bytes, so that the index is as long as that of a log without holes


class Sparse:
    """A file in which zeros at the end of what is written take no room."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file

    def write(self, data: bytes) -> int:
        """Write all but the long zeros at the end of a message."""
        if len(data) > HOLE:
            body = bytes(data).rstrip(b"\0")
            if len(data) - len(body) > HOLE:
                self.file.write(body)
                self.file.seek(len(data) - len(body), 1)
                return len(data)
        return self.file.write(data)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self.file.tell()

    def flush(self) -> None:
        """Hand over to the system."""
        self.file.flush()


def write_long(source: Path, target: Path, hours: float, gigabytes: float, images_every: float = 1.0) -> None:
    """Write a log of so many hours and bytes; one image every `images_every` seconds."""
    log = open_log([source])
    assert log.rig_text is not None
    topics = {name for name in log.topics if not name.startswith(("/tf", "/truth"))}
    found = [(topic, bytes(raw.data)) for topic, raw in log.messages(topics)]
    messages = sorted((stamp_of(memoryview(data)), topic, data) for topic, data in found)
    length = log.end_ns - log.begin_ns + 10_000_000
    size = int(gigabytes * 1e9 / (hours * 3600 / images_every))
    types = standard_types()
    with target.open("wb") as file:
        writer = Writer(Sparse(file), chunk_size=CHUNK, compression=CompressionType.NONE)  # type: ignore[arg-type]
        writer.start("ros2", "long_log")
        writer.add_attachment(0, 0, "rig.yaml", "application/yaml", log.rig_text.encode())
        channels = {}
        for topic in [*topics, "/tf_static"]:
            name = log.topics[topic].type
            schema = writer.register_schema(name, "ros2msg", types.generate_msgdef(name, ros_version=2)[0].encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, raw in log.messages({"/tf_static"}):
            writer.add_message(channels[topic], raw.log_time, bytes(raw.data), raw.log_time)
        next_image, end = log.begin_ns, log.begin_ns + round(hours * 3.6e12)
        for turn in range(round(hours * 3.6e12 / length) + 1):
            for at, topic, data in messages:
                stamp = at + turn * length
                if stamp >= end or (topic == IMAGE and stamp < next_image):
                    continue
                data = data[:4] + struct.pack("<iI", *divmod(stamp, 10**9)) + data[12:]
                if topic == IMAGE:
                    next_image += round(images_every * 1e9)
                    data = _longer(data, size)
                writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
        file.truncate(file.tell())


def _longer(data: bytes, size: int) -> bytes:
    """A CompressedImage with zeros behind the picture, `size` bytes of it in all."""
    frame = struct.unpack_from("<I", data, 12)[0]
    place = 16 + frame
    place += -(place - 4) % 4
    text = struct.unpack_from("<I", data, place)[0]
    place += 4 + text
    place += -(place - 4) % 4
    more = max(size - len(data), 0)
    count = struct.unpack_from("<I", data, place)[0]
    return data[:place] + struct.pack("<I", count + more) + data[place + 4 : place + 4 + count] + bytes(more)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument("--gigabytes", type=float, default=30.0)
    options = parser.parse_args()
    write_long(options.source, options.target, options.hours, options.gigabytes)


if __name__ == "__main__":
    main()
