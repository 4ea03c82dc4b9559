"""A description from a turbine in WindIO (YAML, version 2): tower and monopile, drivetrain, blades.

Stations of the outer diameter and the wall become tubes with their means; the wall's density is
multiplied by the outfitting factor. Cross-sectional stiffness of a blade is in its own axes: K44
bending along the chord, K55 across it. Source: windIO 2 turbine schema.
"""

import importlib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sensors.arrays import FloatArray
from sensors.structure.components import (
    BladeElement,
    Blades,
    PointMass,
    RigidBody,
    RotorNacelle,
    Tube,
    Water,
)
from sensors.structure.decks.elastodyn import BLADE_ELEMENTS, FEATHERED_PITCH
from sensors.structure.decks.stations import mean_between
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError

NOT_ONE_TOWER = ("floating_platform", "jacket", "mooring")  # components of other substructures


def read_windio(
    path: Path, springs: FoundationSprings, *, mudline: float | None = None
) -> TurbineDescription:
    """Return the turbine of a WindIO file, parked with feathered blades.

    Parameters
    ----------
    path : Path
        A YAML file.
    springs : FoundationSprings
        At the mudline: the file has none.
    mudline : float, optional
        Elevation at which the monopile is cut [m]: below it is the foundation.

    Raises
    ------
    TurbineError
        If the file cannot be read, is another kind of file, or has a monopile and no mudline is
        given.
    """
    turbine = _loaded(path)
    try:
        return _description(turbine, springs, mudline, path)
    except TurbineError:
        raise
    except KeyError as error:
        raise TurbineError(f"{path}: no turbine of WindIO 2: {error} is missing") from error
    except (IndexError, TypeError, ValueError) as error:
        raise TurbineError(f"{path}: no turbine of WindIO 2: {error}") from error


def _loaded(path: Path) -> Any:
    try:
        yaml = importlib.import_module("yaml")
    except ImportError:
        raise TurbineError(f"{path}: YAML needs pyyaml: pip install 'pilewatch[windio]'") from None
    try:
        return yaml.safe_load(path.read_text("utf-8"))
    except OSError as error:
        raise TurbineError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise TurbineError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error


def _description(
    turbine: Any, springs: FoundationSprings, mudline: float | None, path: Path
) -> TurbineDescription:
    components, materials = turbine["components"], turbine["materials"]
    if "outer_shape_bem" in components["tower"]:
        raise TurbineError(f"{path} is of WindIO 1; windIO's converter makes version 2 of it")
    if other := [name for name in NOT_ONE_TOWER if name in components]:
        raise TurbineError(f"{path} has a {other[0]}; a description is one tower on its springs")
    tubes = _tubes(components["tower"], materials)
    masses: tuple[PointMass, ...] = ()
    base = tubes[0].bottom
    pile: tuple[Tube, ...] = ()
    if "monopile" in components:
        if mudline is None:
            raise TurbineError(
                f"{path} has a monopile: where it is cut is missing, --mudline METRES"
            )
        pile = _above(_tubes(components["monopile"], materials), mudline)
        mass = float(components["monopile"].get("transition_piece_mass", 0.0))
        masses = (PointMass("transition piece", base, mass),) if mass > 0 else ()
    return TurbineDescription(
        name=path.stem.replace(" ", "-"),
        title=str(turbine.get("name", path.stem)),
        source=path.name,
        tubes=(*pile, *tubes),
        foundation=springs,
        water=Water() if pile else None,
        rotor_nacelle=_rotor_nacelle(components),
        blades=_blades(turbine),
        point_masses=masses,
        transition=base if pile else None,
    ).meshed()


