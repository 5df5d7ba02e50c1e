"""Studies on executors of several kinds: prepared once a worker, resumed after a kill, unharmed by a lost worker."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from processes import started

from matching.studies import run
from matching.worker_pool import executor_of
from modelling.errors import InputError

sys.path.insert(0, str(Path(__file__).parent))
import slow

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def squares(rows):
    return [row["square"] for row in rows]


def test_processes_prepare_once_and_keep_the_order():
    done = []
    with executor_of(2) as executor:
        rows = run(
            slow.square, slow.prepare, 0.01, list(range(12)), executor, content="a",
            progress=lambda now, total: done.append((now, total)),
        )  # fmt: skip
    assert squares(rows) == [n**2 for n in range(12)]
    assert len({row["prepared"] for row in rows}) == len({row["pid"] for row in rows}) <= 2
    assert done[-1] == (12, 12)


def test_what_is_on_record_is_not_done_again(tmp_path):
    record = tmp_path / "record.jsonl"
    with ThreadPoolExecutor(1) as executor:
        first = run(slow.square, slow.prepare, 0.0, [1, 2, 3], executor, content="a", record=record)
        with record.open("a") as file:
            file.write('{"study": "half a li')  # as a kill leaves it
        again = run(slow.square, slow.prepare, 0.0, [1, 2, 3, 4], executor, content="a", record=record)
        assert again[:3] == first
        assert len(record.read_text().splitlines()) == 4
        other = run(slow.square, slow.prepare, 0.0, [1, 2], executor, content="b", record=record)
        assert squares(other) == [1, 4]
        assert len(record.read_text().splitlines()) == 6  # another study is not mixed up with it


def test_a_killed_worker_is_one_line_and_the_same_study_goes_on(tmp_path):
    record, died = tmp_path / "record.jsonl", str(tmp_path / "died")

    def study():
        with executor_of(1) as executor:
            return run(slow.once, slow.prepare, 0.0, [1, died, 3], executor, content="a", record=record)

    with pytest.raises(InputError, match=r"a worker process was killed.*the same command goes on from there"):
        study()
    assert study() == [1, died, 3]
    assert Path(died).read_text() == "1"


STUDY = """
import sys
sys.path.insert(0, {here!r})
import slow
from pathlib import Path
from matching.worker_pool import executor_of
from matching.studies import run
if __name__ == "__main__":
    with executor_of(1) as executor:
        rows = run(slow.square, slow.prepare, 0.1, list(range(8)), executor, content="k", record=Path({record!r}))
    print([row["square"] for row in rows])
"""


def test_a_killed_study_goes_on_where_it_was(tmp_path):
    record, script = tmp_path / "record.jsonl", tmp_path / "study.py"
    script.write_text(STUDY.format(here=str(HERE), record=str(record)))
    words, where = [sys.executable, str(script)], {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}"}
    with started(words, env=where | {"SLOW_STOPS_AT": "4"}, stderr=subprocess.DEVNULL):  # killed at the end
        deadline = time.monotonic() + 200  # on a busy machine
        while time.monotonic() < deadline and (not record.exists() or len(record.read_text().splitlines()) < 2):
            time.sleep(0.05)
    before = record.read_text().splitlines()
    assert 2 <= len(before) < 8
    done = subprocess.run(words, env=where, capture_output=True, text=True, check=True, timeout=200)
    assert done.stdout.strip() == str([n**2 for n in range(8)])
    after = [json.loads(line)["chunk"] for line in record.read_text().splitlines()]
    assert sorted(after) == sorted(str(n) for n in range(8))  # each chunk once


@pytest.mark.long
def test_a_dask_cluster_loses_a_worker_midway_and_the_result_is_the_same(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(HERE), os.environ.get("PYTHONPATH", "")]))
    killed = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:

        def kill(now, total):
            if not killed and now >= 3:
                pid = next(iter(cluster.workers.values())).pid
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)

        with executor_of(scheduler=cluster.scheduler_address) as executor:
            rows = run(slow.square, slow.prepare, 0.2, list(range(16)), executor, content="d", progress=kill)
    assert killed
    assert squares(rows) == [n**2 for n in range(16)]
    assert any(row["pid"] != killed[0] for row in rows)


def test_a_scheduler_that_is_not_there_is_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("matching.worker_pool.SCHEDULER_SECONDS", 1)
    with pytest.raises(InputError, match="does not answer"), executor_of(scheduler="tcp://127.0.0.1:9"):
        pass


def test_without_dask_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="Dask is not installed"), executor_of(scheduler="tcp://127.0.0.1:8786"):
        pass
