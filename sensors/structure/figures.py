"""Figures of a structure that are never known exactly: what each is, how far off it may be.

Every figure has a departure from the description, 0 as described: relative ones as a share, the
others in their unit. `varied` gives the description with such departures; `figure_model` gives the
modes for many of them at once.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from sensors.structure.components import BladeElement, PointMass, RigidBody, Tube, Vector, Water
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import TurbineError

FigureChange = Callable[[TurbineDescription, float], TurbineDescription]
Distribution = Literal["normal", "half-normal"]

JUDGEMENT = "engineering judgement"  # of a prior whose width no source states
# engineering judgement, all: gauge, waves and distance to it; the tide of an open coast; with the
# tide, 1 m for what the described depth is measured from, mean sea level or a chart's datum
KNOWN_LEVEL_STD = 0.1  # of a sea level that SCADA reports [m]
TIDE_STD = 1.0  # of one that no sensor reports, from window to window [m]
UNKNOWN_LEVEL_STD = 1.4  # of the mean of one that no sensor reports [m]
LEVEL = "water_level"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of the structure, its default prior and where that comes from."""

    name: str
    """Key in `[structure.uncertain]`."""
    title: str
    """Words for reports."""
    unit: str
    """Of the departure; "-" for a share of the described value."""
    std: float
    """Default standard deviation of the prior [unit]; the scale of a half-normal one."""
    distribution: Distribution
    """Half-normal: nothing of it is described, and there cannot be less."""
    source: str
    """Where the standard deviation comes from; JUDGEMENT where no source states it."""
    change: FigureChange
    """The description with a departure of so much."""
    present: Callable[[TurbineDescription], bool]
    """Whether the structure has such a figure."""


def _tubes(change: Callable[[Tube, float], Tube]) -> FigureChange:
    def changed(turbine: TurbineDescription, departure: float) -> TurbineDescription:
        return replace(turbine, tubes=tuple(change(tube, departure) for tube in turbine.tubes))

    return changed


def _blades(change: Callable[[BladeElement, float], BladeElement]) -> FigureChange:
    def changed(turbine: TurbineDescription, departure: float) -> TurbineDescription:
        if turbine.blades is None:
            return turbine
        elements = tuple(change(element, departure) for element in turbine.blades.elements)
        return replace(turbine, blades=replace(turbine.blades, elements=elements))

    return changed


def _bodies(change: Callable[[RigidBody, float], RigidBody]) -> FigureChange:
    def changed(turbine: TurbineDescription, departure: float) -> TurbineDescription:
        nacelle = turbine.rotor_nacelle
        bodies = tuple(change(body.about_centre, departure) for body in nacelle.bodies)
        return replace(turbine, rotor_nacelle=replace(nacelle, bodies=bodies))

    return changed


def _water(change: Callable[[Water, float], Water]) -> FigureChange:
    def changed(turbine: TurbineDescription, departure: float) -> TurbineDescription:
        assert turbine.water is not None
        return replace(turbine, water=change(turbine.water, departure))

    return changed


def _inertia(axis: int) -> FigureChange:
    def scaled(body: RigidBody, departure: float) -> RigidBody:
        x, y, z = (i * (1 + departure * (n == axis)) for n, i in enumerate(body.inertia))
        return replace(body, inertia=(x, y, z))

    return _bodies(scaled)


def _rna_mass(turbine: TurbineDescription, departure: float) -> TurbineDescription:
    heavier = _bodies(lambda body, d: replace(body, mass=body.mass * (1 + d)))(turbine, departure)
    nacelle = heavier.rotor_nacelle
    hub = nacelle.hub_mass * (1 + departure)
    return replace(heavier, rotor_nacelle=replace(nacelle, hub_mass=hub))


def _rna_height(turbine: TurbineDescription, departure: float) -> TurbineDescription:
    def raised(body: RigidBody, d: float) -> RigidBody:
        x, y, z = body.centre
        centre: Vector = (x, y, z + d)
        return replace(body, centre=centre) if any(body.inertia) else body

    return _bodies(raised)(turbine, departure)


