# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies on ranks: even weights, few rows between them, in whatever order they are declared."""

from itertools import pairwise

import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.distributed.partition import partition_bodies

Links = dict[tuple[int, int], int]


def loads(ranks: list[np.ndarray], weights: list[int], count: int) -> list[int]:
    """Weight of each rank."""
    found = np.zeros(count, dtype=np.int64)
    for rank, weight in zip(ranks, weights, strict=True):
        found += weight * np.bincount(rank, minlength=count)
    return found.tolist()


def cut(ranks: list[np.ndarray], links: Links) -> int:
    """Rows between bodies on different ranks."""
    return sum(rows for (a, b), rows in links.items() if ranks[a][0] != ranks[b][0])


def ladder(rungs: int, order: np.ndarray) -> Links:
    """Two chains of bodies with rungs of 2 rows; rows along the chains count 3."""
    place = np.argsort(order)
    links = {(i, i + 1): 3 for side in (0, rungs) for i in range(side, side + rungs - 1)}
    links |= {(i, i + rungs): 2 for i in range(rungs)}
    return {(min(a, b), max(a, b)): rows for (i, j), rows in links.items()
            for a, b in [(int(place[i]), int(place[j]))]}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("ranks", [2, 3, 4])
@pytest.mark.parametrize("order", ["along", "alternating", "shuffled"])
def test_ladder_is_cut_across(order: str, ranks: int, rng: np.random.Generator) -> None:
    """Each cut meets the two chains only, 6 rows, in whatever order its 48 bodies come.

    In the order of the model the alternating ladder has up to 24 rungs of 2 rows between ranks.
    """
    number = {
        "along": np.arange(48).reshape(2, 24).T.ravel(),
        "alternating": np.arange(48),
        "shuffled": rng.permutation(48),
    }[order]
    links = ladder(24, number)
    found = partition_bodies([5] * 48, [1] * 48, links, ranks, split_above=100)
    assert loads(found, [1] * 48, ranks) == [240 // ranks] * ranks
    assert cut(found, links) == 6 * (ranks - 1)
    assert [r[0] for r in found] == [
        r[0] for r in partition_bodies([5] * 48, [1] * 48, links, ranks, 100)
    ]


@pytest.mark.serial
@pytest.mark.parametrize("shuffled", [False, True])
def test_nets_are_cut_straight(shuffled: bool, rng: np.random.Generator) -> None:
    """A square of 30 x 30 bodies, 3 rows between neighbours; halves grown from a corner: 111."""
    place = np.arange(900)
    if shuffled:
        rng.shuffle(place)
    place = place.reshape(30, 30)
    pairs = np.concatenate(
        [np.stack([a.ravel(), b.ravel()], axis=1) for a, b in (
            (place[1:], place[:-1]), (place[:, 1:], place[:, :-1])
        )]
    )  # fmt: skip
    links = {(int(a), int(b)): 3 for a, b in np.sort(pairs, axis=1)}
    found = partition_bodies([5] * 900, [1] * 900, links, 2, split_above=100)
    assert loads(found, [1] * 900, 2) == [2250, 2250]
    assert cut(found, links) == 3 * 30


@pytest.mark.serial
def test_weights_are_even(rng: np.random.Generator) -> None:
    """Bodies of 1 to 30 elements in a ring: no rank has 5 % more than its share of them."""
    elements = rng.integers(1, 31, 120).tolist()
    links = {(min(a, b), max(a, b)): 5 for a, b in pairwise([*range(120), 0])}
    for ranks in (2, 3, 5, 8):
        found = partition_bodies(elements, [1] * 120, links, ranks, split_above=100)
        assert max(loads(found, [1] * 120, ranks)) < 1.05 * sum(elements) / ranks
        # a ring has as many ends as parts at least; the order of the model would do here as well
        assert cut(found, links) <= 5 * 2 * ranks


@pytest.mark.serial
def test_split_bodies_fill_ranks_and_others_the_rest() -> None:
    """Of 100 + 20 + 20 elements on 2 ranks one body is cut after 70; the others share the rest."""
    found = partition_bodies([20, 100, 20], [1, 1, 1], {(0, 2): 3}, 2, split_above=50)
    assert np.bincount(found[1]).tolist() == [70, 30]
    assert (np.diff(found[1]) >= 0).all()
    assert found[0].tolist() == found[2].tolist() == [1] * 20
    whole = partition_bodies([20, 100, 20], [1, 1, 1], {(0, 2): 3}, 2, split_above=100)
    assert loads(whole, [1, 1, 1], 2) == [40, 100]


@pytest.mark.serial
def test_small_parts_go_with_their_neighbours() -> None:
    """A hub of one element stays with its beam: 6 rows between ranks would cost more than it."""
    found = partition_bodies([1, 40], [1, 1], {(0, 1): 12}, 2, split_above=100)
    assert [rank[0] for rank in found] == [0, 0]


def frame(order: list[int]) -> ff.Model:
    """A lattice girder of 4 bays, rigidly joined, its 13 beams declared in some order."""
    lower = [(x, 0.0, 0.0) for x in range(4)]
    upper = [(x, 0.0, 1.0) for x in range(4)]
    ends = [*pairwise(lower), *pairwise(upper), *zip(lower, upper, strict=True)]
    ends += [(lower[0], upper[1]), (lower[1], upper[2]), (lower[2], upper[3])]
    lines = {f"beam_{i}": np.linspace(ends[i][0], ends[i][1], 4) for i in order}
    points = np.concatenate(list(lines.values()))
    first = 4 * np.arange(len(order))[:, np.newaxis] + np.arange(3)
    cells = np.stack([first, first + 1], axis=-1).reshape(-1, 2)
    groups = {name: 3 * i + np.arange(3) for i, name in enumerate(lines)}
    model = ff.Model("girder", mesh=ff.LineMesh(points, cells, groups))
    section = ff.Section.circle(0.01, ff.Material(210e9, 0.3, 7850.0))
    held: dict[tuple[float, ...], ff.Marker] = {}
    for i in order:
        model.add(ff.Beam(f"beam_{i}", section, orientation=(0.0, 1.0, 0.0)))
        for side, point in zip(("start", "end"), ends[i], strict=True):
            marker = ff.Marker(f"beam_{i}", side)
            if point in held:
                model.add(ff.Rigid(f"{side}_{i}", held[point], marker))
            held.setdefault(point, marker)
    model.add(ff.Rigid("wall", ff.Ground(lower[0]), held[lower[0]]))
    model.add(ff.Gravity((0.0, 0.0, -9.81)), ff.PositionProbe("tip", held[upper[3]]))
    return model


def shared_by_hand(system: object, comm: object) -> int:
    """Multipliers whose rows several ranks evaluate, counted by their global numbers."""
    numbers = comm.allgather(system.constraints.numbers)  # type: ignore[attr-defined]
    every, seen = np.unique(np.concatenate(numbers), return_counts=True)
    # numbered without gaps: matrices of all multipliers have no empty rows
    np.testing.assert_array_equal(every, np.arange(system.multipliers))  # type: ignore[attr-defined]
    return int((seen > 1).sum())


def check_steps(system: object) -> None:
    """Steps of nodes arrive wherever joints need them, those of other ranks' nodes as well."""
    for part in system.parts:  # type: ignore[attr-defined]
        part.block.step[: part.block.owned] = part.block.node_ids[: part.block.owned, np.newaxis]
    interface = system.interface  # type: ignore[attr-defined]
    interface.steps[:] = -1.0
    interface.update_steps()
    expected = np.array([node for _, node in interface.keys], dtype=np.float64)
    np.testing.assert_array_equal(interface.steps, np.repeat(expected[:, np.newaxis], 6, axis=1))


def test_summary_counts_the_multipliers_between_ranks() -> None:
    """Every order gives the same motion, and says how many multipliers lie between ranks.

    The girder can be cut through a bay: 3 of its 13 beams, with the joints at two points.
    """
    from mpi4py import MPI

    from flexfem.simulation.motion.stepping import Simulation

    comm = MPI.COMM_WORLD
    tips = []
    for order in (list(range(13)), list(range(13))[::-1], [*range(0, 13, 2), *range(1, 13, 2)]):
        model, options = frame(order), ff.RunOptions(dt=1e-3, t_end=5e-3, quiet=True)
        outcome = ff.simulate(model, options)
        shared = outcome.summary["shared_rows"]
        system = Simulation(model, options).system
        assert shared == shared_by_hand(system, comm)
        check_steps(system)
        # of the 138 multipliers all but those of the wall are between ranks in the worst case
        assert (0 if comm.size == 1 else 12) <= shared <= 36 * (comm.size - 1)
        tips.append(comm.bcast(outcome.history))
    for name, values in tips[0].items():
        for other in tips[1:]:
            # other partitions change rounding alone
            np.testing.assert_allclose(
                other[name], values, rtol=0.0, atol=1e-9 * np.abs(values).max()
            )
