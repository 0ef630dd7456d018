"""The settings of a recording folder: `recording.toml`, read and written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import date, datetime, time
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from resim.core import faults, remedies
from resim.core.errors import InputError
from resim.core.files import parse_toml, read_file

SETTINGS = "recording.toml"


def _text(value: object) -> object:
    """TOML's own numbers and times as text."""
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


_Text = Annotated[str, BeforeValidator(_text)]


class _SettingsPart(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, populate_by_name=True)


class Environment(_SettingsPart):
    """The environment, in JSCEN's terms."""

    fog_density: _Text | None = Field(default=None, alias="fogDensity")
    precipitation_density: _Text | None = Field(default=None, alias="precipitationDensity")
    date_time: _Text | None = Field(default=None, alias="dateTime")


class Settings(_SettingsPart):
    """What `recording.toml` says: map as written, rates in Hz."""

    name: str = Field(min_length=1)
    map: str = Field(min_length=1)
    ego: _Text = Field(min_length=1)
    build: str | None = None
    build_hash: str | None = None
    gt_rate: float | None = Field(strict=True, default=None, ge=1e-3, le=1e4)
    sd_rate: float | None = Field(strict=True, default=None, ge=1e-3, le=1e4)
    environment: Environment = Environment()
    provenance: dict[str, _Text] = Field(default_factory=dict)


def read_settings(path: Path) -> Settings:
    """Give the settings in the file; raises InputError that names every wrong field."""
    raw = read_file(path, remedies.RECORDING)
    data = parse_toml(raw, path, 'TOML puts text in quotes: name = "drive 1".')
    try:
        return Settings.model_validate(data, by_name=False)
    except ValidationError as e:
        raise InputError(path, faults.describe(e.errors(), Settings), "Correct these fields.") from e


def settings_text(fields: Mapping[str, str | float | None], sections: Mapping[str, Mapping[str, str]]) -> str:
    """Give the text of a `recording.toml`: its fields that are not None, then the sections that hold anything."""
    lines = [f"{key} = {_toml(value)}" for key, value in fields.items() if value is not None]
    for section, entries in sections.items():
        if entries:
            lines += ["", f"[{section}]", *(f"{_key(k)} = {_toml(v)}" for k, v in entries.items())]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: str | float) -> str:
    """A TOML number or basic string (JSON's escapes, and DEL)."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))
