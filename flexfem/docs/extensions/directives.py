# SPDX-License-Identifier: LGPL-3.0-or-later
"""Directives whose text comes from the package: public names, cases, command lines, options."""

import contextlib
import importlib
import inspect
import io
import os
import pkgutil
from collections.abc import Iterable, Sequence
from dataclasses import Field, fields, is_dataclass
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

import flexfem
from flexfem.analyses.analysis import Analysis
from flexfem.case import Case
from flexfem.cli import command, commands
from flexfem.core.joint import Joint
from flexfem.core.load import Load
from flexfem.docs.extensions.topics import (
    PLACES,
    SHORTER,
    cases_of,
    examples,
    names_of,
    sentences,
)
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.probes.base import AnyProbe
from flexfem.model.structure.structure import Structure
from flexfem.options import Option

#: Kinds of things in models with numbers of their own.
_IN_MODELS = (Body, Beam, Shell, RigidBody, FloatingBody, PointMass, Joint, Load)
#: Columns of printed help.
_WIDTH = "84"
#: Names of defaults in the sources, and the texts for them.
_DEFAULTS = {"_ZERO": "(0.0, 0.0, 0.0)", "MappingProxyType({})": "{}", "mappingproxy({})": "{}"}


class FromPackage(SphinxDirective):
    """A directive that is replaced by reStructuredText."""

    required_arguments = 0
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Parse the text, headings included."""
        try:
            text = self.text(self.arguments[0].split() if self.arguments else [])
        except ValueError as error:
            raise self.error(str(error)) from error
        parsed: list[nodes.Node] = self.parse_text_to_nodes(text, allow_section_headings=True)
        return parsed

    def text(self, arguments: Sequence[str]) -> str:
        """Return the text that replaces the directive."""
        raise NotImplementedError


class PublicNames(FromPackage):
    """A table of the public names of some modules, then each with its docstring."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        names = names_of(arguments)
        described = [name for name in names if callable(_value(name))]
        listed = "\n".join(f"   ~{name}" for name in described)
        return "\n".join([
            f".. autosummary::\n   :nosignatures:\n\n{listed}\n",
            *(_documented(name) for name in names),
        ])  # fmt: skip


def _value(name: str) -> Any:
    """Return the object with a full public name."""
    module, _, own = name.rpartition(".")
    return getattr(importlib.import_module(module), own)


def _documented(name: str) -> str:
    value = _value(name)
    if inspect.isclass(value):
        more = "".join(f"\n   .. {kind}:: {name}.{one}\n" for one, kind in _inherited(value))
        return f".. autoclass:: {name}\n   :members:\n{more}"
    if callable(value):
        return f".. autofunction:: {name}\n"
    return _constant(name, value)


def _inherited(value: type) -> list[tuple[str, str]]:
    """Return the inherited members of a class inside the package, with their directives.

    These are constructors, and of a model its mechanical part.
    """
    return [
        (one, "autoproperty" if isinstance(what, property) else "automethod")
        for base in value.__mro__[1:]
        if base.__module__.startswith("flexfem")
        for one, what in vars(base).items()
        if not one.startswith("_")
        and one not in vars(value)
        and (isinstance(what, classmethod) or base is Structure)
    ]


def _constant(name: str, value: Any) -> str:
    """A constant, with the comment above it in its module and its items."""
    module = ModuleAnalyzer.for_module(f"flexfem.{PLACES[name]}")
    module.analyze()
    lines = [line for line in module.attr_docs.get(("", name.rpartition(".")[2]), []) if line]
    if isinstance(value, Analysis):
        lines.append(
            f"An analysis of a :class:`~flexfem.Case`, with the options of "
            f":class:`~flexfem.{value.settings.__name__}`."
        )
    elif isinstance(value, tuple):
        parts = (one.name if isinstance(one, Option) else str(one) for one in value)
        lines.append("Consists of " + ", ".join(f"``{part}``" for part in parts) + ".")
    return "\n".join([f".. py:data:: {name}\n", *(f"   {line}" for line in lines)]) + "\n"


class ParameterPaths(FromPackage):
    """A table of the numbers of things in models by which gradients are taken."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        kinds = {}
        for name in flexfem.__all__:
            value = getattr(flexfem, name)
            if inspect.isclass(value) and issubclass(value, _IN_MODELS) and is_dataclass(value):
                kinds[name] = [path for one in fields(value) if (path := _path(one))]
        rows = [
            f"   * - :class:`~flexfem.{name}`\n     - {', '.join(f'``{path}``' for path in paths)}"
            for name, paths in sorted(kinds.items())
            if paths
        ]
        head = ".. list-table::\n   :header-rows: 1\n\n   * - class\n     - numbers"
        return "\n".join([head, *rows, ""])


class ProbeColumns(FromPackage):
    """A table of the probes whose columns have derivatives, all or some of them."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        rows = []
        for name in sorted(flexfem.__all__):
            probe = getattr(flexfem, name)
            if inspect.isclass(probe) and issubclass(probe, AnyProbe):
                rows.append(f"   * - :class:`~flexfem.{name}`\n     - {_columns(probe)}")
        head = ".. list-table::\n   :header-rows: 1\n\n   * - probe\n     - derivatives"
        return "\n".join([head, *rows, ""])


