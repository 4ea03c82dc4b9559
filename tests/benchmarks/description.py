"""The shipped description mode by mode: the product's code, the outside model's and pyBModes'.

    python -m tests.benchmarks description [--sign published|embedded-pile] [--keep]

tower    monopile and tower on their springs under one rigid body (1016.6 t at +4.2 m, 2e8 kg·m²),
         water to +1.5 m, no weight: what pyBModes can describe without a rotor
turbine  the whole parked turbine, every mode below 12.5 Hz. `shipped` as the updater has it;
         `outside` with the same blade (one inner shape an element); `converged` with elements
         enough; `twice` the shipped one with two tubes for one and two blade modes for one;
         `roll` the outside one with the nacelle inertias of version 1.1

Differences are in % of the shipped frequency. pyBModes comes with the extra `bench`.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import full_modes
from sensors.structure.components import RigidBody, RotorNacelle
from sensors.structure.description import TurbineDescription, load_turbine
from tests.benchmarks._results import keep
from tests.outside import sections as iea
from tests.outside.figures import Figures
from tests.outside.model import NOMINAL, Modes, SpringSign, assemble, converged, modes
from tests.outside.peers import LUMPED_TOP, lumped_description, pybmodes_frequencies

HIGHEST_FREQUENCY = 12.5  # [Hz]
WATER_LEVEL = 1.5  # of the tower alone: the edge of a tube [m]
LAYOUT = biaxial_layout(
    "description", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
# version 1.1 of the definition, documentation workbook, "Nacelle Mass Properties", above the yaw
# bearing, about its centre of mass, generator rotor included: roll, pitch, yaw [kg·m²]
NACELLE_VERSION_1_1 = (9474045.437, 10608608.723, 10536262.58)


def main(arguments: list[str]) -> None:
    """Print both tables; write them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks description")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--keep", action="store_true", help="write the result")
    chosen = parser.parse_args(arguments)
    tables = {"tower": tower_table(chosen.sign), "turbine": turbine_table(chosen.sign)}
    for name, rows in tables.items():
        print(f"\n{name}, {chosen.sign}")
        print_table(rows)
    if chosen.keep:
        keep(
            f"description-{chosen.sign}",
            {"sign": chosen.sign, **rounded(tables)},
            command=f"python -m tests.benchmarks description --sign {chosen.sign} --keep",
            depends=["sensors/structure", "sensors/dynamics", "tests/outside"],
        )


def tower_table(sign: SpringSign) -> list[dict[str, float | str]]:
    """Bending modes of the tower under a rigid body."""
    mass, height, inertia = LUMPED_TOP
    top = RigidBody("top", mass=mass, centre=(0.0, 0.0, height), inertia=(inertia,) * 3)
    described = replace(
        shipped(sign).with_water_level(WATER_LEVEL),
        gravity=0.0,
        blades=None,
        rotor_nacelle=RotorNacelle(bodies=(top,)),
        reference_modes=(),
    )
    figures = replace(Figures(), water_level=WATER_LEVEL)
    outside = assemble(figures, lumped_description()).modes(NOMINAL, sign).frequencies
    others = {"outside": outside}
    try:
        import pybmodes
    except ImportError:
        print("pyBModes is not installed: pip install pilewatch[bench]")
    else:
        others["pyBModes"] = pybmodes_frequencies(
            pybmodes, lumped_description(), NOMINAL, sign, water_level=WATER_LEVEL
        )
    own = full_modes(described, LAYOUT, NOMINAL, highest_frequency=HIGHEST_FREQUENCY).frequencies
    bending = own[np.append(False, np.diff(own) < 1e-5 * own[1:])]  # two planes alike
    rows: list[dict[str, float | str]] = []
    for frequency in bending:
        row: dict[str, float | str] = {"mode": str(len(rows) + 1), "shipped": float(frequency)}
        for name, found in others.items():
            nearest = float(found[np.argmin(np.abs(found / frequency - 1))])
            row[name] = nearest
            row[f"{name} %"] = 100 * (nearest / float(frequency) - 1)
        rows.append(row)
    return rows


def turbine_table(sign: SpringSign) -> list[dict[str, float | str]]:
    """Every mode of the whole turbine."""
    own = full_modes(shipped(sign), LAYOUT, NOMINAL, highest_frequency=HIGHEST_FREQUENCY)
    blades = shipped(sign).blades
    assert blades is not None
    finer = replace(shipped(sign).refined(2), blades=replace(blades, modes_per_element=2))
    twice = full_modes(finer, LAYOUT, NOMINAL, highest_frequency=HIGHEST_FREQUENCY + 0.5)
    roll, pitch, yaw = (each / iea.NACELLE_INERTIA for each in NACELLE_VERSION_1_1)
    heavier = replace(
        Figures(),
        nacelle_roll_inertia=roll,
        nacelle_pitch_inertia=pitch,
        nacelle_yaw_inertia=yaw,
    )
    others: dict[str, tuple[FloatArray, FloatArray]] = {
        "outside": seen(modes(sign=sign)),
        "converged": seen(modes(sign=sign, description=converged())),
        "twice": (twice.frequencies, twice.shapes),
        "roll": seen(modes(figures=heavier, sign=sign)),
    }
    rows: list[dict[str, float | str]] = [
        {"mode": f"{number + 1} {direction}", "shipped": float(frequency)}
        for number, (frequency, direction) in enumerate(
            zip(own.frequencies, own.directions, strict=True)
        )
    ]
    for name, (frequencies, shapes) in others.items():
        partners = paired(own.frequencies, own.shapes, frequencies, shapes)
        for row, partner, frequency in zip(rows, partners, own.frequencies, strict=True):
            row[name] = float(frequencies[partner])
            row[f"{name} %"] = 100 * float(frequencies[partner] / frequency - 1)
    return rows


def shipped(sign: SpringSign) -> TurbineDescription:
    """The description that the updater has."""
    return load_turbine("iea15mw_monopile").with_sign(sign)


def seen(found: Modes) -> tuple[FloatArray, FloatArray]:
    """Frequencies and what the layout reads of the shapes."""
    return found.frequencies, found.readings(LAYOUT)


def paired(
    frequencies: FloatArray, shapes: FloatArray, others: FloatArray, other_shapes: FloatArray
) -> NDArray[np.intp]:
    """For each mode the other list's, one to one, by frequency and modal assurance criterion."""
    products = (shapes @ other_shapes.T) ** 2
    mac = products / np.outer((shapes**2).sum(axis=1), (other_shapes**2).sum(axis=1))
    distance = np.abs(np.log(frequencies[:, None] / others)) / 0.01 + (1 - mac) / 0.1
    return np.asarray(linear_sum_assignment(distance)[1])


def rounded(
    tables: Mapping[str, list[dict[str, float | str]]],
) -> dict[str, list[dict[str, float | str]]]:
    """To 1e-6 Hz and 1e-4 %: what is below differs between machines."""
    return {
        name: [
            {
                key: value if isinstance(value, str) else round(value, 4 if "%" in key else 6) + 0.0
                for key, value in row.items()
            }
            for row in rows
        ]
        for name, rows in tables.items()
    }


def print_table(rows: Sequence[Mapping[str, float | str]]) -> None:
    """Frequencies of the first column, differences of the others."""
    names = [key for key in rows[0] if key.endswith("%")]
    print(f"{'mode':8s}{'shipped Hz':>12s}" + "".join(f"{name:>14s}" for name in names))
    for row in rows:
        differences = "".join(f"{row[name]:14.4f}" for name in names)
        print(f"{row['mode']:8s}{row['shipped']:12.4f}{differences}")
