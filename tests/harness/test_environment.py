"""What a user's surroundings do to a command: nothing, or a line that says what to change."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fmus.build import build_all

NAME = "Zürich-犬"
SHORT = 'system = "cts"\nduration = 2\nwaypoints = [[25, 0]]\n'
RC = "text.usetex: True\nfigure.facecolor: red\naxes.grid: True\nfont.size: 30\n"


def canine_in(
    folder: Path, arguments: list[str], encoding: str = "utf-8", **variables: str
) -> tuple[int, str, str]:
    """Status, output and errors of a command with further environment variables."""
    done = subprocess.run(
        [sys.executable, "-m", "harness.main", *arguments], cwd=folder, capture_output=True, check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), **variables},
    )  # fmt: skip
    return done.returncode, done.stdout.decode(encoding), done.stderr.decode(encoding)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short scenario, its name in letters that the font lacks, and a matplotlibrc."""
    build_all()
    folder = tmp_path_factory.mktemp("run")
    (folder / f"{NAME}.toml").write_text(SHORT)
    (folder / "matplotlibrc").write_text(RC)  # matplotlib reads the one in the working directory, too
    return folder


def test_a_name_in_other_letters_is_written_as_it_is_and_warns_of_nothing(folder: Path) -> None:
    status, text, errors = canine_in(folder, ["run", f"{NAME}.toml", "--json"])
    assert (status, errors) == (0, "")
    assert f'"scenario": "{NAME}"' in text
    assert f'"scenario": "{NAME}"' in (folder / "out" / f"{NAME}-1" / "summary.json").read_text("utf-8")


def test_output_that_cannot_show_a_name_escapes_it(folder: Path) -> None:
    arguments = ["run", f"{NAME}.toml", "--json"]
    status, text, errors = canine_in(folder, arguments, "ascii", PYTHONIOENCODING="ascii")
    assert (status, errors) == (0, "")
    assert json.loads(text)["scenario"] == NAME
    # and as a table, where each letter that is missing is written as its number
    status, text, errors = canine_in(folder, arguments[:2], PYTHONIOENCODING="ascii")
    assert (status, errors) == (0, "")
    assert r"Z\xfcrich-\u72ac" in text


NOTEBOOK = "module://matplotlib_inline.backend_inline"


@pytest.mark.parametrize("backend", [NOTEBOOK, "inline", "qtagg", "nonsense"])
def test_a_backend_from_a_notebook_and_a_users_style_change_no_picture(
    folder: Path, tmp_path: Path, backend: str
) -> None:
    # given the picture of a trial in a folder without a matplotlibrc
    (tmp_path / "short.toml").write_text(SHORT)
    status, _, errors = canine_in(tmp_path, ["run", "short.toml", "--out", "plain"])
    assert (status, errors) == (0, "")
    # when it is drawn where both are set
    rc = str(folder / "matplotlibrc")
    status, _, errors = canine_in(
        tmp_path, ["run", "short.toml", "--out", "other"], MPLBACKEND=backend, MATPLOTLIBRC=rc
    )
    # then
    assert (status, errors) == (0, "")
    pictures = [(tmp_path / name / "trial.png").read_bytes() for name in ("plain", "other")]
    assert pictures[0] == pictures[1]


def test_the_way_in_from_python_imports_where_a_notebooks_backend_is_missing(tmp_path: Path) -> None:
    script = "from harness import run_trial; import matplotlib.figure; print(run_trial.__name__)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "MPLBACKEND": "module://no_such.backend"},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("run_trial\n", "")


def test_an_fmu_is_not_built_without_its_texts(tmp_path: Path) -> None:
    script = "from models.cmec import Cmec; print(Cmec.summary())"
    root = Path(__file__).parents[2]
    for level, status in (("1", 0), ("2", 1)):
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=root, env=os.environ | {"PYTHONOPTIMIZE": level},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == status
    assert "unset PYTHONOPTIMIZE, or use 1" in done.stderr
