"""Settings from ``DRONERF_*`` variables and an optional TOML file, turned into frozen config.

Order: command line, environment, the file named by ``DRONERF_CONFIG``, defaults. Nested values are
written with two underscores: ``DRONERF_MISSION__CONTROL_RATE_HZ=10``. No algorithm sees
``Settings``; each package gets its own piece.
"""

from __future__ import annotations

import json
import os
import secrets
import ssl
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import is_dataclass, replace
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pydantic import Field, SecretStr, ValidationError, field_validator
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)
from pydantic_settings import SettingsError as SettingsSourceError

from server.api.config import WebhookConfig
from server.api.prefix import checked_prefix
from server.jobs.config import RayConfig
from server.mission.config import FlightConfig, MissionConfig
from server.planner.config import PlannerConfig
from server.planner.margins import space_within
from server.recording.config import RecordingConfig
from server.store.config import RetentionConfig
from server.swarm.config import SafetyConfig
from server.vision.config import VisionConfig


class SettingsError(ValueError):
    """A setting has a bad value; the text names it in one line."""


class Settings(BaseSettings):
    """Everything that can be set from outside.

    Attributes:
        host: Address the console listens on.
        port: Its port.
        token: The secret that opens the console; without it and ``token_file`` one is made.
        token_file: A file that holds the token.
        make_token: Make a token where none is set, even if others than this machine can connect.
        path_prefix: Path below which a proxy serves the console, as ``/drones``.
        tls_certificate: Certificate (chain) in PEM; with ``tls_key`` the console speaks HTTPS.
        tls_key: Its private key in PEM.
        webhook: Who is told when a capture or a job has ended.
        runs: Folder of the run folders.
        database_url: Database of the catalogue of runs; without it, a file in ``runs``.
        retention: When old runs are deleted.
        mission: Tolerances, waits and counts of the flight.
        planner: Candidates, fitness, annealing, tracking, avoidance.
        vision: Region search, boxes, seed geometry, pose filter.
        safety: Fence, battery, link and separation limits.
        recording: Whether flights are recorded, and the bounds of the file.
        log: Form of the service's log: ``text`` (warnings alone) or ``json`` (one object a line).
        runner: Where fields are trained: ``local`` (this machine) or ``ray`` (a cluster).
        ray: That cluster.
    """

    model_config = SettingsConfigDict(
        env_prefix="DRONERF_", env_nested_delimiter="__", extra="ignore", frozen=True
    )

    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    token: SecretStr | None = None
    token_file: Path | None = None
    make_token: bool = False
    path_prefix: str = ""
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    webhook: WebhookConfig = WebhookConfig()
    runs: Path = Path("runs")
    database_url: SecretStr | None = None
    retention: RetentionConfig = RetentionConfig()
    mission: MissionConfig = MissionConfig()
    planner: PlannerConfig = PlannerConfig()
    vision: VisionConfig = VisionConfig()
    safety: SafetyConfig = SafetyConfig()
    recording: RecordingConfig = RecordingConfig()
    log: Literal["text", "json"] = "text"
    runner: Literal["local", "ray"] = "local"
    ray: RayConfig = RayConfig()

    @field_validator("path_prefix")
    @classmethod
    def _a_path(cls, prefix: str) -> str:
        return checked_prefix(prefix)

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - the base class passes it.
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - likewise.
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Put the TOML file named by ``DRONERF_CONFIG`` below the environment."""
        sources = [init_settings, env_settings]
        if os.environ.get("DRONERF_CONFIG"):
            sources.append(
                TomlConfigSettingsSource(settings_cls, Path(os.environ["DRONERF_CONFIG"]))
            )
        return tuple(sources)

    def flight(self) -> FlightConfig:
        """Return the pieces that fly.

        Raises:
            SettingsError: If they do not fit together.
        """
        safety = self.safety
        try:
            # The planner's room follows the safety limits; whoever narrows those need not know it.
            space = space_within(
                self.planner.space,
                fence_radius_m=safety.fence_radius_m,
                floor_m=safety.floor_m,
                ceiling_m=safety.ceiling_m,
                standoff_m=safety.standoff_m,
            )
            planner = replace(self.planner, space=space)
            return FlightConfig(self.mission, planner, self.vision, safety)
        except ValueError as error:
            raise SettingsError(str(error)) from error

    def open_token(self) -> str:
        """Return the token: as set, else from the file, else a new one.

        Raises:
            SettingsError: If the file cannot be read or the token is too short to be one.
        """
        if self.token is not None:
            token = self.token.get_secret_value()
        elif self.token_file is not None:
            try:
                token = self.token_file.read_text().strip()
            except OSError as error:
                raise SettingsError(f"token file {self.token_file}: {error.strerror}") from error
        else:
            if not (self.make_token or is_loopback(self.host)):
                raise SettingsError(
                    f"{self.host} can be reached by others: set DRONERF_TOKEN, or"
                    " DRONERF_MAKE_TOKEN=1 to have one made and printed"
                )
            return secrets.token_urlsafe(24)
        if len(token) < 8 or not all("!" <= character <= "~" for character in token):
            raise SettingsError("the token must be at least 8 visible ASCII characters, no spaces")
        return token

    def token_registry(self) -> Path:
        """Return the file that keeps the digests of all other tokens."""
        return self.runs / ".tokens.json"

    def session_file(self) -> Path:
        """Return the file that keeps the digests of signed-in browsers' sessions."""
        return self.runs / ".sessions.json"

    def tls(self) -> tuple[Path, Path] | None:
        """Return certificate and key, None to speak plain HTTP.

        Raises:
            SettingsError: If one is missing, or they do not belong together.
        """
        if self.tls_certificate is None and self.tls_key is None:
            return None
        if self.tls_certificate is None or self.tls_key is None:
            raise SettingsError("tls_certificate and tls_key go together")
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
                self.tls_certificate, self.tls_key, password=lambda: b""
            )
        except OSError as error:  # An SSLError is one.
            raise SettingsError(
                f"{self.tls_certificate} and {self.tls_key} are no certificate and key:"
                f" {error.strerror or error}"
            ) from error
        return self.tls_certificate, self.tls_key


