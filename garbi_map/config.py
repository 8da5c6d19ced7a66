"""The one configuration object: a section for each room, YAML in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import yaml
from pydantic import ValidationError, model_validator

from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.compare.settings import CompareSettings
from garbi_map.db.settings import DatabaseSettings
from garbi_map.errors import GarbiError
from garbi_map.export.settings import ExportSettings
from garbi_map.log.settings import LogSettings
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.plain_yaml import read_yaml
from garbi_map.record.settings import RecordSettings
from garbi_map.register.settings import RegisterSettings
from garbi_map.seabed.settings import SeabedSettings
from garbi_map.settings import Settings
from garbi_map.stripe.settings import StripeSettings
from garbi_map.sweep.settings import SweepSettings
from garbi_map.view.settings import ViewSettings


class Config(Settings):
    """Everything a user can set, with its default; the resolved one is written beside every result."""

    log: LogSettings = LogSettings()
    stripe: StripeSettings = StripeSettings()
    sweep: SweepSettings = SweepSettings()
    navigate: NavigateSettings = NavigateSettings()
    registration: RegisterSettings = RegisterSettings()
    seabed: SeabedSettings = SeabedSettings()
    database: DatabaseSettings = DatabaseSettings()
    export: ExportSettings = ExportSettings()
    view: ViewSettings = ViewSettings()
    calibrate: CalibrateSettings = CalibrateSettings()
    compare: CompareSettings = CompareSettings()
    record: RecordSettings = RecordSettings()

    @model_validator(mode="after")
    def _depth_is_depth(self) -> Self:
        water = ("water_density", "gravity", "atmosphere")
        if self.log.topics.depth and any(
            getattr(self.navigate, one) != getattr(NavigateSettings(), one) for one in water
        ):
            raise ValueError(f"log.topics.depth is metres already; leave navigate's {', '.join(water)} as they are")
        return self

    def to_yaml(self) -> str:
        """The whole configuration, defaults included."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)


def load_config(path: Path | None) -> Config:
    """The configuration of a YAML file, or the defaults where there is none.

    Raises GarbiError that names the file, the key and what is wrong with it.
    """
    if path is None:
        return Config()
    try:
        return Config.model_validate(read_yaml(path) or {})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise GarbiError(f"{path}: {key or 'top level'}: {first['msg']}") from error
