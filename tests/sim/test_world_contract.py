"""Laws that every world keeps: the bench, the board and the arm."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Failed, Refused
from cutgrammar.plugins import WORLDS, load, names_in, reference_of
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings

X, Y, Z = np.eye(3)
BY_ARM = pytest.param("kinova", marks=pytest.mark.slow)
SLOW_BY_ARM = pytest.mark.parametrize("make", ["bench", "board", BY_ARM], indirect=True)


def bar(x=0.0, y=0.0, size=(0.08, 0.03, 0.02), z=None):
    shape = trimesh.creation.box(size)
    height = size[2] / 2 if z is None else z
    return Fragment(Mesh(shape.vertices, shape.faces), Pose(np.eye(3), [x, y, height]))


def cut_through(*fragments, normal, shift=0.0):
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    point = fragments[0].p_WC + shift * normal
    return Cut(Plane.through(point, normal), np.array([f.p_WC for f in fragments]))


def products(result):
    """Number of products of a cut in any world."""
    assert isinstance(result, Done), result
    return result.products


def fingerprint(configuration):
    numbers = [a.tobytes() for f in configuration for a in (f.X_WF.to_vector(), f.mesh.vertices, f.mesh.faces)]
    return hashlib.sha256(b"".join(numbers)).hexdigest()


def cut_at_random(make, seed, cuts):
    """A trial of random cuts; returns the result of every call and the final poses."""
    world, rng = make(), np.random.default_rng(seed)
    world.reset((bar(), bar(0.0, 0.08)))
    results = []
    for _ in range(cuts):
        now = world.observe()
        results.append(world.apply(cut_through(now[rng.integers(len(now))], normal=rng.normal(size=3))))
    return results, world


def at_random_on(name):
    results, world = cut_at_random(lambda: load(reference_of(WORLDS, name))(Settings(), None), 3, 6)
    return repr(results) + fingerprint(world.truth())


@pytest.fixture(params=["bench", "board", "kinova"])
def make(request):
    maker = load(reference_of(WORLDS, request.param))
    return lambda settings=None: maker(settings or Settings(), lambda *names: stream(0, *names))


def test_the_contract_covers_all_worlds():
    assert set(names_in(WORLDS)) >= {"bench", "board", "kinova"}


def test_a_world_observes_what_was_laid_out(make):
    start = (bar(), bar(0.0, 0.06, size=(0.05, 0.03, 0.03)))
    world = make()
    world.reset(start)
    for seen in (world.observe(), world.truth()):
        assert [f.mesh for f in seen] == [f.mesh for f in start]
        for now, then in zip(seen, start, strict=True):
            assert now.p_WC == pytest.approx(then.p_WC, abs=2e-4)


def test_products_take_the_place_of_their_parent(make):
    world = make()
    world.reset((bar(0, -0.15), bar(), bar(0, 0.15)))
    before = world.truth()
    assert products(world.apply(cut_through(before[1], normal=X))) == 2
    after = world.truth()
    assert len(after) == 4
    assert (after[0].mesh, after[3].mesh) == (before[0].mesh, before[2].mesh)
    assert after[1].p_WC[0] > 0.01 > -0.01 > after[2].p_WC[0]
    assert [f.mesh.volume for f in after[1:3]] == pytest.approx([before[1].mesh.volume / 2] * 2, rel=1e-3)
    assert sum(f.mesh.volume for f in after[1:3]) == pytest.approx(before[1].mesh.volume, rel=1e-9)


@pytest.mark.parametrize(
    ("where", "normal", "offset", "reason"),
    [
        ([0.0, 0.3, 0.01], X, 0.0, "no fragment lies there"),
        ([0.0, 0.0, 0.01], X, -0.06, "the plane misses the fragment"),
        ([0.0, 0.0, 0.01], X, -0.03999, "grazes"),
    ],
)
def test_a_refusal_changes_nothing_and_says_why(make, where, normal, offset, reason):
    world = make()
    world.reset((bar(), bar(0.0, 0.05)))
    before = fingerprint(world.truth())
    result = world.apply(Cut(Plane(normal, offset), np.array([where])))
    assert isinstance(result, Refused)
    assert reason in result.reason
    assert fingerprint(world.truth()) == fingerprint(world.observe()) == before


def test_a_cut_that_names_nothing_is_refused(make):
    world = make()
    world.reset((bar(),))
    assert isinstance(world.apply(Cut(Plane(X, 0.0), np.zeros((0, 3)))), Refused)


def test_only_fragments_meant_are_cut(make):
    world = make()
    world.reset((bar(0, -0.05), bar(), bar(0, 0.05)))
    a, b, c = world.truth()
    assert products(world.apply(cut_through(b, normal=X))) == 2  # the plane crosses all three
    assert world.truth()[0].mesh is a.mesh
    assert world.truth()[3].mesh is c.mesh


def test_a_cut_may_mean_several_fragments(make):
    world = make()
    world.reset((bar(0, -0.03), bar(0, 0.03)))
    assert products(world.apply(cut_through(*world.truth(), normal=X))) == 4
    assert len(world.truth()) == 4


def test_a_cut_can_yield_three_products(make):
    legs = [
        trimesh.creation.box((0.02, 0.04, 0.02)).apply_translation([x, y, 0.01])
        for x, y in ((-0.02, 0.02), (0.02, 0.02))
    ]
    arch = trimesh.boolean.union([*legs, trimesh.creation.box((0.03, 0.01, 0.02)).apply_translation([0, 0.005, 0.01])])
    world = make()
    world.reset((Fragment(Mesh(arch.vertices, arch.faces), Pose.identity()),))
    now = world.truth()[0]
    assert products(world.apply(Cut(Plane(Y, -0.02), now.p_WC[None]))) == 3


def test_a_plane_beside_the_centroid_still_means_the_fragment(make):
    world = make()
    world.reset((bar(), bar(0.0, 0.05)))
    assert products(world.apply(cut_through(world.truth()[0], normal=X, shift=0.03))) == 2


def test_a_neighbour_is_not_cut_in_place_of_the_fragment_meant(make):
    world = make()
    world.reset((bar(0, 0, (0.004, 0.03, 0.02)), bar(0.006, 0, (0.004, 0.03, 0.02))))
    result = world.apply(Cut(Plane(X, -world.truth()[1].p_WC[0]), world.truth()[0].p_WC[None]))
    assert result == Refused("the plane misses the fragment")


@SLOW_BY_ARM
def test_random_cuts_conserve_volume_and_stay_on_the_board(make):
    results, world = cut_at_random(make, 7, 12)
    after = world.truth()
    assert sum(f.mesh.volume for f in after) == pytest.approx(2 * 0.08 * 0.03 * 0.02, rel=1e-9)
    assert not any(isinstance(answer, Failed) for answer in results)
    assert len(after) == 2 + sum(answer.products - 1 for answer in results if isinstance(answer, Done))
    assert all(np.linalg.norm(f.p_WC) < 0.3 for f in after)


@SLOW_BY_ARM
def test_the_same_trial_gives_the_same_bits_after_other_trials(make):
    def play(seed):
        results, world = cut_at_random(make, seed, 6)
        return repr(results) + fingerprint(world.truth())

    first = play(3)
    play(4)
    assert play(3) == first


def test_a_reset_world_behaves_like_a_new_one(make):
    world = make()
    prints = []
    for _ in range(2):
        world.reset((bar(),))
        world.apply(cut_through(world.truth()[0], normal=[1, 0.3, 0.2]))
        prints.append(fingerprint(world.truth()))
    assert prints[0] == prints[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bench", "board", "kinova"])
def test_another_process_gives_the_same_bits(name):
    code = f"""import importlib.util as u
s = u.spec_from_file_location("contract", {__file__!r})
m = u.module_from_spec(s)
s.loader.exec_module(m)
print(m.at_random_on({name!r}))"""
    seen = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert seen == at_random_on(name)
