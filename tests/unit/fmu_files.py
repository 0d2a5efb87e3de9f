# SPDX-License-Identifier: LGPL-3.0-or-later
"""FMUs that tests make from C."""

import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

__all__ = ["description", "make_fmu"]

SOURCE = Path(__file__).parents[1] / "data" / "pi_controller.c"
NUMBERS = (
    ("y", "input"), ("rate", "input"), ("u", "output"), ("proportional", "parameter"),
    ("damping", "parameter"), ("integral", "parameter"), ("setpoint", "parameter"),
)  # fmt: skip


def make_fmu(folder: Path, version: int) -> Path:
    """Compile the PI controller into an FMU of FMI 2 or 3."""
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    library, file = folder / "pi_controller.so", folder / f"pi_controller_{version}.fmu"
    compiler = os.environ.get("CC") or shutil.which("cc") or "gcc"
    prototypes = (headers / f"fmi{version}Functions.h").read_text()
    required = set(re.findall(rf"^ *FMI{version}_Export +fmi{version}(\w+)TYPE", prototypes, re.M))
    missing = required - set(re.findall(rf"\bfmi{version}(\w+)\(", SOURCE.read_text()))
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-I", headers, SOURCE, "-o", library]
        + [f"-Wl,--defsym,fmi{version}{name}=unsupported" for name in sorted(missing)]
        + (["-DFMI3"] if version == 3 else []),
        check=True,
    )
    platform = "linux64" if version == 2 else "x86_64-linux"
    with zipfile.ZipFile(file, "w") as archive:
        archive.write(library, f"binaries/{platform}/pi_controller.so")
        archive.writestr("modelDescription.xml", description(version))
    return file


def description(version: int) -> str:
    """The model description of the PI controller."""
    variables = []
    for reference, (name, causality) in enumerate((*NUMBERS, ("reversed", "parameter"))):
        kind = "Boolean" if name == "reversed" else "Real" if version == 2 else "Float64"
        variability = "tunable" if causality == "parameter" else "continuous"
        start = "" if causality == "output" else f' start="{"false" if kind == "Boolean" else 0}"'
        initial = {"parameter": "exact", "output": "calculated"}.get(causality)
        common = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        common += f' variability="{variability}"' + (f' initial="{initial}"' if initial else "")
        variables.append(
            f"<ScalarVariable {common}><{kind}{start}/></ScalarVariable>"
            if version == 2
            else f"<{kind} {common}{start}/>"
        )
    token = "guid" if version == 2 else "instantiationToken"
    output = "<Outputs><Unknown index='3'/></Outputs>" if version == 2 else (
        "<Output valueReference='2'/>"
    )  # fmt: skip
    return (
        f'<fmiModelDescription fmiVersion="{version}.0" modelName="pi" {token}="1">'
        '<CoSimulation modelIdentifier="pi_controller" '
        'canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{output}</ModelStructure></fmiModelDescription>"
    )
