"""Small decks of OpenFAST that tests write: an upwind turbine of round figures, a monopile."""

from pathlib import Path

BLADE_TITLES = "BlFract StrcTwst BMassDen FlpStff EdgStff"
BLADE_ROWS = ("0.0 12.0 600.0 1.0e10 2.0e10", "1.0 0.0 200.0 1.0e8 2.0e8")
TOWER_ROWS = ("0.0 4000.0 4.5e11 4.5e11", "1.0 4000.0 4.5e11 4.5e11")

MAIN = """
3 NumBl
61.5 TipRad
1.5 HubRad
-2.5 PreCone(1)
-5.0 OverHang
-5.0 ShftTilt
1.9 NacCMxn
0.0 NacCMyn
1.75 NacCMzn
2.0 Twr2Shft
90.0 TowerHt
10.0 TowerBsHt
10.0 PtfmCMzt
50000.0 HubMass
1.0e5 HubIner
2.0e5 NacMass
2.6e6 NacYIner
0.0 YawBrMass
0.0 PtfmMass
"blade.dat" BldFile(1)
"tower.dat" TwrFile
"""
PILE = """
1 FEMMod
3 NJoints
JointID JointXss JointYss JointZss
(-) (m) (m) (m)
1 0.0 0.0 -20.0
2 0.0 0.0 -5.0
3 0.0 0.0 10.0
1 NReact
2 NMembers
MemberID MJointID1 MJointID2 MPropSetID1 MPropSetID2 MType COSMID
(-) (-) (-) (-) (-) (-) (-)
1 1 2 1 1 1c 0
2 2 3 1 1 1c 0
1 NPropSetsCyl
PropSetID YoungE ShearG MatDens XsecD XsecT
(-) (N/m2) (N/m2) (kg/m3) (m) (m)
1 2.1e11 8.08e10 8500.0 6.0 0.06
"""


def changed(text: str, changes: dict[str, str]) -> str:
    """Return a text with some of its passages replaced; each must be there, once."""
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def turbine_deck(
    folder: Path,
    *,
    changes: dict[str, str] | None = None,
    blade: tuple[str, ...] = BLADE_ROWS,
    titles: str = BLADE_TITLES,
    blade_name: str = "blade.dat",
    tower: tuple[str, ...] = TOWER_ROWS,
) -> Path:
    """Write ElastoDyn's three files; return the primary one."""
    (folder / blade_name).write_text(
        f"{len(blade)} NBlInpSt\n1.0 AdjBlMs\n1.0 AdjFlSt\n1.0 AdjEdSt\n{titles}\n(units)\n"
        + "\n".join(blade)
    )
    (folder / "tower.dat").write_text(
        f"{len(tower)} NTwInpSt\n1.0 AdjTwMa\n1.0 AdjFASt\n"
        "HtFract TMassDen TwFAStif TwSSStif\n(units)\n" + "\n".join(tower)
    )
    path = folder / "small_ElastoDyn.dat"
    path.write_text(changed(MAIN, changes or {}))
    return path


def pile_deck(folder: Path, *, changes: dict[str, str] | None = None, more: str = "") -> Path:
    """Write SubDyn's file of a monopile of 6 m from -20 to 10 m."""
    path = folder / "small_SubDyn.dat"
    path.write_text(changed(PILE, changes or {}) + more)
    return path
