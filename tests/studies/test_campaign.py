"""The diagnosis campaign on executors: rows as they come, resumed, the same from a cluster; one recording for real."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from plant.marks import needs_compiler

from matching.worker_pool import executor_of
from tests.campaign.run import Campaign, run

ROOT = Path(__file__).parents[2]
KEYS = {"number", "order", "seconds", "found", "answer"}


class Quick:
    """In place of a diagnosis, for what has nothing to do with it."""

    def to_dict(self):
        return {"causes": [], "verdict": "adequate"}


@needs_compiler
def test_a_campaign_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    asked, progress = [], []
    monkeypatch.setattr("matching.diagnosis.diagnose.diagnose", lambda *given: asked.append(given) or Quick())
    campaign = Campaign(cases=6, seed=1, seconds=0.5)
    with ThreadPoolExecutor(2) as executor:
        before = run(campaign, tmp_path, executor, first=3)
        rows = run(campaign, tmp_path, executor, progress=lambda done, of: progress.append((done, of)))
    assert rows[:3] == before
    assert [row["number"] for row in rows] == list(range(6))
    assert all(set(row) == KEYS for row in rows if "failed" not in row)
    assert len(asked) == sum("found" in row for row in rows)
    assert progress == [(3, 6), (4, 6), (5, 6), (6, 6)]


@pytest.mark.long
@needs_compiler
def test_a_cluster_makes_the_same_recordings(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    campaign = Campaign(cases=2, seed=1, seconds=1.0)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        with executor_of(scheduler=cluster.scheduler_address) as executor:
            run(campaign, tmp_path / "cluster", executor, make_only=True)
        with ThreadPoolExecutor(1) as executor:
            run(campaign, tmp_path / "here", executor, make_only=True)
    made = sorted(path.relative_to(tmp_path / "here") for path in (tmp_path / "here").rglob("*.*") if path.is_file())
    assert len(made) >= 3
    assert all((tmp_path / "cluster" / own).read_bytes() == (tmp_path / "here" / own).read_bytes() for own in made)


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path):
    words = [sys.executable, "-m", "tests.campaign", "--cases", "1", "--scheduler", "nowhere", "--out", str(tmp_path)]
    told = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert told.returncode == 2
    assert "does not answer" in told.stderr
    assert "Traceback" not in told.stderr