def _point_masses(turbine: TurbineDescription, departure: float) -> TurbineDescription:
    attached = _tubes(lambda t, d: replace(t, attached_mass=t.attached_mass * (1 + d)))
    masses = (replace(each, mass=each.mass * (1 + departure)) for each in turbine.point_masses)
    return replace(attached(turbine, departure), point_masses=tuple(masses))


def _transition_piece(turbine: TurbineDescription, departure: float) -> TurbineDescription:
    assert turbine.transition is not None
    piece = PointMass("transition piece", turbine.transition, departure)
    return replace(turbine, point_masses=(*turbine.point_masses, piece))


def _pile_mass(turbine: TurbineDescription, departure: float) -> TurbineDescription:
    foundation = turbine.foundation
    heavier = replace(foundation, moving_mass=(foundation.moving_mass or 0.0) * (1 + departure))
    return replace(turbine, foundation=heavier)


def _always(_: TurbineDescription) -> bool:
    return True


def _has_water(turbine: TurbineDescription) -> bool:
    return turbine.water is not None


def _has_blades(turbine: TurbineDescription) -> bool:
    return turbine.blades is not None


def _has_inertia(axis: int) -> Callable[[TurbineDescription], bool]:
    return lambda turbine: any(body.inertia[axis] > 0 for body in turbine.rotor_nacelle.bodies)


def _has_bodies(turbine: TurbineDescription) -> bool:
    return bool(turbine.rotor_nacelle.bodies) or turbine.rotor_nacelle.hub_mass > 0


def _has_masses(turbine: TurbineDescription) -> bool:
    on_it = [each.mass for each in turbine.point_masses]
    return any((*on_it, *(tube.attached_mass for tube in turbine.tubes)))


def _has_transition(turbine: TurbineDescription) -> bool:
    return turbine.transition is not None


