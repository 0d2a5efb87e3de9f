# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem copy: copies of shipped cases, to be changed."""

from collections.abc import Sequence
from pathlib import Path

from flexfem import launch
from flexfem.case import case_file
from flexfem.cli.usage import Parser, UsageError
from flexfem.io.case_copy import copy_case
from flexfem.resources import shipped_files

SUMMARY = "copy a case and the scripts of its meshes: flexfem copy NAME [FILE]"
_TEXT = """\
Copy a shipped case, and the scripts that make its meshes, to files that can be changed at will:
"flexfem run FILE" runs the copy. Files that exist are not replaced.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Copy and print the names of the files."""
    parser = Parser(prog=prog, description=_TEXT)
    parser.add_argument("name", metavar="NAME", help="a case of 'flexfem list'")
    parser.add_argument(
        "file", metavar="FILE", type=Path, nargs="?", help="the copy (default: NAME.py here)"
    )
    options = parser.parse_args(argv)
    message, files = "", []
    if launch.rank() == 0:
        try:
            if options.name not in shipped_files("cases"):
                case_file(options.name)  # raises, with a hint
                raise ValueError(f"'{options.name}' is a file: copies are made of shipped cases")
            files = copy_case(case_file(options.name), options.file or Path(f"{options.name}.py"))
        except FileExistsError as error:
            message = f"'{error.filename}' exists, a copy does not replace it"
        except (OSError, ValueError) as error:
            message = str(error)
    if message := launch.first_message(message):
        raise UsageError(message, agreed=True)
    for file in files:
        launch.say(str(file))
    return 0
