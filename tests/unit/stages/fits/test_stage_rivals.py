"""What the rivals of fit-actuator are told of how they are to be fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from hqpipe.gap import diagnosed
from hqpipe.identify.rivals import fit_chambers
from hqpipe.stages.fits import rivals

SETTINGS = rivals.Settings(effort_limit={"hip": 300.0}, window_s=0.04, iterations=(1, 1), seed=0, workers=1)


@dataclass(frozen=True)
class Logs:
    """As much of a log set as the stage looks at itself."""

    trials: tuple = ()
    fit: tuple = ()


@pytest.mark.parametrize(
    ("name", "module", "function"),
    [("two_chamber", fit_chambers, "fit_chambers"), ("diagnosed", diagnosed, "fit_diagnosed")],
)
def test_window_and_limits_reach_the_fit_in_the_table_and_in_the_data_curve(monkeypatch, name, module, function):
    asked = []

    def fitted(log_set, **options):
        asked.append(options)
        return SimpleNamespace(model="model", posterior=None, fits=())

    monkeypatch.setattr(module, function, fitted)
    monkeypatch.setattr(rivals, "in_processes", lambda task, calls, *_: [task(*given) for given in calls.values()])
    monkeypatch.setattr(rivals.WorkerPool, "call", lambda pool, name, task, *given: task(*given))
    rivals.fit_rivals(Logs(), [name], SETTINGS, lambda title: None)
    with rivals.rival_fits([name], replace(SETTINGS, window_s=0.2)) as fits:
        fits[rivals.TITLES[name]](Logs())
    assert [options["window_s"] for options in asked] == [0.04, 0.2]
    assert [options["effort_limit"] for options in asked] == [{"hip": 300.0}] * 2
