"""`garbi record`"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from garbi_map.record.lines import Kind
    from garbi_map.record.ports import Port
    from garbi_map.record.recorder import Recorder

PORT = "/dev/ttyUSB0[@BAUD] or udp://[HOST]:PORT."


@app.command("record")
def record(
    out: Annotated[Path, typer.Option("--output", "-o", help="The log, .mcap.")],
    camera: Annotated[
        str | None,
        typer.Option(
            help="Number or /dev/video*, RTSP or other URL, GStreamer pipeline, video file, folder of images."
        ),
    ] = None,
    encoder: Annotated[str | None, typer.Option(help=f"Where the laser's angle comes in: {PORT}")] = None,
    imu: Annotated[str | None, typer.Option(help="Likewise; a port may carry several.")] = None,
    pressure: Annotated[str | None, typer.Option(help="Likewise.")] = None,
    dvl: Annotated[str | None, typer.Option(help="Likewise.")] = None,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml, to be attached to the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration (YAML); section record.")] = None,
    rate: Annotated[float | None, typer.Option(min=0.1, max=1000, help="Images per second.")] = None,
    size: Annotated[str | None, typer.Option(help="Of the images that a device is asked for, 768x576.")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Play a video file or folder again and again.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="Record for so long.")] = None,
    split_size: Annotated[float | None, typer.Option(min=0.1, help="Begin a new file after so many MB.")] = None,
    split_seconds: Annotated[
        float | None, typer.Option(min=0.5, help="Begin a new file after so many seconds.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a log that is there.")] = False,
    behaviours: Annotated[
        Path | None, typer.Option(help="Run the behaviours of this file (YAML) on what is recorded.")
    ] = None,
    command_to: Annotated[
        str | None, typer.Option(help="HOST:PORT that their commands are sent to, UDP, a line of JSON each.")
    ] = None,
) -> None:
    """Record a log from a camera and sensors; Ctrl-C ends it (docs/record-protocol.md: what the sensors send)."""
    from garbi_map.config import load_config
    from garbi_map.record.disk import MB, Target
    from garbi_map.record.frames import frames_of
    from garbi_map.record.recorder import Inputs, Recorder
    from garbi_map.record.screen import Screen
    from garbi_map.record.subscribers import Offer, subscriber
    from garbi_map.rig import load_rig

    if command_to is not None and behaviours is None:
        raise typer.BadParameter("--command-to needs --behaviours")
    settings, mounted = load_config(config), load_rig(rig) if rig else None
    frames = None if camera is None else frames_of(camera, rate, _size(size), loop)
    ports = _ports({"encoder": encoder, "imu": imu, "pressure": pressure, "dvl": dvl})
    split_bytes = None if split_size is None else round(split_size * MB)
    target = Target(out, split_bytes, split_seconds, force)
    target.check()
    others = [subscriber("behaviours", Offer(behaviours, command_to, settings, mounted))] if behaviours else []
    with Screen() as screen:
        text = None if mounted is None else mounted.to_yaml()
        recorder = Recorder(Inputs(frames, ports), target, settings, screen.say, text, others)
        with _stopped_by_signals(recorder):
            done = recorder.run(seconds, screen.show)
    for file in done.files:
        typer.echo(f"{file}: recorded")
    typer.echo(", ".join(f"{count} of {name}" for name, count in done.counts.items()))
    for line in done.losses:
        typer.echo(f"left out: {line}", err=True)
    if done.losses:
        raise typer.Exit(3)


def _ports(named: dict[Kind, str | None]) -> list[tuple[Port, tuple[Kind, ...]]]:
    """Each port once, with the kinds of readings that are taken from it."""
    from garbi_map.record.ports import port_of

    kinds: dict[str, list[Kind]] = {}
    for kind, text in named.items():
        if text is not None:
            kinds.setdefault(text, []).append(kind)
    return [(port_of(text), tuple(some)) for text, some in kinds.items()]


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise typer.BadParameter("--size: say it as 768x576")
    return int(width), int(height)


@contextmanager
def _stopped_by_signals(recorder: Recorder) -> Iterator[None]:
    """The first signal ends the recording cleanly, the second one at once."""
    import signal

    def stop(number: int, _: object) -> None:
        recorder.stop()
        signal.signal(number, signal.SIG_DFL)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, stop) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
