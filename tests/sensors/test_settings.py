"""What a person reads when a TOML file is wrong."""

from dataclasses import dataclass, field
from typing import Literal

import pytest

from sensors.errors import InputError
from sensors.settings import settings_from_table


@dataclass(frozen=True)
class Inner:
    depth: float = 1.0


@dataclass(frozen=True)
class Outer:
    duration: float
    seed: int = 1
    kind: Literal["dc", "ac"] = "dc"
    levels: tuple[float, ...] = ()
    limit: float | None = None
    inner: Inner = field(default_factory=Inner)


def test_a_table_becomes_settings() -> None:
    table = {"duration": 600, "levels": [41, 80.5], "inner": {"depth": 30}, "limit": 2}
    settings = settings_from_table(Outer, table, "a.toml [outer]", InputError)
    assert settings == Outer(600.0, levels=(41.0, 80.5), inner=Inner(30.0), limit=2.0)
    assert isinstance(settings.duration, float)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"duraton": 1.0}, r"\[outer\]: unknown key 'duraton'; did you mean 'duration'"),
        ({"duration": 1.0, "zzz": 1}, r"unknown key 'zzz'; it takes duration, seed"),
        ({}, "the key 'duration' is missing"),
        ({"duration": "long"}, "duration is 'long'; a number is needed"),
        ({"duration": 1.0, "seed": True}, "seed is True"),
        ({"duration": 1.0, "seed": 1.5}, "seed is 1.5"),
        ({"duration": 1.0, "kind": "dx"}, "kind is 'dx'; it can be 'dc' or 'ac'"),
        ({"duration": 1.0, "levels": 3}, "levels is 3; a list"),
        ({"duration": 1.0, "inner": {"dept": 1}}, r"\[outer.inner\]: unknown key 'dept'"),
    ],
)
def test_an_error_names_section_key_and_value(table: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        settings_from_table(Outer, table, "a.toml [outer]", InputError)


def test_a_section_that_its_own_check_names_stands_there_once() -> None:
    @dataclass(frozen=True)
    class Named:
        hop: float

        def __post_init__(self) -> None:
            raise InputError(f"[oma] hop is {self.hop:g} s")

    with pytest.raises(InputError, match=r"^a\.toml \[oma\]: hop is 9 s$"):
        settings_from_table(Named, {"hop": 9.0}, "a.toml [oma]", InputError)
    with pytest.raises(InputError, match=r"^a\.toml: \[oma\] hop is 9 s$"):
        settings_from_table(Named, {"hop": 9.0}, "a.toml", InputError)
