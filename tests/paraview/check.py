# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check ParaView series with ParaView itself (run by check.sh through pvbatch, 5.11 or newer).

Every series of each folder is opened at all its times: number of times and last time against the
PVD file, array names, finite and non-empty bounds, and a picture that is not blank, written to
``<folder>/paraview/<series>.png``. The script in the folder that opens all draws ``all.png``
and leaves ``all.pvsm``.
"""

import math
import os
import runpy
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from paraview import simple
from paraview.vtk.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader

BEAM_CELLS = {"body": 1, "resultant": 6, "bending_moment": 1}
RESULTANTS = ["N", "Q2", "Q3", "T", "M2", "M3"]
STRAINS = ["gamma1", "gamma2", "gamma3", "kappa1", "kappa2", "kappa3"]
# Required arrays with their numbers of components, at points and at cells.
EXPECTED = {
    "beams": (
        dict.fromkeys(("displacement", "velocity", "angular_velocity", "e1", "e2", "e3"), 3),
        {**BEAM_CELLS, "strain": 6},
    ),
    "beam_surfaces": ({"displacement": 3, "velocity": 3}, BEAM_CELLS),
    "rigid_bodies": ({"displacement": 3, "velocity": 3}, {"body": 1}),
    "contact_surfaces": ({"displacement": 3, "velocity": 3}, {"body": 1}),
    "cables": ({"displacement": 3}, {"joint": 1, "tension": 1}),
    "joints": ({"displacement": 3}, {"joint": 1, "force": 3, "force_magnitude": 1}),
    "reactions": (dict.fromkeys(("force", "moment", "displacement"), 3) | {"joint": 1}, {}),
}
# Beams of equations of their own, without section resultants.
PLAIN_BEAMS = (dict.fromkeys(("displacement", "e1", "e2", "e3"), 3), {})
COLOURS = {"beams": "bending_moment", "beam_surfaces": "bending_moment", "joints": "joint"}
COMPONENTS = {"resultant": RESULTANTS, "strain": STRAINS}


class CheckError(Exception):
    """An error, described in one line."""


def pvd_times(path):
    """Times named by a PVD file, without the help of ParaView."""
    entries = list(ET.parse(path).getroot().iter("DataSet"))
    if not entries:
        raise CheckError(f"{path}: no instants")
    return sorted(float(e.attrib["timestep"]) for e in entries)


def check_arrays(path, reader, series):
    """Names, component counts and component names of the required arrays."""
    required = EXPECTED[series]
    if series == "beams" and reader.CellData.GetArray("resultant") is None:
        required = PLAIN_BEAMS
    parts = zip(("point", "cell"), (reader.PointData, reader.CellData), required, strict=True)
    for where, data, expected in parts:
        for name, components in expected.items():
            array = data.GetArray(name)
            if array is None:
                raise CheckError(f"{path}: no {where} array '{name}', only {data.keys()}")
            if array.GetNumberOfComponents() != components:
                found = array.GetNumberOfComponents()
                raise CheckError(f"{path}: '{name}' has {found} components, not {components}")
            names = [array.GetComponentName(i) for i in range(components)]
            if name in COMPONENTS and names != COMPONENTS[name]:
                raise CheckError(f"{path}: components of '{name}' are named {names}")
            ranges = [array.GetRange(i) for i in range(components)]
            if not all(math.isfinite(x) for pair in ranges for x in pair):
                raise CheckError(f"{path}: '{name}' is not finite: {ranges}")


def check_bounds(path, reader, time):
    """Cells at all, and a finite extent; only the reactions may be a single point."""
    info = reader.GetDataInformation()
    if info.GetNumberOfCells() == 0 or info.GetNumberOfPoints() == 0:
        raise CheckError(f"{path}: nothing at t = {time}")
    bounds = info.GetBounds()
    extent = max(bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4])
    enough = extent > 0.0 or path.stem == "reactions"
    if not all(map(math.isfinite, bounds)) or not enough or extent >= 1e30:
        raise CheckError(f"{path}: bounds {bounds} at t = {time}")


def draw(path, reader, series, time):
    """Write a picture and look whether anything is in it."""
    if series == "reactions":
        return  # points, for arrows
    view = simple.CreateView("RenderView")
    view.ViewSize = [900, 600]
    view.OrientationAxesVisibility = 0
    view.ViewTime = time
    display = simple.Show(reader, view)
    if series == "beams":
        display.LineWidth = 4.0
    if series in COLOURS and reader.CellData.GetArray(COLOURS[series]) is not None:
        simple.ColorBy(display, ("CELLS", COLOURS[series]))
        display.RescaleTransferFunctionToDataRange(True)
    view.ResetActiveCameraToPositiveZ()
    simple.GetActiveCamera().Azimuth(-30)
    simple.GetActiveCamera().Elevation(25)
    simple.ResetCamera(view)
    folder = path.parent / "paraview"
    folder.mkdir(exist_ok=True)
    picture = folder / f"{series}.png"
    simple.SaveScreenshot(str(picture), view)
    simple.Delete(view)
    check_picture(picture)


def check_picture(picture):
    """Check that a picture is not empty."""
    png = vtkPNGReader()
    png.SetFileName(str(picture))
    png.Update()
    pixels = vtk_to_numpy(png.GetOutput().GetPointData().GetScalars())[:, :3]
    drawn = int((pixels != pixels[0]).any(axis=1).sum())
    if drawn < 20:
        raise CheckError(f"{picture}: blank")


def check_series(path):
    """Check one series; returns the number of times and the last one."""
    series = path.stem
    expected = pvd_times(path)
    reader = simple.PVDReader(FileName=str(path))
    reader.UpdatePipelineInformation()
    times = list(reader.TimestepValues) if len(expected) > 1 else expected
    if len(times) != len(expected):
        raise CheckError(f"{path}: ParaView sees {len(times)} times, the file {len(expected)}")
    if times[-1] != expected[-1]:
        raise CheckError(f"{path}: ParaView's last time is {times[-1]}, the file's {expected[-1]}")
    for time in times:
        reader.UpdatePipeline(time)
        check_bounds(path, reader, time)
    if series in EXPECTED:
        check_arrays(path, reader, series)
    draw(path, reader, series, times[-1])
    simple.Delete(reader)
    return len(times), times[-1]


def check_script(folder):
    """Run the script that opens everything, look at its picture, and load the state it leaves."""
    script, picture = folder / "open_in_paraview.py", folder / "paraview" / "all.png"
    state = folder / "paraview" / "all.pvsm"
    if not script.exists():
        raise CheckError(f"{script}: missing")
    for made in (picture, state):
        made.unlink(missing_ok=True)
    arguments, sys.argv = sys.argv, [str(script), str(picture), str(state)]
    try:
        runpy.run_path(str(script), run_name="__main__")
    finally:
        sys.argv = arguments
    check_picture(picture)
    shown = len(simple.GetSources())
    simple.ResetSession()
    simple.LoadState(str(state))
    if len(simple.GetSources()) != shown:
        raise CheckError(f"{state}: {len(simple.GetSources())} sources, the script has {shown}")
    simple.ResetSession()


def check_folder(folder):
    """Check all series of a result folder."""
    paths = sorted(folder.glob("*.pvd"))
    if not paths:
        raise CheckError(f"{folder}: no series")
    found = {path.stem: check_series(path) for path in paths}
    counts = [count for count, _ in found.values()]
    # Of a killed run, which left no summary, some series may miss the last instant.
    if max(counts) - min(counts) > (0 if (folder / "summary.json").exists() else 1):
        raise CheckError(f"{folder}: the series differ in times: {found}")
    check_script(folder)
    count, last = found[paths[0].stem]
    print(f"{folder}: {', '.join(found)}: {count} times up to {last:g}")


def main():
    """Check all folders named on the command line."""
    try:
        for name in sys.argv[1:]:
            check_folder(Path(name))
    except (CheckError, ET.ParseError, OSError, KeyError, ValueError, RuntimeError) as exc:
        print(f"check.py: {exc}".splitlines()[0], file=sys.stderr)
        return 1
    return 0


status = main()
sys.stdout.flush()
sys.stderr.flush()
# pvbatch would replace the exit code by its own.
os._exit(status)
