#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Draw the motion in result folders: a picture of superposed instants, and a film.

Reads only the ParaView series of a folder (beams, beam_surfaces, shells, floating_bodies,
floating_lines, rigid_bodies, joints, cables, cable_nets, reactions, contact_surfaces), which may
also be that of a mode:

    python postprocess/render.py results/slider_crank --colour M3 --size 1600x900

Superposed in motion.png are a few instants, or with --interval 0.1 one every 0.1 s; the film is
motion.gif or motion.mp4. With --time there is one picture of one instant, still.png, or of several
side by side, instants.png.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from motion_scene import Scene
    from result_series import Instant

GHOSTS = 5  # earlier instants in motion.png
MAX_FRAMES = 120
VIEWS = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "corner": (0.8, -1.5, 0.8)}
VIEWS |= {f"-{name}": (-VIEWS[name][0], -VIEWS[name][1], -VIEWS[name][2]) for name in "xyz"}
VECTORS = ("force", "moment")


class OptionError(ValueError):
    """Options that do not fit, described in one line."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument(
        "--colour",
        "--color",
        metavar="FIELD",
        help="field or component on beams (N, Q2, Q3, T, M2, M3, kappa1, axial_stress, von_mises, "
        "velocity, ...), shells or floating bodies (deformation, ...); default: bending_moment, "
        "von_mises where only floating bodies are",
    )
    parser.add_argument(
        "--arrows",
        choices=VECTORS,
        help="arrows at joints: what they exert on the first of their bodies",
    )
    parser.add_argument(
        "--view",
        type=viewpoint,
        metavar="V",
        help="from where: x, y, z, --view=-x, ..., corner, or A,B,C towards the viewer "
        "(default: across a flat motion, else from a corner)",
    )
    parser.add_argument(
        "--scale-deformation",
        type=factor,
        default=1.0,
        metavar="F",
        help="displacements since the start times F, for small ones",
    )
    parser.add_argument(
        "--time",
        type=times,
        metavar="T",
        help='only still.png at t = T [s], a number or "last", or T1,T2,... side by side in '
        "instants.png, each of --size",
    )
    parser.add_argument(
        "--range",
        type=interval,
        metavar="A,B",
        help="values that the first and the last colour stand for (default: the extreme ones)",
    )
    parser.add_argument("--from", dest="start", type=finite, metavar="T", help="from t = T on [s]")
    parser.add_argument("--to", dest="end", type=finite, metavar="T", help="up to t = T [s]")
    parser.add_argument(
        "--interval", type=finite, metavar="T", help="time between instants of motion.png [s]"
    )
    parser.add_argument(
        "--every",
        type=positive,
        metavar="N",
        help=f"every Nth instant in the film (default: at most {MAX_FRAMES} frames)",
    )
    parser.add_argument(
        "--format", choices=("gif", "mp4"), default="gif", help="of the film (default: gif)"
    )
    parser.add_argument("--no-animation", action="store_true", help="no film")
    parser.add_argument(
        "--size", type=window_size, default=(1200, 800), metavar="WxH", help="default: 1200x800"
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="folder of the pictures (default: RESULTS_DIR)"
    )


def window_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT."""
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 200 and int(height) >= 150):
        raise argparse.ArgumentTypeError(f"'{text}' is not WIDTHxHEIGHT with at least 200x150")
    return int(width), int(height)


