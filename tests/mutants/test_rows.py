"""A run of mutants that was killed goes on where it was."""

from tests.mutants.rows import append, rows


def test_a_row_left_half_written_is_done_again_and_hides_no_other(tmp_path):
    path = tmp_path / "results.jsonl"
    append(path, {"file": "a", "end": "survived"})
    with path.open("a", encoding="utf-8") as file:
        file.write('{"file": "b", "en')
    assert [row["file"] for row in rows(path)] == ["a"]
    append(path, {"file": "b", "end": "test"})
    append(path, {"file": "c·", "end": "test"})
    assert [row["file"] for row in rows(path)] == ["a", "b", "c·"]
