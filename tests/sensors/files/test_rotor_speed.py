"""A rotor's speed is kept apart from the vibrations beside it."""

import numpy as np
import pytest

from sensors.files.conditions import with_rotor_speed_apart
from sensors.files.table import ChannelTable


def table(*titles: tuple[str, str]) -> ChannelTable:
    names, units = zip(*titles, strict=True)
    return ChannelTable(names, units, np.arange(12.0).reshape(4, -1)[:, : len(titles)], None)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("RotSpeed", "rpm"), ("rotor speed", "rpm"), ("rotor_rpm", "1/min"), ("Rotordrehzahl", "rpm")],
)
def test_a_rotors_speed_leaves_the_channels(name: str, unit: str) -> None:
    apart = with_rotor_speed_apart(table(("top", "m/s²"), (name, unit), ("low", "m/s²")))
    assert apart.names == ("top", "low")
    assert apart.rotor_speed is not None
    assert apart.rotor_speed.tolist() == [1.0, 4.0, 7.0, 10.0]
    assert apart.samples[:, 1].tolist() == [2.0, 5.0, 8.0, 11.0]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("GenSpeed", "rpm"), ("rotor", "m/s²"), ("rotation", "rad"), ("fan", "rpm")),
        *(("Generatordrehzahl", "1/min"), ("Drehzahl Generator", "1/min")),
        *(("Lüfterdrehzahl", "1/min"), ("Generator rotor speed", "rpm")),
    ],
)
def test_other_channels_stay(name: str, unit: str) -> None:
    whole = table(("top", "m/s²"), (name, unit), ("low", "m/s²"))
    assert with_rotor_speed_apart(whole) is whole


@pytest.mark.parametrize("generator", ["Generatordrehzahl", "Drehzahl Generator", "gen_rot_rpm"])
def test_a_generator_beside_a_rotor_hides_it_not(generator: str) -> None:
    apart = with_rotor_speed_apart(
        table(("top", "m/s²"), (generator, "1/min"), ("Rotordrehzahl", "1/min"))
    )
    assert apart.names == ("top", generator)
    assert apart.rotor_speed is not None
    assert apart.rotor_speed.tolist() == [2.0, 5.0, 8.0, 11.0]


def test_missing_speeds_are_taken_between_their_neighbours() -> None:
    measured = table(("top", "m/s²"), ("rotor speed", "rpm"))
    measured.samples[1:3, 1] = np.nan
    apart = with_rotor_speed_apart(measured)
    assert apart.rotor_speed is not None
    assert np.isfinite(apart.rotor_speed).all()