def is_loopback(host: str) -> bool:
    """Return whether nobody but this machine can connect to ``host``."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def load_settings(**overrides: object) -> Settings:
    """Return the settings; ``overrides`` that are None are ignored.

    Raises:
        SettingsError: Naming the first bad value or unknown name in one line.
    """
    path = os.environ.get("DRONERF_CONFIG")
    if path and not Path(path).is_file():
        raise SettingsError(f"DRONERF_CONFIG names {path}, which is not a file")
    given = {key: value for key, value in overrides.items() if value is not None}
    try:
        _refuse_unknown_names(Path(path) if path else None)
        settings = Settings(**given)  # pyright: ignore[reportArgumentType]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise SettingsError(f"setting {place or 'value'}: {message}") from error
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{path} is not valid TOML: {error}") from error
    except SettingsSourceError as error:
        raise SettingsError(f"environment: {error}") from error
    settings.flight()  # What does not fit together is told before anything starts.
    return settings


def _refuse_unknown_names(file: Path | None) -> None:
    """Raise SettingsError for a name that would be ignored: a mistyped limit must not pass."""
    if file is not None:
        for names in _leaves(tomllib.loads(file.read_text(encoding="utf-8"))):
            if not _is_setting(names):
                raise SettingsError(f"{file}: unknown setting {'.'.join(names)}")
    for variable, value in os.environ.items():
        if not variable.startswith("DRONERF_"):
            continue
        group, *inner = variable.removeprefix("DRONERF_").lower().split("__")
        names = (group, *inner)
        # Without an underscore pair it may belong to somebody else, as DRONERF_CONFIG does.
        if inner and not _is_setting(names):
            raise SettingsError(f"unknown setting {variable}")
        for inside in _leaves_of_json(value) if group in Settings.model_fields else ():
            if not _is_setting((*names, *inside)):
                raise SettingsError(f"unknown setting {'.'.join(inside)} in {variable}")


def _leaves_of_json(value: str) -> list[tuple[str, ...]]:
    """Return the names inside a whole group that is given as JSON."""
    try:
        table = json.loads(value)
    except json.JSONDecodeError:
        return []
    return list(_leaves(table)) if isinstance(table, dict) else []


def _leaves(table: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name, value in table.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*above, name))
        else:
            yield (*above, name)


def _is_setting(names: Sequence[str]) -> bool:
    """Return whether ``names`` lead from ``Settings`` through nested config to a field."""
    known: Mapping[str, Any] = {n: f.annotation for n, f in Settings.model_fields.items()}
    for name in names:
        if name not in known:
            return False
        known = _parts(known[name])
    return True


def _parts(kind: Any) -> Mapping[str, Any]:
    """Return the settings inside a setting: a config's fields, or the known keys of a table."""
    if is_dataclass(kind):
        return get_type_hints(kind)
    if get_origin(kind) is Mapping:
        keys, values = get_args(kind)
        return dict.fromkeys(get_args(keys), values)
    return {}
