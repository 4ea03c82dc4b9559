"""The wheel alone, unpacked in an empty place, beside whatever folders a user has."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an installation puts into site-packages."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check", "wheel"]
    made = subprocess.run([*build, "--no-deps", "-w", folder, ROOT], check=False, text=True,
                          capture_output=True)  # fmt: skip
    if made.returncode:
        pytest.skip(f"a wheel cannot be built here: {made.stderr.strip().splitlines()[-1]}")
    (wheel,) = folder.glob("pilewatch-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    return folder / "site"


def with_wheel(
    unpacked: Path, cwd: Path, *arguments: str, timeout: float = 600.0
) -> subprocess.CompletedProcess[str]:
    """A Python in that folder that has the wheel and what it depends on."""
    environment = {**os.environ, "PYTHONPATH": str(unpacked), "OMP_NUM_THREADS": "1"}
    return subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, text=True,
                          capture_output=True, check=False, timeout=timeout)  # fmt: skip


def script(folder: Path, text: str) -> Path:
    """A file beside which Python looks first, as it does for a console script."""
    folder.mkdir(exist_ok=True)
    path = folder / "script.py"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.nightly
def test_the_wheel_is_typed_and_holds_a_recording(unpacked: Path) -> None:
    for package in ("pilewatch", "pipeline", "sensors"):
        assert (unpacked / package / "py.typed").is_file()
    assert (unpacked / "pipeline" / "recordings" / "parked.mcap").stat().st_size > 10**6
    assert not (unpacked / "tests").exists()


@pytest.mark.nightly
def test_the_first_command_ends_in_a_posterior_in_an_empty_folder(
    unpacked: Path, tmp_path: Path
) -> None:
    command = script(tmp_path / "bin", "from pipeline.cli import main\nmain()\n")
    empty = tmp_path / "empty"
    empty.mkdir()
    ran = with_wheel(unpacked, empty, str(command), "run")
    assert ran.returncode == 0, ran.stderr[-2000:]
    posterior = json.loads((empty / "out" / "summary.json").read_text())["posterior"]
    ratio = posterior["k11"]
    assert ratio["ratio_p05"] < ratio["truth_ratio"] < ratio["ratio_p95"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pipeline", "sensors"])
def test_a_users_folder_of_the_same_name_breaks_no_command(
    unpacked: Path, tmp_path: Path, name: str
) -> None:
    command = script(tmp_path / "bin", "from pipeline.cli import main\nmain()\n")
    own = tmp_path / "own"
    (own / name).mkdir(parents=True)
    (own / name / "__init__.py").write_text("raise RuntimeError('the user’s own')\n")
    assert with_wheel(unpacked, own, str(command), "modes").returncode == 0


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pipeline", "sensors"])
def test_a_users_folder_of_the_same_name_is_named_by_the_library(
    unpacked: Path, tmp_path: Path, name: str
) -> None:
    own = script(tmp_path / "own", "import pilewatch\n").parent
    (own / name).mkdir()
    (own / name / "mine.py").touch()
    assert with_wheel(unpacked, own, "script.py").returncode == 0  # no package: ours is found
    (own / name / "__init__.py").touch()
    ran = with_wheel(unpacked, own, "script.py")
    assert ran.returncode == 1
    last = ran.stderr.strip().splitlines()[-1]
    assert f"hides pilewatch's own package '{name}'" in last
    assert str(own / name) in last
