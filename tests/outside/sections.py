"""The IEA 15 MW turbine's figures as its definition tabulates them, and sections made of them.

Source: IEAWindTask37/IEA-15-240-RWT (Apache-2.0). Cans of monopile and tower: commit 6b3fd8a,
WT_Ontology. Blade and rotor-nacelle: commit 179c0e5 (version 1.0, NREL/TP-5000-75698),
OpenFAST/ElastoDyn. Moduli and densities: [foundation-updating] section 3.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sensors.arrays import FloatArray

GRAVITY = 9.81  # [m/s²]
WATER_DENSITY = 1025.0  # [kg/m³]
GROWTH_DENSITY = 1325.0  # of marine growth, DNV-ST-0437 [kg/m³]
YOUNGS_MODULUS = 210e9  # [Pa]
POISSON_RATIO = 0.3  # [-]
MONOPILE_DENSITY, TOWER_DENSITY = 7850.0, 8500.0  # [kg/m³]
MUDLINE, TRANSITION, TOWER_TOP = -30.0, 15.0, 145.0  # above mean sea level [m]

HUB_MASS, HUB_INERTIA = 190000.0, 1373471.226  # [kg], about the shaft [kg·m²]
YAW_BEARING_MASS = 100000.0  # [kg]
NACELLE_MASS = 530887.918  # [kg]
NACELLE_CENTRE = (-4.688, 0.0, 4.240)  # from the tower's top [m]
YAW_AXIS_INERTIA = 18886965.482  # of the nacelle about the yaw axis [kg·m²]
# version 1.0 states no other moment: roll and pitch about the centre are set equal to yaw's
NACELLE_INERTIA = YAW_AXIS_INERTIA - NACELLE_MASS * NACELLE_CENTRE[0] ** 2  # [kg·m²]
OVERHANG, TOWER_TO_SHAFT = -11.075, 4.3478  # [m]
TILT, CONE, PITCH = 6.0, 4.0, 90.0  # parked, blades feathered [deg]
HUB_RADIUS, BLADE_LENGTH = 3.0, 117.0  # [m]

# bottom, top [m], outer diameter at both [m], wall [m]
MONOPILE_CANS = (
    (-30.0, -25.0, 10.0, 10.0, 0.055341),
    (-25.0, -20.0, 10.0, 10.0, 0.053449),
    (-20.0, -15.0, 10.0, 10.0, 0.051509),
    (-15.0, -10.0, 10.0, 10.0, 0.049527),
    (-10.0, -5.0, 10.0, 10.0, 0.047517),
    (-5.0, 0.0, 10.0, 10.0, 0.045517),
    (0.0, 5.0, 10.0, 10.0, 0.043527),
    (5.0, 10.0, 10.0, 10.0, 0.042242),
    (10.0, 15.0, 10.0, 10.0, 0.041058),
)
TOWER_CANS = (  # the last one is stretched from 144.386 m to the tower's top
    (15.0, 28.0, 10.0, 10.0, 0.039496),
    (28.0, 41.0, 10.0, 9.926, 0.036456),
    (41.0, 54.0, 9.926, 9.443, 0.033779),
    (54.0, 67.0, 9.443, 8.833, 0.032192),
    (67.0, 80.0, 8.833, 8.151, 0.030708),
    (80.0, 93.0, 8.151, 7.39, 0.029101),
    (93.0, 106.0, 7.39, 6.909, 0.027213),
    (106.0, 119.0, 6.909, 6.748, 0.024009),
    (119.0, 132.0, 6.748, 6.572, 0.020826),
    (132.0, 145.0, 6.572, 6.5, 0.023998),
)
# the paper's ten lengths of each: bottom, top, mean outer diameter, mean wall [m]
AVERAGED_TUBES = (
    (-30.0, -25.5, 10.0, 0.055341),
    (-25.5, -21.0, 10.0, 0.0536382),
    (-21.0, -16.5, 10.0, 0.0519455),
    (-16.5, -12.0, 10.0, 0.0501711),
    (-12.0, -7.5, 10.0, 0.0484215),
    (-7.5, -3.0, 10.0, 0.046617),
    (-3.0, 1.5, 10.0, 0.0448703),
    (1.5, 6.0, 10.0, 0.0432379),
    (6.0, 10.5, 10.0, 0.0421236),
    (10.5, 15.0, 10.0, 0.041058),
    (15.0, 28.0, 10.0, 0.039496),
    (28.0, 41.0, 9.963, 0.036456),
    (41.0, 54.0, 9.68452, 0.033779),
    (54.0, 67.0, 9.13802, 0.032192),
    (67.0, 80.0, 8.49203, 0.030708),
    (80.0, 93.0, 7.77053, 0.029101),
    (93.0, 106.0, 7.14952, 0.027213),
    (106.0, 119.0, 6.82851, 0.024009),
    (119.0, 132.0, 6.66001, 0.020826),
    (132.0, 145.0, 6.536, 0.023998),
)
# the paper's six lengths of a blade: inner, outer [m], mean mass [kg/m], EI flap, EI edge [N·m²]
AVERAGED_BLADE = (
    (0.0, 19.5, 1895.77, 8.33286e10, 8.62336e10),
    (19.5, 39.0, 530.848, 1.8796e10, 2.24323e10),
    (39.0, 58.5, 402.991, 8.76344e9, 1.43699e10),
    (58.5, 78.0, 295.495, 3.30736e9, 5.23851e9),
    (78.0, 97.5, 176.583, 9.22126e8, 1.64777e9),
    (97.5, 117.0, 45.6946, 1.07507e8, 2.94808e8),
)
# share of the length [-], mass [kg/m], rigidity flapwise and edgewise [N·m²], twist [deg]
BLADE_STATIONS = (
    (0, 3179.06, 1.52534e11, 1.52409e11, 15.595),
    (0.02, 2844.64, 1.39606e11, 1.37191e11, 15.591),
    (0.04, 2505.35, 1.23976e11, 1.21194e11, 15.428),
    (0.06, 2150.18, 1.03226e11, 1.03064e11, 14.987),
    (0.08, 1807.17, 8.16284e10, 8.43658e10, 14.322),
    (0.1, 1689.75, 6.17753e10, 6.86266e10, 13.488),
    (0.125, 1296.52, 4.27472e10, 5.13466e10, 12.291),
    (0.15, 982.268, 3.2373e10, 3.89854e10, 11.022),
    (0.169034, 796.616, 2.82729e10, 3.19526e10, 10.075),
    (0.188068, 664.504, 2.48185e10, 2.69585e10, 9.1945),
    (0.207102, 576.484, 2.19561e10, 2.37609e10, 8.4292),
    (0.226136, 525.018, 1.96714e10, 2.20847e10, 7.7771),
    (0.24517, 492.536, 1.80522e10, 2.10661e10, 7.1825),
    (0.266089, 467.118, 1.67184e10, 2.03522e10, 6.527),
    (0.287007, 452.689, 1.54504e10, 1.99622e10, 5.895),
    (0.307926, 447.898, 1.42526e10, 1.97128e10, 5.2942),
    (0.328844, 443.45, 1.30125e10, 1.91352e10, 4.7345),
    (0.350911, 438.399, 1.17714e10, 1.83091e10, 4.2005),
    (0.372978, 430.387, 1.06308e10, 1.72665e10, 3.7259),
    (0.395045, 419.952, 9.61289e09, 1.60587e10, 3.307),
    (0.417112, 407.726, 8.63222e09, 1.47031e10, 2.92),
    (0.439179, 392.444, 7.67016e09, 1.30645e10, 2.561),
    (0.458878, 378.15, 6.85024e09, 1.16176e10, 2.262),
    (0.478576, 363.569, 6.08052e09, 1.02313e10, 1.9803),
    (0.498275, 349.215, 5.37722e09, 8.95722e09, 1.7136),
    (0.517973, 336.007, 4.75363e09, 7.8812e09, 1.458),
    (0.537671, 323.613, 4.20822e09, 6.9454e09, 1.2156),
    (0.557779, 311.172, 3.71876e09, 6.04854e09, 0.98789),
    (0.577886, 298.72, 3.27883e09, 5.21394e09, 0.77515),
    (0.597993, 286.163, 2.88553e09, 4.43684e09, 0.57538),
    (0.6181, 273.713, 2.53367e09, 3.75943e09, 0.38019),
    (0.638208, 261.465, 2.22054e09, 3.19191e09, 0.18599),
    (0.657284, 250.084, 1.94428e09, 2.76029e09, -0.0018951),
    (0.676361, 238.857, 1.67974e09, 2.45513e09, -0.20329),
    (0.695437, 227.158, 1.43378e09, 2.23255e09, -0.42529),
    (0.714514, 213.153, 1.20642e09, 2.02423e09, -0.68354),
    (0.733591, 195.824, 9.96613e08, 1.81398e09, -0.98187),
    (0.752667, 177.327, 8.17142e08, 1.60881e09, -1.2832),
    (0.771744, 158.048, 6.65043e08, 1.40985e09, -1.5752),
    (0.8, 130.808, 4.76315e08, 1.14041e09, -1.9369),
    (0.81875, 108.073, 3.71314e08, 8.70063e08, -2.1076),
    (0.8375, 91.5094, 2.89387e08, 7.04191e08, -2.1666),
    (0.85625, 76.0709, 2.26413e08, 5.50743e08, -2.1761),
    (0.875, 62.9254, 1.72314e08, 4.30148e08, -2.1612),
    (0.89375, 52.4205, 1.27011e08, 3.40101e08, -2.1185),
    (0.9125, 43.9152, 8.93412e07, 2.6969e08, -2.0489),
    (0.93125, 36.5739, 5.91921e07, 2.08348e08, -1.9514),
    (0.95, 30.0136, 3.61864e07, 1.51878e08, -1.8152),
    (0.975, 21.3325, 1.56357e07, 8.89372e07, -1.5679),
    (1, 5.40797, 188846, 1.92069e06, -1.2424),
)


@dataclass(frozen=True, slots=True)
class Can:
    """A tube whose diameter varies linearly."""

    bottom: float
    """[m]"""
    top: float
    """[m]"""
    diameters: tuple[float, float]
    """Outer, at bottom and top [m]."""
    thickness: float
    """[m]"""
    density: float
    """[kg/m³]"""

    def diameter(self, z: FloatArray) -> FloatArray:
        """Outer diameter at elevations [m]."""
        return np.interp(z, (self.bottom, self.top), self.diameters)


def tapered_cans() -> tuple[Can, ...]:
    """Monopile and tower as the definition's cans."""
    return tuple(
        Can(bottom, top, (lower, upper), wall, density)
        for cans, density in ((MONOPILE_CANS, MONOPILE_DENSITY), (TOWER_CANS, TOWER_DENSITY))
        for bottom, top, lower, upper, wall in cans
    )


