"""A description from a turbine in WindIO (YAML, version 2): tower and monopile, drivetrain, blades.

Stations of the outer diameter and of the wall's layers become tubes with their means; layers of
one material are one wall, whose density is multiplied by the outfitting factor. Cross-sectional
stiffness of a blade is in its own axes: K44 bending along the chord, K55 across it. Source: windIO
2 turbine schema.
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
from sensors.structure.decks.stations import edges_of, joined, mean_between
from sensors.structure.description import LONGEST_ELEMENT, TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError

UNCOVERED = 1e-3  # of the height, that a layer may begin or end inside of it [-]
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
        If the file cannot be read, is another kind of file, has walls of several materials, or
        has a monopile and no mudline is given.
    """
    turbine = _loaded(path)
    try:
        return _description(turbine, springs, mudline, path)
    except TurbineError:
        raise
    except KeyError as error:
        raise TurbineError(f"{path}: no turbine of WindIO 2: {error} is missing") from error
    except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError) as error:
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
    components = turbine["components"]
    if "outer_shape_bem" in components["tower"]:
        raise TurbineError(f"{path} is of WindIO 1; windIO's converter makes version 2 of it")
    if other := [name for name in NOT_ONE_TOWER if name in components]:
        raise TurbineError(f"{path} has a {other[0]}; a description is one tower on its springs")
    top = float(components["tower"]["reference_axis"]["z"]["values"][-1])
    masses: tuple[PointMass, ...] = ()
    pile: tuple[Tube, ...] = ()
    if "monopile" in components:
        if mudline is None:
            raise TurbineError(
                f"{path} has a monopile: where it is cut is missing, --mudline METRES"
            )
        pile = _above(_tubes(turbine, "monopile", path, top=top, mudline=mudline), mudline)
    lowest = mudline if pile else None
    tubes = _tubes(turbine, "tower", path, top=top, mudline=lowest)
    base = tubes[0].bottom
    if pile:
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


def _tubes(
    turbine: Any, name: str, path: Path, *, top: float, mudline: float | None = None
) -> tuple[Tube, ...]:
    """Tubes of a component between all stations that its axis, diameter and layers have.

    Each of these tables has a grid of its own. A taper is cut to the length of an element of the
    structure that ends at `top`, and where the mudline is.
    """
    component = turbine["components"][name]
    axis = component["reference_axis"]["z"]
    heights, grid = _column(axis, "values"), _column(axis, "grid")
    if not (np.all(np.diff(heights) > 0) and np.all(np.diff(grid) > 0)):
        raise TurbineError(
            f"{path}: z of the {name}'s reference_axis is {heights.tolist()} m on the grid "
            f"{grid.tolist()}; both must ascend"
        )
    layers = _layers(turbine, name, path)
    diameter = component["outer_shape"]["outer_diameter"]
    _require_stations(diameter, f"{path}: outer_diameter of the {name}")
    material = _material(turbine, layers[0]["material"], f"{path}: the {name}")
    density = float(component["structure"].get("outfitting_factor", 1.0)) * float(material["rho"])
    tables = [diameter, *(layer["thickness"] for layer in layers)]
    cut = [] if mudline is None or not heights[0] < mudline < heights[-1] else [mudline]
    places = [np.interp(_column(table, "grid"), grid, heights).tolist() for table in tables]
    stations = joined([heights[0], heights[-1], *cut], heights[1:-1].tolist(), *places)
    lowest = heights[0] if mudline is None else mudline

    def mean(table: Any, low: float, high: float) -> float:
        at = np.interp(_column(table, "grid"), grid, heights)
        return mean_between(at, _column(table, "values"), low, high)

    return tuple(
        Tube(
            bottom=low,
            top=high,
            diameter=mean(diameter, low, high),
            thickness=sum(mean(layer["thickness"], low, high) for layer in layers),
            youngs_modulus=float(material["E"]),
            density=density,
        )
        for low, high in pairwise(edges_of(stations, LONGEST_ELEMENT * (top - lowest)))
    )


def _layers(turbine: Any, name: str, path: Path) -> list[Any]:
    """Layers of a wall, all of one material and over the whole height."""
    layers = list(turbine["components"][name]["structure"]["layers"])
    if not layers:
        raise TurbineError(f"{path}: the {name} has no layers; a wall has one or more")
    names = [str(layer.get("name", f"layer {n}")) for n, layer in enumerate(layers, start=1)]
    if len({layer["material"] for layer in layers}) > 1:
        those = ", ".join(
            f"{each} of {layer['material']}" for each, layer in zip(names, layers, strict=True)
        )
        raise TurbineError(
            f"{path}: the {name} has {those}; a tube is of one material: state one layer of the "
            "same EI and mass"
        )
    for each, layer in zip(names, layers, strict=True):
        _require_stations(layer["thickness"], f"{path}: thickness of {each} of the {name}")
        grid = _column(layer["thickness"], "grid")
        if grid[0] > UNCOVERED or grid[-1] < 1 - UNCOVERED:
            raise TurbineError(
                f"{path}: thickness of {each} of the {name} is stated from {grid[0]:g} to "
                f"{grid[-1]:g}; its grid begins at 0 and ends at 1"
            )
    return layers


def _require_stations(table: Any, what: str) -> None:
    """Raise TurbineError unless a table has a value a station, the stations in ascending order."""
    grid, values = _column(table, "grid"), _column(table, "values")
    if len(grid) != len(values) or np.any(np.diff(grid) < 0):
        raise TurbineError(
            f"{what} has {len(values)} values on the grid {grid.tolist()}; each station has one, "
            "and stations ascend"
        )


def _material(turbine: Any, name: str, where: str) -> Any:
    for each in turbine["materials"]:
        if each["name"] == name:
            return each
    known = ", ".join(str(each["name"]) for each in turbine["materials"])
    raise TurbineError(f"{where} is of {name!r}, which is not in materials: {known}")


def _column(table: Any, key: str) -> FloatArray:
    return np.array(table[key], dtype=np.float64)


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
        numbers = _column(table, key) ** power
        return mean_between(_column(table, "grid"), numbers, low, high) ** power

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