def _tubes(component: Any, materials: Any) -> tuple[Tube, ...]:
    axis = component["reference_axis"]["z"]
    heights = np.array(axis["values"], dtype=np.float64)
    grid = np.array(axis["grid"], dtype=np.float64)
    (layer,) = component["structure"]["layers"][:1]
    material = next(each for each in materials if each["name"] == layer["material"])
    diameter = _at(component["outer_shape"]["outer_diameter"], grid)
    wall = _at(layer["thickness"], grid)
    outfitting = float(component["structure"].get("outfitting_factor", 1.0))
    middle = [(values[1:] + values[:-1]) / 2 for values in (diameter, wall)]
    return tuple(
        Tube(
            bottom=low,
            top=high,
            diameter=float(middle[0][number]),
            thickness=float(middle[1][number]),
            youngs_modulus=float(material["E"]),
            density=outfitting * float(material["rho"]),
        )
        for number, (low, high) in enumerate(pairwise(heights.tolist()))
    )


def _at(table: Any, grid: FloatArray) -> FloatArray:
    return np.interp(grid, table["grid"], table["values"])


def _above(tubes: tuple[Tube, ...], mudline: float) -> tuple[Tube, ...]:
    """Return what stands above the mudline; the tube that it cuts is shortened."""
    kept = [tube for tube in tubes if tube.top > mudline + 1e-6]
    if not kept or kept[0].bottom > mudline + 1e-6:
        raise TurbineError(
            f"--mudline {mudline:g} m: the monopile is from {tubes[0].bottom:g} to "
            f"{tubes[-1].top:g} m"
        )
    return (replace(kept[0], bottom=mudline), *kept[1:])


def _rotor_nacelle(components: Any) -> RotorNacelle:
    """Drivetrain and yaw system with their elastic properties; the hub at the rotor's apex."""
    shape = components["drivetrain"]["outer_shape"]
    tilt = float(shape["uptilt"])
    along = float(shape["overhang"]) / float(np.cos(np.radians(tilt)))
    hub = components["hub"]["elastic_properties"]
    bodies = []
    for name in ("drivetrain", "yaw"):
        each = components.get(name, {}).get("elastic_properties")
        if each is not None:
            x, y, z = (float(value) for value in each["location"])
            i_x, i_y, i_z = (float(value) for value in each["inertia"][:3])
            xy, xz, yz = [*(float(value) for value in each["inertia"][3:6]), 0.0, 0.0, 0.0][:3]
            moments, products = (i_x, i_y, i_z), (xy, xz, yz)
            bodies.append(RigidBody(name, float(each["mass"]), (x, y, z), moments, products))
    return RotorNacelle(
        bodies=tuple(bodies),
        overhang=-along,
        tower_to_shaft=float(shape["distance_tt_hub"]) - along * float(np.sin(np.radians(tilt))),
        tilt=tilt,
        hub_mass=float(hub["mass"]),
        hub_inertia=float(hub["inertia"][0]),
    )


def _blades(turbine: Any) -> Blades:
    blade, hub = turbine["components"]["blade"], turbine["components"]["hub"]
    elastic = blade["structure"]["elastic_properties"]
    inertia, stiffness = elastic["inertia_matrix"], elastic["stiffness_matrix"]
    values = blade["reference_axis"]["z"]["values"]
    length = float(values[-1]) - float(values[0])
    twist = blade["outer_shape"]["twist"]

    def mean(table: Any, key: str, low: float, high: float, power: int = 1) -> float:
        numbers = np.array(table[key], dtype=np.float64) ** power
        return mean_between(np.array(table["grid"], dtype=np.float64), numbers, low, high) ** power

    edges = np.linspace(0.0, 1.0, BLADE_ELEMENTS + 1).tolist()
    elements = tuple(
        BladeElement(
            inner=low * length,
            outer=high * length,
            mass_per_length=mean(inertia, "mass", low, high),
            flapwise_rigidity=mean(stiffness, "K55", low, high, -1),
            edgewise_rigidity=mean(stiffness, "K44", low, high, -1),
            twist=mean(twist, "values", low, high),
        )
        for low, high in pairwise(edges)
    )
    return Blades(
        number=int(turbine["assembly"]["number_of_blades"]),
        elements=elements,
        hub_radius=float(hub["diameter"]) / 2,
        cone=float(hub["cone_angle"]),
        pitch=FEATHERED_PITCH,
    )
