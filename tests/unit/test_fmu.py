# SPDX-License-Identifier: LGPL-3.0-or-later
"""FMUs as controllers: compiled here, against the same law in Python."""

import os
import shutil
import zipfile
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.fmu_files import make_fmu
from tests.unit.refusals import assert_on_page

pytest.importorskip("fmpy")
if shutil.which("cc") is None and shutil.which("gcc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

COMM = MPI.COMM_WORLD
Z = (0.0, 0.0, 1.0)
GAINS = {"proportional": 20.0, "damping": 2.0, "integral": 15.0, "setpoint": 0.5}


def _turn(t: float, s: ff.MarkerState) -> tuple[float, float]:
    return float(np.arctan2(s.rotation[1, 0], s.rotation[0, 0])), float(s.angular_velocity[2])


def pendulum(controller: ff.Controller) -> ff.Model:
    model = ff.Model("pendulum")
    hinge = ff.Marker("rod", offset=(0.0, 0.5, 0.0))
    model.add(
        ff.RigidBody("rod", 2.0, (0.03, 0.03, 0.05), position=(0.0, -0.5, 0.0)),
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Revolute("hinge", ff.Ground(), hinge, axis=Z),
        ff.Actuator("motor", ff.Ground(), hinge, axis=Z),
        ff.Probe("turn", ff.Marker("rod"), ("angle", "rate"), _turn),
        controller,
    )
    return model


def of_file(file: Path, **more: Any) -> ff.FmuController:
    inputs, outputs = {"y": "angle", "rate": "rate"}, {"u": "motor"}
    usual: dict[str, Any] = {"inputs": inputs, "outputs": outputs, "parameters": GAINS}
    return ff.FmuController("pi", file, **({"sample_time": 0.01} | usual | more))


class InPython:
    """The law of the FMU: a step of Euler's method with the new measurement, then its output."""

    def __init__(self) -> None:
        self.state = np.array([np.nan, 0.0])

    def update(self, t: float, y: np.ndarray) -> float:
        last, integral = self.state
        error = GAINS["setpoint"] - y[0]
        if t > 0.0:
            integral += (t - last) * GAINS["integral"] * error
        self.state = np.array([t, integral])
        return float(GAINS["proportional"] * error - GAINS["damping"] * y[1] + integral)


def _run(controller: ff.Controller, t_end: float = 0.1, **more: Any) -> ff.Outcome:
    return ff.simulate(
        pendulum(controller), ff.RunOptions(dt=0.005, t_end=t_end, quiet=True, **more)
    )


@pytest.fixture
def fmu(shared_tmp_path: Path) -> Path:
    if COMM.rank == 0:
        make_fmu(shared_tmp_path, 2)
    COMM.Barrier()
    return shared_tmp_path / "pi_controller_2.fmu"


@pytest.mark.serial
@pytest.mark.parametrize("version", [2, 3])
def test_fmu_is_the_law_that_it_was_made_from(version, tmp_path):
    file = make_fmu(tmp_path, version)
    outcome = _run(of_file(file))
    reference = _run(ff.Controller("pi", ["turn"], ["motor"], InPython(), 0.01))
    for name, column in reference.history.items():
        # a measurement of the last sample, or a step too few, would change the third digit
        assert outcome.history[name] == pytest.approx(column, rel=1e-9, abs=1e-12), name
    # a parameter of another type
    law = of_file(file, parameters=GAINS | {"reversed": True}).law
    assert float(law.update(0.0, np.zeros(2))[0]) == -GAINS["proportional"] * GAINS["setpoint"]


def test_fmu_has_no_gradient(fmu):
    model, options = pendulum(of_file(fmu)), ff.RunOptions(dt=1e-2, t_end=0.02)
    column = model.of(ff.Probe)[0].columns[0]
    with pytest.raises(ValueError, match="its FMU keeps its states to itself"):
        ff.gradient(model, f"final:{column}", ["gravity[2]"], options)


def test_fmu_goes_on_after_a_restart(fmu, shared_tmp_path):
    """The FMU cannot save its state: it is taken through its measurements again."""
    whole = _run(of_file(fmu))
    folder = shared_tmp_path / "run"
    _run(of_file(fmu), 0.05, output=folder, checkpoint_every=10)
    resumed = _run(of_file(fmu), output=folder, restart=folder / "checkpoint_000010.h5")
    assert whole.status == resumed.status == "ok"
    if COMM.rank == 0:
        for name, column in whole.history.items():
            # an integral that starts again would show in the second digit
            assert resumed.history[name] == pytest.approx(column, rel=1e-10, abs=1e-12), name
    other = of_file(fmu, parameters=GAINS | {"damping": 3.0})
    with pytest.raises(ValueError, match="another model, other controllers"):
        _run(other, output=folder, restart=folder / "checkpoint_000010.h5")


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inputs": {"z": "angle"}}, 'the FMU has no variable "z", its inputs are .*y, rate'),
        ({"inputs": {"u": "angle"}}, 'variable "u" of the FMU is no input but output'),
        ({"inputs": ["y"]}, r"inputs must be a Mapping, got \['y'\]"),
        ({"outputs": {"y": "motor"}}, 'variable "y" of the FMU is no output but input'),
        ({"parameters": {"gain": 1.0}}, 'the FMU has no variable "gain", its parameters are'),
        ({"parameters": {"damping": "2"}}, "parameter \"damping\" must be a .*number, got '2'"),
        ({"file": "nowhere.fmu"}, "file 'nowhere.fmu' cannot be read: No such file"),
        ({"file": __file__}, "is no FMU: File is not a zip file"),
    ],
)
def test_mistakes_are_told(fmu, given, message):
    with pytest.raises((TypeError, ValueError), match=message) as raised:
        of_file(**({"file": fmu} | given))
    assert str(raised.value).startswith('FmuController "pi": ')
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_fmu_of_another_machine_is_told(fmu, tmp_path):
    """A failure as the FMU starts ends in one line, with nothing written."""
    import zipfile

    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(other, "w") as target:
        target.writestr("modelDescription.xml", source.read("modelDescription.xml"))
    with pytest.raises(
        ValueError, match=r'^FmuController "pi": the FMU fails at t = 0 s: '
    ) as raised:
        _run(of_file(other), output=tmp_path / "out")
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))
    assert not (tmp_path / "out").exists()