def _columns(probe: type[AnyProbe]) -> str:
    """Which columns of a probe have derivatives."""
    if probe.differentiable is AnyProbe.differentiable:
        return "of all columns" if probe.smooth else "none"
    # only classes all of whose fields have defaults tell columns apart
    one = probe()
    chosen = [column.removeprefix(f"{one.name}_") for column in one.differentiable]
    return f"of {', '.join(chosen)}"


def _path(one: Field[Any]) -> str:
    """How a field of numbers is named in a path, empty for others."""
    kind = one.type.__name__ if isinstance(one.type, type) else str(one.type)
    given = kind.rpartition("Given[")[2]
    if not one.init or kind.startswith("collections.abc.Callable"):
        return ""
    if given.startswith("float"):
        return one.name
    return f"{one.name}[i]" if given.startswith(("ArrayLike", "Sequence[float]")) else ""


class Cases(FromPackage):
    """The shipped cases of one analysis: text and options of each."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        (analysis,) = arguments
        return "\n".join(_described(name, case) for name, case in cases_of(analysis).items())


def _described(name: str, case: Case) -> str:
    summary, *rest = (case.description or case.summary).partition("\n\n")
    text = inspect.cleandoc(rest[1]) if rest[1] else ""
    settings = ", ".join(f"``{key} = {value}``" for key, value in case.settings.items())
    parts = [f".. _case-{name}:\n", name, "~" * len(name), f"\n**{summary}**\n", text]
    if case.options:
        parts.append(_option_table(case.options))
    if settings:
        parts.append(f"\nDefaults of its analysis: {settings}.\n")
    return "\n".join(parts) + "\n"


class Gallery(FromPackage):
    """A picture, a sentence and the command of each example, or of each case of an analysis."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        (kind,) = arguments
        shown = list(examples() if kind == "examples" else cases_of(kind))
        said = sentences()
        entries = (_entry(name, said[name], examples=kind == "examples") for name in shown)
        return ".. container:: gallery\n\n" + "\n".join(entries)


def _entry(name: str, said: str, *, examples: bool) -> str:
    options = f" {SHORTER[name]}" if name in SHORTER else ""
    command = f"python examples/{name}.py" if examples else f"flexfem run {name}{options}"
    title = f"**{name}**" if examples else f":ref:`{name} <case-{name}>`"
    lines = [f".. figure:: /figures/gallery/{name}.png", f"   :alt: {name}\n",
             f"   {title}\n", f"   {_plain(said)}\n", f"   ``{command}``\n"]  # fmt: skip
    return "".join(f"   {line}\n" for text in lines for line in text.split("\n"))


def _option_table(options: Iterable[Option]) -> str:
    """Options with their admissible values, as a list table."""
    rows = ["\n.. list-table::", "   :header-rows: 1", "   :widths: 22 48 14 16\n"]
    rows += [_row("option", "", "default", "admissible")]
    for option in options:
        default = "–" if option.default in (None, "") else f"``{option.default}``"
        unit = f" [{option.unit}]" if option.unit else ""
        text = _plain(option.help) + unit
        rows += [_row(f"``{option.flag}``", text, default, _plain(option.describe()))]
    return "\n".join(rows) + "\n"


def _row(*cells: str) -> str:
    first, *others = cells
    return "\n".join([f"   * - {first}", *(f"     - {cell}" for cell in others)])


def _plain(text: str) -> str:
    """Text that marks nothing up."""
    return "".join(f"\\{letter}" if letter in "\\*`_|" else letter for letter in text)


class AnalysisOptions(FromPackage):
    """Options of a class of settings, such as ``RunOptions``."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        (name,) = arguments
        return _option_table(getattr(flexfem, name).OPTIONS)


class CommandHelp(FromPackage):
    """Output of ``flexfem ARGUMENTS --help``; without arguments that of every command."""

    def text(self, arguments: Sequence[str]) -> str:
        """See :meth:`FromPackage.text`."""
        if arguments:
            return _printed(arguments)
        names = [module.name for module in pkgutil.iter_modules(commands.__path__)]
        parts = [_printed([])]
        for name in names:
            summary = importlib.import_module(f"{commands.__name__}.{name}").SUMMARY
            title = f"flexfem {name}"
            parts += [title, "~" * len(title), f"\n{_plain(summary)}\n", _printed([name])]
        return "\n".join(parts)


def _printed(arguments: Sequence[str]) -> str:
    """Help of a command as a literal block."""
    out = io.StringIO()
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = _WIDTH
    try:
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            command([*arguments, "--help"])
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    lines = "\n".join(f"   {line}".rstrip() for line in out.getvalue().splitlines())
    return f".. code-block:: text\n\n{lines}\n"


def _plain_defaults(*event: Any) -> tuple[str, str | None] | None:
    """Signatures that need no knowledge of a module's own constants."""
    signature, returned = event[-2:]
    if signature is None:
        return None
    for name, said in _DEFAULTS.items():
        signature = signature.replace(f"= {name}", f"= {said}").replace(f"={name}", f"={said}")
    return signature, returned


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.connect("autodoc-process-signature", _plain_defaults)
    app.add_directive("public-names", PublicNames)
    app.add_directive("cases", Cases)
    app.add_directive("gallery", Gallery)
    app.add_directive("analysis-options", AnalysisOptions)
    app.add_directive("command-help", CommandHelp)
    app.add_directive("parameter-paths", ParameterPaths)
    app.add_directive("probe-columns", ProbeColumns)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