def averaged_cans() -> tuple[Can, ...]:
    """Ten uniform tubes of the monopile and ten of the tower."""
    return tuple(
        Can(
            *(bottom, top),
            diameters=(diameter, diameter),
            thickness=wall,
            density=TOWER_DENSITY if bottom >= TRANSITION else MONOPILE_DENSITY,
        )
        for bottom, top, diameter, wall in AVERAGED_TUBES
    )


@dataclass(frozen=True, slots=True, eq=False)
class BladeSection:
    """A length of a blade between two distances from its root."""

    inner: float
    """[m]"""
    outer: float
    """[m]"""
    stations: FloatArray
    """(n, 5): distance [m], mass [kg/m], flapwise, edgewise rigidity [N·m²], twist [deg]."""

    def at(self, s: FloatArray) -> FloatArray:
        """(3, n): mass per length, flapwise and edgewise rigidity at distances s."""
        return np.stack([np.interp(s, self.stations[:, 0], self.stations[:, i]) for i in (1, 2, 3)])

    @property
    def twist(self) -> float:
        """Of its middle [deg]."""
        middle = (self.inner + self.outer) / 2
        return float(np.interp(middle, self.stations[:, 0], self.stations[:, 4]))


def averaged_blade(cut: int = 2) -> tuple[BladeSection, ...]:
    """Six uniform lengths without twist, each cut into so many equal elements."""
    found = []
    for low, high, *values in AVERAGED_BLADE:
        uniform = np.array([[low, *values, 0.0], [high, *values, 0.0]])
        edges = np.linspace(low, high, cut + 1).tolist()
        found += [BladeSection(inner, outer, uniform) for inner, outer in pairwise(edges)]
    return tuple(found)


def distributed_blade(elements: int = 12) -> tuple[BladeSection, ...]:
    """The blade as tabulated, with its structural twist."""
    edges = np.linspace(0.0, BLADE_LENGTH, elements + 1).tolist()
    return tuple(BladeSection(inner, outer, _stations()) for inner, outer in pairwise(edges))


def _stations() -> FloatArray:
    stations = np.array(BLADE_STATIONS)
    stations[:, 0] *= BLADE_LENGTH
    return stations
