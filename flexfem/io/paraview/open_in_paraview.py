# SPDX-License-Identifier: LGPL-3.0-or-later
"""Open the results beside this file in ParaView 5.11 or newer, coloured by their fields.

In ParaView: File > Load State. From a shell, with the window or without:

    paraview --script=open_in_paraview.py
    pvbatch open_in_paraview.py picture.png
    pvbatch open_in_paraview.py state.pvsm

It may be moved and copied with its folder; it reads the series (*.pvd) that are there.
"""

import inspect
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from paraview import simple

# Of each series, the field that gives the colours: the first of these that it has.
COLOURS = {
    "beam_surfaces": (("CELLS", "bending_moment"),),
    "beams": (("CELLS", "bending_moment"),),
    "shells": (("CELLS", "bending_moment"),),
    "solids": (("POINTS", "von_mises"),),
    "floating_bodies": (("CELLS", "von_mises"),),
    "floating_lines": (("CELLS", "von_mises"),),
    "cables": (("CELLS", "tension"),),
    "cable_nets": (("CELLS", "tension"),),
}
PLAIN = {"rigid_bodies": (0.56, 0.64, 0.72), "joints": (0.88, 0.48, 0.22)}
PLAIN["contact_surfaces"] = (0.74, 0.78, 0.82)
ARROWS = {"force": (0.49, 0.25, 0.66), "moment": (0.16, 0.55, 0.42)}
UNITS = {"bending_moment": "N m", "von_mises": "Pa", "tension": "N"}
#: From blue to red without dark ends, which would hide shading.
MAP = (0.21, 0.40, 0.66, 0.16, 0.62, 0.62, 0.50, 0.75, 0.35, 0.94, 0.73, 0.23, 0.82, 0.25, 0.18)
Box = tuple[list[float], list[float]]
#: Number of instants from which the greatest values of the motion are taken.
LOOKS = 12


def own_folder() -> Path:
    """The folder of this file; a window of ParaView runs the text without telling its name."""
    names = [globals().get("__file__", ""), inspect.stack()[0].filename]
    command = Path("/proc/self/cmdline")
    if command.is_file():
        arguments = command.read_bytes().decode(errors="replace").split("\0")
        names += [argument.partition("=")[2] or argument for argument in arguments]
    names += [str(Path(FOLDER, "open_in_paraview.py")), "open_in_paraview.py"]
    for name in names:
        if name.endswith("open_in_paraview.py") and Path(name).is_file():
            return Path(name).resolve().parent
    raise RuntimeError("open_in_paraview.py: start ParaView in the folder of the results")


def series(folder: Path) -> dict[str, list[float]]:
    """Names of the series in the folder, and their times."""
    found = {}
    for file in sorted(folder.glob("*.pvd")):
        if file.stem.startswith("solid_cells_"):  # what "solids" shows the surface of
            continue
        sets = ET.parse(file).getroot().iter("DataSet")
        times = sorted(float(entry.attrib["timestep"]) for entry in sets)
        if times:
            found[file.stem] = times
    if not found:
        raise RuntimeError("open_in_paraview.py: no series (*.pvd) in " + str(folder))
    return found


