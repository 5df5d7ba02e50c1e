"""Studies on executors of several kinds: prepared once a worker, resumed after a kill, unharmed by a lost worker."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from matching import studies as records
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


def summed(row):
    """A line of another build with a right checksum."""
    row.pop("sha256", None)
    return json.dumps(row | {"sha256": hashlib.sha256(json.dumps(row).encode()).hexdigest()[:32]}).encode()


@pytest.mark.parametrize("damage", [
    lambda line: line.replace(b'"square": 4', b'"square": 5'), lambda line: line[:-9], lambda line: b"",
    lambda line: b"nonsense", lambda line: line.replace(b'"sha256"', b'"sha255"'), lambda line: b"\xff" + line,
    lambda line: b'{"study": 1, "chunk": [], "result": {}}', lambda line: b"[" * 5000, lambda line: b"null",
    lambda line: summed({"step": "1_match"}), lambda line: summed({**json.loads(line), "chunk": [2]}),
], ids=range(11))  # fmt: skip
def test_a_damaged_line_of_a_record_is_computed_anew(tmp_path, damage):
    record, worked = tmp_path / "record.jsonl", []

    def work(_, chunk):
        worked.append(chunk)
        return {"square": chunk**2}

    def studied():
        with ThreadPoolExecutor(1) as executor:
            return squares(run(work, slow.prepare, 0.0, [1, 2, 3], executor, content="a", record=record))

    assert studied() == [1, 4, 9]
    lines = record.read_bytes().split(b"\n")
    record.write_bytes(b"\n".join([lines[0], damage(lines[1]), *lines[2:]]))
    assert studied() == [1, 4, 9]
    assert studied() == [1, 4, 9]
    assert worked == [1, 2, 3, 2]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("kind", ["link", "broken link", "pipe", "folder"])
def test_a_record_is_a_file_of_ours_alone(tmp_path, kind):
    record, elsewhere = tmp_path / "record.jsonl", tmp_path / "elsewhere"
    if kind == "link":
        elsewhere.write_text("mine")
    if "link" in kind:
        record.symlink_to(elsewhere)
    elif kind == "pipe":
        os.mkfifo(record)
    else:
        record.mkdir()
    for step in (lambda: records.rows(record, {}), lambda: records.append(record, {"a": 1})):
        with pytest.raises(InputError, match=r"record\.jsonl: is no file of ours; remove it"):
            step()
    assert kind == "folder" or not elsewhere.exists() or elsewhere.read_text() == "mine"


def test_a_killed_worker_costs_nothing_but_time(tmp_path):
    record, died = tmp_path / "record.jsonl", str(tmp_path / "died")
    with executor_of(1) as executor:
        rows = run(slow.once, slow.prepare, 0.0, [1, died, 3], executor, content="a", record=record)
    assert rows == [1, died, 3]
    assert Path(died).read_text() == "1"


def test_workers_that_are_killed_again_and_again_are_one_line_that_says_how_to_go_on(tmp_path, monkeypatch):
    monkeypatch.setattr("matching.studies.MOST_LOSSES", 1)
    record = tmp_path / "record.jsonl"
    with (
        executor_of(1) as executor,
        pytest.raises(InputError, match=f"2 times in a row a worker process was killed.*goes on from {record}"),
    ):
        run(slow.once, slow.prepare, 0.0, [1, "always"], executor, content="a", record=record)


STUDY = """
import sys
sys.path.insert(0, {here!r})
import slow
from pathlib import Path
from matching.executors import executor_of
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
    process = subprocess.Popen(
        words, env=where | {"SLOW_STOPS_AT": "4"}, start_new_session=True, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 200  # on a busy machine
    while time.monotonic() < deadline and (not record.exists() or len(record.read_text().splitlines()) < 2):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = record.read_text().splitlines()
    assert 2 <= len(before) < 8
    done = subprocess.run(words, env=where, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str([n**2 for n in range(8)])
    after = [json.loads(line)["chunk"] for line in record.read_text().splitlines()]
    assert sorted(after) == sorted(str(n) for n in range(8))  # each chunk once


def test_workers_end_with_the_study_that_is_killed(tmp_path):
    record, script = tmp_path / "record.jsonl", tmp_path / "study.py"
    script.write_text(STUDY.format(here=str(HERE), record=str(record)))
    where = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{HERE}", "SLOW_STOPS_AT": "4"}
    process = subprocess.Popen([sys.executable, str(script)], env=where, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 200  # on a busy machine
    while time.monotonic() < deadline and (not record.exists() or not record.read_text()):
        time.sleep(0.05)
    worker = json.loads(record.read_text().splitlines()[0])["result"]["pid"]
    process.kill()  # alone: its worker hears nothing of it
    process.wait()
    while time.monotonic() < deadline and _runs(worker):
        time.sleep(0.05)
    assert not _runs(worker)


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat")  # one that ended and that nobody waits for is a zombie
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"


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


def test_a_row_is_in_the_file_when_it_is_forced_to_the_disk(tmp_path, monkeypatch):
    """What Python still holds cannot be forced."""
    record, sizes = tmp_path / "study.jsonl", []
    monkeypatch.setattr("matching.records.os.fsync", lambda number: sizes.append(os.fstat(number).st_size))
    records.append(record, {"number": 1})
    assert sizes == [record.stat().st_size]
    assert sizes[0] > 0