def positive(text: str) -> int:
    """Parse a positive integer."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive integer")
    return int(text)


def finite(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def times(text: str) -> list[float]:
    """Parse times, the last one as infinity."""
    return [math.inf if part.strip() == "last" else finite(part) for part in text.split(",")]


def interval(text: str) -> tuple[float, float]:
    """Parse A,B with A below B."""
    low, _, high = text.partition(",")
    found = finite(low), finite(high)
    if not found[0] < found[1]:
        raise argparse.ArgumentTypeError(f"'{text}' is not A,B with A below B")
    return found


def factor(text: str) -> float:
    """Parse a number that is not negative."""
    value = finite(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is negative")
    return value


def viewpoint(text: str) -> tuple[float, ...]:
    """Parse a direction towards the viewer."""
    if text in VIEWS:
        return VIEWS[text]
    try:
        found = tuple(finite(part) for part in text.split(","))
    except argparse.ArgumentTypeError:
        found = ()
    if len(found) != 3 or not any(found):
        raise argparse.ArgumentTypeError(f"'{text}' is none of {', '.join(VIEWS)}, and not A,B,C")
    return found


def make(options: argparse.Namespace) -> list[Path]:
    """Draw the requested pictures; returns the files.

    Raises:
        ValueError: Options or result files cannot be used.
        OSError: A file cannot be read or written.
        ModuleNotFoundError: A library for pictures or films is missing.
    """
    from vtkmodules.vtkCommonCore import vtkLogger

    logging.getLogger().setLevel(logging.CRITICAL)  # damaged files end in one line
    # Without an X server VTK warns and then draws off screen by itself.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    if options.interval is not None and not options.interval > 0.0:
        raise OptionError(f"--interval must be positive, got {options.interval:g}")
    if options.output is not None and len(options.folders) > 1:
        raise OptionError("--output takes the pictures of one RESULTS_DIR only")
    if options.format == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ModuleNotFoundError("No module named 'imageio_ffmpeg'", name="imageio_ffmpeg")
    return [file for folder in options.folders for file in make_folder(folder, options)]


def make_folder(folder: Path, options: argparse.Namespace) -> list[Path]:
    """Pictures of one result folder."""
    from motion_scene import Scene, arrow_reach, default_field, survey
    from result_series import between, nearest, read_series, title_of

    instants = read_series(folder, arrows=options.arrows is not None)
    if options.time is not None:
        shown = frames = [nearest(instants, time) for time in options.time]
    else:
        instants = between(instants, options.start, options.end)
        every = options.every or -(-len(instants) // MAX_FRAMES)
        frames = instants[::every]
        if frames[-1] is not instants[-1]:
            frames.append(instants[-1])
        shown = spread(instants, options.interval)
    surveyed = [*shown, *frames]
    field = options.colour or default_field(surveyed)
    cloud, limits = survey(surveyed, field, options.scale_deformation)
    limits = options.range or limits
    scale, deformation = 0.0, options.scale_deformation
    if options.arrows:
        cloud, scale = arrow_reach(surveyed, options.arrows, cloud, deformation)
    scene = Scene(
        *title_of(folder), field, limits, cloud, options.size, options.view,
        deformation, options.arrows, scale,
    )  # fmt: skip
    target = options.output or folder
    target.mkdir(parents=True, exist_ok=True)
    if options.time is not None:
        still = target / ("still.png" if len(shown) == 1 else "instants.png")
        stills(shown, scene, still)
        return [still]
    made = [target / "motion.png"]
    picture(shown, scene, made[0])
    if not options.no_animation and len(frames) > 1:
        made.append(target / f"motion.{options.format}")
        animation(frames, scene, made[-1])
    return made


def spread(instants: list[Instant], interval: float | None) -> list[Instant]:
    """A few instants over the whole motion or those at intervals (s), the last one included."""
    import numpy as np

    if interval is None:
        chosen = np.linspace(0, len(instants) - 1, GHOSTS + 1).round().astype(int)
    else:
        times = np.array([instant.time for instant in instants])
        wanted = np.append(np.arange(times[0], times[-1], interval), times[-1])
        chosen = np.abs(times - wanted[:, None]).argmin(axis=1)
    return [instants[i] for i in sorted(set(chosen.tolist()))]


def picture(instants: list[Instant], scene: Scene, path: Path) -> None:
    """Last instant over fainter earlier ones."""
    from motion_scene import decorate, draw, fit_camera, new_plotter

    plotter = new_plotter(scene)
    for i, instant in enumerate(instants[:-1]):
        draw(plotter, instant, scene, f"ghost{i}", 0.15 + 0.25 * i / (len(instants) - 1))
    coloured = draw(plotter, instants[-1], scene, "", 1.0)
    decorate(plotter, instants[-1], scene, coloured)
    fit_camera(plotter, scene)
    plotter.screenshot(str(path))
    plotter.close()


def stills(instants: list[Instant], scene: Scene, path: Path) -> None:
    """Instants side by side, in rows of about as many as there are rows."""
    import imageio.v3 as imageio
    import numpy as np
    from motion_scene import decorate, draw, fit_camera, new_plotter

    across = math.ceil(math.sqrt(len(instants)))
    pictures = []
    for instant in instants:
        plotter = new_plotter(scene)
        coloured = draw(plotter, instant, scene, "", 1.0)
        decorate(plotter, instant, scene, coloured)
        fit_camera(plotter, scene)
        pictures.append(plotter.screenshot(None, return_img=True))
        plotter.close()
    blank = np.broadcast_to(pictures[0][:1, :1], pictures[0].shape)
    pictures += [blank] * (-len(pictures) % across)
    rows = [np.hstack(pictures[i : i + across]) for i in range(0, len(pictures), across)]
    imageio.imwrite(path, np.vstack(rows))


def animation(instants: list[Instant], scene: Scene, path: Path) -> None:
    """All instants, one after the other."""
    from motion_scene import decorate, draw, fit_camera, new_plotter

    plotter = new_plotter(scene)
    pause = max(40, min(200, 6000 // len(instants)))
    with Film(path, pause) as film:
        for instant in instants:
            coloured = draw(plotter, instant, scene, "", 1.0)
            decorate(plotter, instant, scene, coloured)
            fit_camera(plotter, scene)
            plotter.render()
            film.add(plotter.screenshot(None, return_img=True))
    plotter.close()


class Film:
    """A file of pictures, by the ending of its name."""

    def __init__(self, path: Path, pause: int) -> None:
        """Begin a film with a pause (ms) between pictures."""
        self._path, self._pause = path, pause
        self._frames: list[Any] = []
        self._writer: Any = None

    def __enter__(self) -> Film:
        """Open the file of a mp4; a gif is written at the end."""
        if self._path.suffix == ".mp4":
            import imageio.v2 as imageio

            # what browsers and office programs play: H.264, 4:2:0, even numbers of pixels
            self._writer = imageio.get_writer(
                self._path, format="FFMPEG", fps=1000.0 / self._pause, codec="libx264",
                pixelformat="yuv420p", macro_block_size=2, ffmpeg_log_level="error",
            )  # fmt: skip
        return self

    def add(self, frame: Any) -> None:
        """Add a picture (height, width, 3)."""
        if self._writer is not None:
            self._writer.append_data(frame)
        else:
            self._frames.append(frame)

    def __exit__(self, *failure: object) -> None:
        """Write what is left, unless there was an error."""
        if self._writer is not None:
            self._writer.close()
        elif failure[0] is None:
            import imageio.v3 as imageio

            frames = self._frames
            imageio.imwrite(self._path, frames, extension=".gif", duration=self._pause, loop=0)


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_arguments(parser)
    options = parser.parse_args(argv)
    try:
        made = make(options)
    except (ValueError, OSError) as exc:
        print(f"render.py: {exc}", file=sys.stderr)
        return 2
    for path in made:
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