def extremes(reader: Any, times: list[float], association: str, field: str) -> tuple[float, Box]:
    """Greatest value of a field, and the bounds of the series, at some instants."""
    step = max(1, -(-len(times) // LOOKS))
    largest, bounds = 0.0, []
    for time in {*times[::step], times[-1]}:
        reader.UpdatePipeline(time)
        information = reader.GetDataInformation()
        bounds.append(information.GetBounds())
        data = reader.CellData if association == "CELLS" else reader.PointData
        array = data.GetArray(field) if field else None
        if array is not None:
            component = -1 if array.GetNumberOfComponents() > 1 else 0  # -1: the length
            largest = max(largest, abs(array.GetRange(component)[1]))
    low = [min(b[2 * i] for b in bounds) for i in range(3)]
    high = [max(b[2 * i + 1] for b in bounds) for i in range(3)]
    return largest, (low, high)


def show_coloured(reader: Any, view: Any, name: str, times: list[float]) -> tuple[Any, str, Box]:
    """Show a flexible series in the colours of its field; returns its bounds."""
    display = simple.Show(reader, view)
    reader.UpdatePipeline(times[-1])
    for association, field in COLOURS[name]:
        data = reader.CellData if association == "CELLS" else reader.PointData
        if data.GetArray(field) is None:
            continue
        largest, bounds = extremes(reader, times, association, field)
        simple.ColorBy(display, (association, field))
        display.Ambient = 0.2
        LARGEST[field] = max(LARGEST.get(field, 0.0), largest)
        return display, field, bounds
    return display, "", extremes(reader, times, "CELLS", "")[1]


def finish_colours(view: Any, displays: list[tuple[Any, str]], found: Any) -> None:
    """One range of colours and one bar for each field, over the whole motion."""
    for field, largest in LARGEST.items():
        table = simple.GetColorTransferFunction(field)
        top = largest or 1.0
        stops = [top * i / 4.0 for i in range(5)]
        table.RGBPoints = [v for i, s in enumerate(stops) for v in (s, *MAP[3 * i : 3 * i + 3])]
        table.ColorSpace = "RGB"
        table.NanColor = [0.65, 0.69, 0.73]
        bar = simple.GetScalarBar(table, view)
        unit = UNITS.get(field)
        if field == "bending_moment" and "shells" in found:  # per length there
            unit = "" if "beams" in found else "N m/m"
        bar.Title = field.replace("_", " ") + (" (" + unit + ")" if unit else "")
        bar.ComponentTitle = ""
        bar.TitleColor = bar.LabelColor = [0.19, 0.22, 0.25]
    for display, field in displays:
        if field:
            display.SetScalarBarVisibility(view, True)


def show_arrows(reader: Any, view: Any, times: list[float], size: float) -> None:
    """Reactions as arrows, the longest of the motion a sixth of its size; moments are hidden."""
    for field, colour in ARROWS.items():
        largest, _ = extremes(reader, times, "POINTS", field)
        if not largest > 0.0:
            continue
        arrows = simple.Glyph(Input=reader, GlyphType="Arrow")
        arrows.OrientationArray = ["POINTS", field]
        arrows.ScaleArray = ["POINTS", field]
        arrows.VectorScaleMode = "Scale by Magnitude"
        arrows.ScaleFactor = size / 6.0 / largest
        arrows.GlyphMode = "All Points"
        simple.RenameSource(field + "s at joints", arrows)
        display = simple.Show(arrows, view)
        display.ColorArrayName = ["POINTS", ""]
        display.DiffuseColor = display.AmbientColor = list(colour)
        if field == "moment":
            simple.Hide(arrows, view)


def whole(boxes: dict[str, Box]) -> Box:
    """Return the bounding box of all series; of obstacles only the part near the others."""
    obstacle = boxes.get("contact_surfaces")
    others = [box for name, box in boxes.items() if name != "contact_surfaces"]
    every = others or list(boxes.values()) or [([0.0] * 3, [1.0] * 3)]
    low = [min(box[0][i] for box in every) for i in range(3)]
    high = [max(box[1][i] for box in every) for i in range(3)]
    if obstacle and others:
        margin = 0.1 * sum((high[i] - low[i]) ** 2 for i in range(3)) ** 0.5
        low = [max(low[i] - margin, min(low[i], obstacle[0][i])) for i in range(3)]
        high = [min(high[i] + margin, max(high[i], obstacle[1][i])) for i in range(3)]
    return low, high


def look_at(view: Any, low: list[float], high: list[float]) -> None:
    """Parallel projection that shows the whole motion: across a flat one, else from a corner."""
    extent = [high[i] - low[i] for i in range(3)]
    thin = extent.index(min(extent))
    middle = [0.5 * (low[i] + high[i]) for i in range(3)]
    size = sum(e * e for e in extent) ** 0.5 or 1.0
    if extent[thin] < 0.3 * sorted(extent)[1]:
        towards = {0: [1.0, 0.2, 0.3], 1: [0.2, -1.0, 0.3], 2: [0.2, 0.3, 1.0]}[thin]
        up = [0.0, 1.0, 0.0] if thin == 2 else [0.0, 0.0, 1.0]
    else:
        towards, up = [0.8, -1.5, 0.8], [0.0, 0.0, 1.0]
    view.CameraParallelProjection = 1
    view.CameraFocalPoint = middle
    view.CameraPosition = [middle[i] + 2.0 * size * towards[i] for i in range(3)]
    view.CameraViewUp = up
    view.CameraParallelScale = 0.45 * size


def main() -> None:
    """Load, show, and write a picture on request."""
    simple._DisableFirstRenderCameraReset()
    folder = own_folder()
    found = series(folder)
    view = simple.GetActiveViewOrCreate("RenderView")
    view.UseColorPaletteForBackground = 0
    view.Background = [0.965, 0.973, 0.984]
    view.OrientationAxesLabelColor = [0.19, 0.22, 0.25]
    displays, readers = [], {}
    boxes: dict[str, Box] = {}
    for name, times in found.items():
        reader = readers[name] = simple.PVDReader(
            registrationName=name, FileName=str(folder / (name + ".pvd"))
        )
        if name == "reactions":
            continue
        if name in COLOURS:
            display, field, bounds = show_coloured(reader, view, name, times)
            displays.append((display, field))
        else:
            display = simple.Show(reader, view)
            display.ColorArrayName = ["POINTS", ""]
            display.DiffuseColor = display.AmbientColor = list(PLAIN.get(name, (0.65, 0.69, 0.73)))
            _, bounds = extremes(reader, times, "CELLS", "")
        if name == "contact_surfaces":  # triangles face the side that touches
            display.BackfaceRepresentation = "Cull Backface"
        if name in ("beams", "floating_lines", "cables"):
            display.LineWidth = 4.0
        if name == "beams" and "beam_surfaces" in found:
            display.LineWidth = 2.0
        boxes[name] = bounds
    low, high = whole(boxes)
    if "reactions" in readers:
        size = sum((high[i] - low[i]) ** 2 for i in range(3)) ** 0.5 or 1.0
        show_arrows(readers["reactions"], view, found["reactions"], size)
    finish_colours(view, displays, found)
    if "__file__" in globals():  # a window finds the times itself
        scene = simple.GetAnimationScene()
        scene.UpdateAnimationUsingDataTimeSteps()
        scene.AnimationTime = max(times[-1] for times in found.values())
    look_at(view, low, high)
    simple.Render(view)
    for name in sys.argv[1:]:
        if name.endswith(".png"):
            view.ViewSize = [1200, 800]
            simple.SaveScreenshot(name, view, ImageResolution=[1200, 800])
        elif name.endswith(".pvsm"):
            simple.SaveState(name)


LARGEST: dict[str, float] = {}
FOLDER = ""  # where the results were written
main()
