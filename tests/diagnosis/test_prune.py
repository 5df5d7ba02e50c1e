"""The end of a search."""

from types import SimpleNamespace

from matching.diagnosis import search as prune


def test_when_the_time_is_over_every_cause_stands_without_rivals(monkeypatch) -> None:
    best = SimpleNamespace(causes=("lash", "friction"))
    state = SimpleNamespace(best=best, rivals=[])
    monkeypatch.setattr(prune, "search_is_over", lambda: True)
    prune.drop_and_exchange(state, unseen=None, budget=None, progress=None)
    assert state.rivals == [[best], [best]]