def _bomb(path: Path, **sizes: int) -> None:
    """An archive whose list of contents claims sizes that are not there."""
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("modelDescription.xml", "binaries/a"):
            archive.writestr(name, "x")
        for member in archive.infolist():
            member.file_size = sizes.get(member.filename.replace("/", "_").split(".")[0], 1)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda p: _bomb(p, binaries_a=4_000_000_000), "it unpacks to 2 files of 4 GB, at most"),
        (lambda p: _bomb(p, modelDescription=10**8), "its description has 100 MB, at most 64 MB"),
        (lambda p: zipfile.ZipFile(p, "w").writestr("../../x", "x"), "outside of its folder"),
        (lambda p: zipfile.ZipFile(p, "w").writestr("/etc/x", "x"), "outside of its folder"),
        (lambda p: p.write_text("no archive"), "is no FMU: File is not a zip file"),
        (os.mkfifo, "cannot be read: is not a regular file but a pipe"),
    ],
)
def test_archives_that_are_traps(make: Any, reason: str, tmp_path: Path) -> None:
    make(tmp_path / "a.fmu")
    with pytest.raises(ValueError, match=reason) as caught:
        of_file(tmp_path / "a.fmu")
    assert "\n" not in str(caught.value)
    assert_on_page(str(caught.value))
    assert [path.name for path in tmp_path.iterdir()] == ["a.fmu"]
