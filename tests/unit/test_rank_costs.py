# SPDX-License-Identifier: LGPL-3.0-or-later
"""Counts of what iterations on many ranks send, found without these ranks."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import pytest

import flexfem as ff
from flexfem.cli.commands.info import execute
from flexfem.cli.usage import UsageError
from flexfem.inspection.rank_costs import rank_costs
from flexfem.layout.numbered_model import NumberedModel
from flexfem.mesh.distributed.rank_tree import merges

COMM = MPI.COMM_WORLD
CASES = Path(__file__).resolve().parents[2] / "cases"


def chain(links: int) -> ff.Model:
    sys.path.insert(0, str(CASES))
    import chain as case

    model: ff.Model = case.CASE.model(links=links, elements=2)
    return model


def net(cells: int) -> ff.Model:
    """Beams between the crossings of a square net: rows of several ranks meet at a node."""
    ends = {
        f"{axis}_{i}_{j}": ((float(i), float(j), 0.0), (float(i + di), float(j + dj), 0.0))
        for axis, di, dj in (("x", 1, 0), ("y", 0, 1))
        for i in range(cells + 1 - di) for j in range(cells + 1 - dj)
    }  # fmt: skip
    model = ff.Model("net", mesh=ff.LineMesh.straight(ends, 2))
    section = ff.Section.rectangle(0.05, 0.05, ff.Material(1e9, 0.3, 1000.0))
    at: dict[tuple[float, ...], ff.Marker] = {}
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for name, places in ends.items():
        model.add(ff.Beam(name, section, orientation=(0.0, 0.0, 1.0)))
        for place, end in zip(places, ("start", "end"), strict=True):
            marker = ff.Marker(name, end)
            if place in at:
                model.add(ff.Rigid(f"{name}_{end}", at[place], marker))
            at.setdefault(place, marker)
    model.add(ff.Spherical("corner", ff.Ground(), ff.Marker("x_0_0", "start")))
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("build", [chain, net])
def test_iterations_send_what_is_counted(build: Callable[[int], ff.Model]) -> None:
    """Every message and byte: exchanged nodes, and right-hand sides and complements of rows."""
    model = build(4)
    expected = rank_costs(NumberedModel(model), COMM.size, 4000)
    summary = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1e-2, quiet=True)).summary
    assert summary["shared_rows"] == expected.shared_rows
    assert summary["largest_shared_front"] == expected.as_dict()["largest_front"]
    iterations = summary["newton_iterations"]

    def most(what: str, factors: int) -> int:
        """The largest number of a rank."""
        return max(
            iterations * getattr(one, what) + factors * getattr(one, f"factor_{what}")
            for one in expected.of_ranks
        )

    # the rows are factorised once a step at least, and once an iteration at most
    found = [round(iterations * summary[f"{what}_per_iteration"]) for what in ("messages", "bytes")]
    assert found in [
        [most("messages", factors), most("bytes", factors)]
        for factors in range(summary["steps"], iterations + 1)
    ]
    assert summary["reductions_per_iteration"] == (1.0 if COMM.size > 1 else 0.0)
    if COMM.size > 1:
        assert summary["multiplier_elimination"] == "banded"


@pytest.mark.serial
@pytest.mark.parametrize("size", [1, 2, 3, 5, 8, 13, 24])
def test_all_ranks_hear_from_all_others_once(size: int) -> None:
    """A tree that leaves out a rank, or hears one twice, adds up wrong matrices."""
    known = {(rank, rank + 1): frozenset({rank}) for rank in range(size)}
    for rank in range(size):
        heard = {rank}
        for merge in merges(rank, size):
            assert merge.own[0] <= rank < merge.own[1]
            assert merge.other[0] <= merge.source < merge.other[1]
            source = next(m for m in merges(merge.source, size) if m.own == merge.other)
            assert rank in source.to
            heard |= set(range(*merge.other))
            assert known.setdefault(merge.whole, frozenset(heard)) == heard
        assert heard == set(range(size))


@pytest.mark.serial
def test_costs_of_a_chain_on_a_thousand_ranks() -> None:
    """A front holds the rows of three cuts, whatever the number of ranks."""
    costs = rank_costs(NumberedModel(chain(64)), 1024, 4000).as_dict()
    assert (costs["shared_rows"], costs["largest_front"]) == (3 * 63, 9)
    assert costs["share"] == 16.0  # 64 of the ranks have a link each
    assert costs["messages"] == 2 + 6  # the other levels have no rows


@pytest.mark.serial
def test_fronts_are_sent_alone_where_there_are_contacts() -> None:
    """Springs of contacts come between factors and right-hand sides."""
    apart, touching = chain(8), chain(8)
    touching.add(ff.Contact("ground", surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -100.0)))))
    for model, expected in ((apart, 0), (touching, 3)):
        costs = rank_costs(NumberedModel(model), 8, 4000).as_dict()
        assert (costs["messages"], costs["factor_messages"]) == (5, expected)


@pytest.mark.serial
def test_info_lists_the_costs(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["chain", "--links", "16", "--ranks", "1,8"], "flexfem info") == 0
    one, eight, apart = capsys.readouterr().out.split("bytes more\n")[1].splitlines()[:3]
    assert one.split() == ["1", "1.00", "0", "0", "0", "0", "+0", "0"]
    assert eight.split() == ["8", "1.00", "21", "9", "5", "504", "+0", "672"]
    assert apart.startswith("besides: closed contacts, bodies that are split over ranks")
    assert execute(["chain", "--json", "--ranks=8"], "flexfem info") == 0
    assert json.loads(capsys.readouterr().out)["ranks"][0]["ranks"] == 8


@pytest.mark.serial
@pytest.mark.parametrize("text", ["", "0", "2,x", "-1", "1000000", "1.5"])
def test_ranks_that_are_no_numbers_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match=f"--ranks: takes whole numbers .* not '{text}'"):
        execute(["chain", "--ranks", text], "flexfem info")
