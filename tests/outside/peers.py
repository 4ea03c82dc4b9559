"""The tower and monopile with a rigid top by pyBModes, a peer that shares no code with either."""

import importlib
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray
from tests.outside import sections as iea
from tests.outside.model import Description, SpringSign, spring_matrix

CUT = 4  # of pyBModes' elements in each can
LUMPED_TOP = (1016.6e3, 4.2, 2e8)  # mass [kg], height of its centre [m], inertia [kg·m²]


def lumped_description(*, gravity: float = 0.0, height: float = LUMPED_TOP[1]) -> Description:
    """The averaged tubes with a rigid body instead of nacelle and rotor."""
    top = (LUMPED_TOP[0], height, LUMPED_TOP[2])
    return Description(iea.averaged_cans(), (), lumped_top=top, gravity=gravity)


def pybmodes_frequencies(
    pybmodes: ModuleType,
    described: Description,
    theta: ArrayLike,
    sign: SpringSign,
    *,
    water_level: float = iea.MUDLINE,
    n_modes: int = 16,
) -> FloatArray:
    """Frequencies of the tower with its rigid top, lowest first, both planes and twist [Hz].

    Parameters
    ----------
    pybmodes : module
        The package; what is used of it is imported here.
    described : Description
        With a lumped top and no blades, uniform cans.
    theta : array_like, shape (3,)
        k11 [N/m], k22 [N·m/rad], k12 [N/rad].
    sign : str
        Convention of k12.
    water_level : float
        At an edge of a can [m]. pyBModes gives added mass a weight: use it without gravity.
    n_modes : int
        How many.
    """
    for name in ("io.bmi", "io.sec_props", "models._pipeline"):
        importlib.import_module(f"pybmodes.{name}")
    length = described.cans[-1].top - described.cans[0].bottom
    edges, rows = [0.0], []
    for can in described.cans:
        wet = iea.WATER_DENSITY * np.pi / 4 * can.diameters[0] ** 2 * (can.top <= water_level)
        row = _section(can.diameters[0], can.thickness, can.density, float(wet))
        for low, high in pairwise(np.linspace(can.bottom, can.top, CUT + 1).tolist()):
            rows.append([(low + high) / 2 - iea.MUDLINE, *row])
            edges.append(high - iea.MUDLINE)
    table = np.array([[0.0, *rows[0][1:]], *rows, [length, *rows[-1][1:]]])
    bmi = _main_input(pybmodes, described, np.array(edges) / length, theta, sign)
    found = pybmodes.models._pipeline.run_fem(
        bmi, n_modes=n_modes, sp=_table(pybmodes, table, length), gravity=described.gravity
    )
    return np.asarray(found.frequencies)


def _section(diameter: float, wall: float, density: float, wet: float) -> list[float]:
    """Mass per length [kg/m], EI [N·m²], GJ [N·m²], EA [N] of a tube."""
    area = np.pi * (diameter - wall) * wall
    second = np.pi * (diameter**4 - (diameter - 2 * wall) ** 4) / 64
    rigidity = iea.YOUNGS_MODULUS * second
    return [density * area + wet, rigidity, rigidity / 1.3, iea.YOUNGS_MODULUS * area]


def _table(pybmodes: ModuleType, table: FloatArray, length: float) -> Any:
    """pyBModes' sections; without rotary inertia, as Euler-Bernoulli beams have none."""
    none = np.zeros(len(table))
    s, mass, bending, torsion, axial = table.T
    return pybmodes.io.sec_props.SectionProperties(
        title="tubes",
        n_secs=len(table),
        span_loc=s / length,
        **dict.fromkeys(("str_tw", "tw_iner", "cg_offst", "sc_offst", "tc_offst"), none),
        flp_iner=1e-6 * mass,
        edge_iner=1e-6 * mass,
        mass_den=mass,
        flp_stff=bending,
        edge_stff=bending,
        tor_stff=torsion,
        axial_stff=axial,
    )


def _main_input(
    pybmodes: ModuleType,
    described: Description,
    edges: FloatArray,
    theta: ArrayLike,
    sign: SpringSign,
) -> Any:
    io = pybmodes.io.bmi
    assert described.lumped_top is not None
    mass, height, inertia = described.lumped_top
    none, empty = np.zeros((6, 6)), np.zeros(0)
    support = io.PlatformSupport(
        draft=0.0, cm_pform=0.0, mass_pform=0.0, i_matrix=none, ref_msl=0.0,
        hydro_M=none, hydro_K=none, mooring_K=_mudline_stiffness(theta, sign),
        distr_m_z=empty, distr_m=empty, distr_k_z=empty, distr_k=empty,
    )  # fmt: skip
    tip = io.TipMassProps(
        mass=mass, cm_offset=0.0, cm_axial=height,
        ixx=inertia, iyy=inertia, izz=inertia, ixy=0.0, izx=0.0, iyz=0.0,
    )  # fmt: skip
    length = described.cans[-1].top - described.cans[0].bottom
    return io.BMIFile(
        title="tower", echo=False, beam_type=2, rot_rpm=0.0, rpm_mult=1.0, radius=length,
        hub_rad=0.0, precone=0.0, bl_thp=0.0, hub_conn=3, n_modes_print=20, tab_delim=True,
        mid_node_tw=False, tip_mass=tip, id_mat=1, sec_props_file="", scaling=io.ScalingFactors(),
        n_elements=len(edges) - 1, el_loc=edges, tow_support=1, support=support,
    )  # fmt: skip


def _mudline_stiffness(theta: ArrayLike, sign: SpringSign) -> FloatArray:
    """(6, 6) on surge, sway, heave, roll, pitch, yaw; roll is −du_y/dz."""
    (k11, k12), (_, k22) = spring_matrix(theta, sign)
    stiffness = np.diag([k11, k11, 0.0, k22, k22, 0.0])
    stiffness[0, 4] = stiffness[4, 0] = k12
    stiffness[1, 3] = stiffness[3, 1] = -k12
    return stiffness
