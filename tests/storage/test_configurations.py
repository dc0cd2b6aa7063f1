import dataclasses

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.sampling import cloud_of
from cutgrammar.storage.configurations import TrialConfigurations, decode, encode
from cutgrammar.storage.ledger import Ledger, read_configurations
from cutgrammar.trials.record import TrialKey, record_of_death

KEY = TrialKey("N1M1", 3, "in-place", "random", 0, "bench", "truth", "0")


def a_record(key):
    return record_of_death(key, 4, package="0.1.0", reason="gone", traceback="", scores=())


@pytest.fixture
def configurations(lump, random_pose):
    one, two = Fragment(lump, random_pose()), Fragment(lump, random_pose())
    return TrialConfigurations((one,), (one, two), (two, one, two))


def test_a_configuration_comes_back_to_single_precision(configurations):
    for told, found in zip(configurations.reached, decode(encode(configurations.reached)), strict=True):
        assert np.abs(told.mesh.vertices - found.mesh.vertices).max() < 1e-8
        assert (told.mesh.faces == found.mesh.faces).all()
        assert (told.X_WF.rotation == found.X_WF.rotation).all()
        assert (told.X_WF.position == found.X_WF.position).all()


def test_other_content_is_refused():
    with pytest.raises(ValueError, match="not a configuration"):
        decode(b"something else")


def test_the_ledger_keeps_the_start_the_goal_and_the_configuration_reached(tmp_path, configurations):
    path, other = tmp_path / "ledger.sqlite", dataclasses.replace(KEY, run=1)
    unknown = dataclasses.replace(KEY, run=2)
    with Ledger(path) as ledger:
        for key in (KEY, other):
            ledger.add(a_record(key), configurations)
        ledger.add(a_record(unknown))
        (stored,) = ledger._connection.execute("SELECT count(*) FROM contents").fetchone()
    assert stored == 3, "equal contents are kept once"
    for key in (KEY, other):
        found = read_configurations(path, key)
        assert [len(side) for side in (found.start, found.goal, found.reached)] == [1, 2, 3]
    assert read_configurations(path, unknown) is None


def test_point_clouds_are_not_kept(tmp_path, configurations):
    cloud = (Fragment(cloud_of(configurations.start[0].mesh, 64), configurations.start[0].X_WF),)
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.add(a_record(KEY), dataclasses.replace(configurations, goal=cloud))
    assert read_configurations(path, KEY) is None


def test_torn_configurations_are_refused_with_the_name_of_the_trial(tmp_path, configurations):
    path = tmp_path / "ledger.sqlite"
    with Ledger(path) as ledger:
        ledger.add(a_record(KEY), configurations)
        ledger._connection.execute("UPDATE contents SET content = x'00'")
        ledger._connection.commit()
    with pytest.raises(InputError, match=f"the configurations of {KEY.name} are torn"):
        read_configurations(path, KEY)
