# SPDX-License-Identifier: LGPL-3.0-or-later
"""The set-up script names what a machine lacks; no interpreter here is a real one."""

import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

SCRIPT = Path(__file__).parents[2] / ".ci" / "setup"
TOOLS = ("sh", "dirname", "mktemp", "mkdir", "cp", "rm", "cat", "tail")
# Answers as a fitting interpreter would: makes the virtual environment, "installs", imports.
PYTHON = """\
#!/bin/sh
case "$*" in
    *"-m venv"*) for folder; do :; done; mkdir -p "$folder/bin"; cp "$0" "$folder/bin/python" ;;
    *get_config_var*) echo {compiler} ;;
    *"import {module}"*) echo "{error}" ;;
    *--version*) echo "Python 3.12.9" ;;
esac
"""


class Machine:
    """A PATH with a few tools and what a test adds to it."""

    def __init__(self, root: Path) -> None:
        self.root, self.bin = root, root / "bin"
        self.bin.mkdir()
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool) or pytest.skip(f"no {tool}"))

    def program(self, path: str, text: str = "#!/bin/sh\n") -> None:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        file.chmod(0o755)

    def python(
        self, path: str, *, module: str = "gmsh", error: str = "", compiler: str = "cc"
    ) -> None:
        self.program(path, PYTHON.format(module=module, error=error, compiler=compiler))

    def setup(self, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", str(SCRIPT), str(self.root / "venv")],
            env={"PATH": str(self.bin), "HOME": str(self.root)} | environment,
            capture_output=True,
            text=True,
            check=False,
        )

    def complaint(self, **environment: str) -> str:
        """The one line of a set-up that must fail."""
        done = self.setup(**environment)
        assert done.returncode == 1
        assert done.stderr.startswith("setup: ")
        assert done.stderr.count("\n") == 1
        return done.stderr


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_no_compiler(machine: Machine) -> None:
    machine.python("bin/python3.12")
    assert "no C compiler" in machine.complaint()


def test_no_python(machine: Machine) -> None:
    machine.program("bin/gcc")
    machine.program("bin/python3.12", "#!/bin/sh\nexit 127\n")  # a shim without an interpreter
    assert "no Python 3.12" in machine.complaint()


def test_compiler_of_this_python_is_missing(machine: Machine) -> None:
    machine.program("bin/clang")
    machine.python("bin/python3.12", compiler="gcc-99")
    assert "'gcc-99'" in machine.complaint()
    assert machine.setup(CC="clang").returncode == 0


@pytest.mark.parametrize(
    ("module", "library", "package"),
    [("gmsh", "libGLU.so.1", "libglu1-mesa"), ("vtk", "libXrender.so.1", "libxrender1")],
)
def test_missing_system_library(machine: Machine, module: str, library: str, package: str) -> None:
    machine.program("bin/cc")
    error = f"{library}: cannot open shared object file: No such file or directory"
    machine.python("bin/python3.12", module=module, error=error)
    message = machine.complaint()
    for part in (module, library, package):
        assert part in message


@pytest.mark.parametrize("place", ["bin/python3.13", ".pyenv/versions/3.13.1/bin/python"])
def test_python_is_found(machine: Machine, place: str) -> None:
    machine.program("bin/cc")
    machine.program("bin/python3.12", "#!/bin/sh\nexit 127\n")
    machine.python(place)
    done = machine.setup()
    assert (done.returncode, done.stderr) == (0, "")
    assert (machine.root / "venv" / "bin" / "python").exists()