FIGURES: tuple[Figure, ...] = (
    Figure(
        "steel_modulus", "Young's modulus of the tubes", "-", 0.01, "normal",
        "EN 1993-1-1, 3.2.6 for 210 GPa; that plates averaged over a tower scatter by 1 %: "
        f"{JUDGEMENT}",
        _tubes(lambda t, d: replace(t, youngs_modulus=t.youngs_modulus * (1 + d))), _always,
    ),
    Figure(
        "wall_thickness", "wall of the tubes, outer diameter kept", "-", 0.01, "normal",
        "EN 10029 class B, table 1: -.3 to +2.5 mm of a 40 to 80 mm plate; that the cans' mean "
        f"scatters by 1 %: {JUDGEMENT}",
        _tubes(lambda t, d: replace(t, thickness=t.thickness * (1 + d))), _always,
    ),
    Figure(
        "steel_density", "density of the tubes with paint and bolts", "-", 0.01, "normal",
        f"secondary steel and coating, counted into 8500 kg/m³ by rule of thumb: {JUDGEMENT}",
        _tubes(lambda t, d: replace(t, density=t.density * (1 + d))), _always,
    ),
    Figure(
        "rna_mass", "mass of nacelle, hub and yaw bearing", "-", 0.02, "normal",
        f"weighing certificates and what is added on site: {JUDGEMENT}", _rna_mass, _has_bodies,
    ),
    Figure(
        "rna_height", "height of the nacelle's centre of mass", "m", 0.05, "normal",
        f"drawings; 1 % of the nacelle's height: {JUDGEMENT}", _rna_height,
        lambda turbine: turbine.rotor_nacelle.has_inertia,
    ),
    Figure(
        "nacelle_roll_inertia", "nacelle's moment of inertia about the fore-aft axis", "-",
        0.2, "normal", "version 1.1 of the IEA 15 MW definition has 31 % more than what follows "
        f"from the yaw inertia of version 1.0; two thirds of that: {JUDGEMENT}",
        _inertia(0), _has_inertia(0),
    ),
    Figure(
        "nacelle_pitch_inertia", "nacelle's moment of inertia about the side-side axis", "-",
        0.2, "normal", "as the roll inertia", _inertia(1), _has_inertia(1),
    ),
    Figure(
        "nacelle_yaw_inertia", "nacelle's moment of inertia about the vertical", "-",
        0.2, "normal", "as the roll inertia", _inertia(2), _has_inertia(2),
    ),
    Figure(
        "blade_mass", "mass of the blades", "-", 0.02, "normal",
        f"a blade of a class against its drawing: {JUDGEMENT}",
        _blades(lambda e, d: replace(e, mass_per_length=e.mass_per_length * (1 + d))), _has_blades,
    ),
    Figure(
        "flap_stiffness", "flapwise rigidity of the blades", "-", 0.05, "normal",
        f"a tested blade against its design: {JUDGEMENT}",
        _blades(lambda e, d: replace(e, flapwise_rigidity=e.flapwise_rigidity * (1 + d))),
        _has_blades,
    ),
    Figure(
        "edge_stiffness", "edgewise rigidity of the blades", "-", 0.05, "normal",
        "as the flapwise rigidity",
        _blades(lambda e, d: replace(e, edgewise_rigidity=e.edgewise_rigidity * (1 + d))),
        _has_blades,
    ),
    Figure(
        "added_mass", "coefficient of the water that moves along", "-", 0.15, "normal",
        "DNV-RP-C205, 6.9 for C_a = 1 at small motions, less at large ones; its spread by waves "
        f"and the surface: {JUDGEMENT}",
        _water(lambda w, d: replace(w, added_mass_coefficient=w.added_mass_coefficient * (1 + d))),
        _has_water,
    ),
    Figure(
        "marine_growth", "thickness of marine growth below the mean sea level", "m", 0.03,
        "half-normal", f"design standards take 50 to 150 mm at the end of life: {JUDGEMENT}",
        _water(lambda w, d: replace(w, growth=w.growth + d)), _has_water,
    ),
    Figure(
        "point_masses", "masses on the tower that are described", "-", 0.1, "normal",
        "drawings of a transition piece with its platform, boat landing and grout: "
        f"{JUDGEMENT}", _point_masses, _has_masses,
    ),
    Figure(
        "transition_piece", "mass at the top of the monopile", "kg", 150e3, "half-normal",
        "100 t in the IEA 15 MW definition, version 1.1; flange, platform, boat landing and grout "
        f"of others up to 400 t: {JUDGEMENT}",
        _transition_piece, _has_transition,
    ),
    Figure(
        "pile_mass", "mass of pile and soil that moves below the mudline", "-", 0.3, "normal",
        f"what part of the soil moves with the pile: {JUDGEMENT}", _pile_mass,
        lambda turbine: bool(turbine.foundation.moving_mass),
    ),
)  # fmt: skip
BY_NAME: Mapping[str, Figure] = {figure.name: figure for figure in FIGURES}


def figures_of(turbine: TurbineDescription) -> tuple[Figure, ...]:
    """The figures that a structure has: one on land has no added mass."""
    return tuple(figure for figure in FIGURES if figure.present(turbine))


def varied(turbine: TurbineDescription, departures: Mapping[str, float]) -> TurbineDescription:
    """The same turbine with some figures off.

    Parameters
    ----------
    turbine : TurbineDescription
        As described.
    departures : mapping of str to float
        By name, each in its figure's unit; `water_level` in metres.

    Raises
    ------
    TurbineError
        If there is no such figure, or the turbine does not have it.
    """
    for name, departure in departures.items():
        if name == LEVEL and turbine.water is not None:
            turbine = turbine.with_water_level(turbine.water.level + departure)
        elif name not in BY_NAME or not BY_NAME[name].present(turbine):
            known = ", ".join(figure.name for figure in figures_of(turbine))
            raise TurbineError(f"{turbine.name} has no figure {name!r}; it has {known}")
        elif departure != 0.0:
            turbine = BY_NAME[name].change(turbine, departure)
    return turbine
