# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of the cases of contact, and what they refuse."""

import pytest

from flexfem.case import load_case
from flexfem.model.model import Model

pytestmark = pytest.mark.serial


def built(name: str, **given: object) -> Model:
    case = load_case(name)
    values = case.values(given)
    return case.build(**{option.name: values[option.name] for option in case.options})


def test_ropes_that_may_overlap_are_refused() -> None:
    with pytest.raises(ValueError, match=r"spacing must be above 0.045.* 2 degrees .* got 0.1 and"):
        built("rope_heap", tilt=2.0, spacing=0.04)
