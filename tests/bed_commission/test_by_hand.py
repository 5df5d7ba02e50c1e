"""Recordings put into a folder by hand: asked for, waited for, followed while they grow."""

import pytest

from matching.bed.simulated_bed import ByHand, HandedRecording, Waiting, keep_recording, kept_recording
from modelling.errors import InputError


class Clock:
    """A clock that moves while somebody waits, when something may happen."""

    def __init__(self, *happens):
        self.now, self.happens = 0.0, list(happens)

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        if self.happens:
            self.happens.pop(0)()


def never(_):
    raise AssertionError("nobody follows it")


def test_what_is_not_there_is_asked_for_with_what_it_needs(tmp_path):
    with pytest.raises(Waiting) as asked:
        ByHand(tmp_path, None, never).recording("1_verify", {"excitation.csv": "time"}, "run it", never)
    assert asked.value.what.startswith(str(tmp_path / "1_verify.csv"))
    assert (tmp_path / "1_verify_excitation.csv").read_text() == "time"
    (tmp_path / "1_verify.csv").write_text("a\n1\n")
    assert ByHand(tmp_path, None, never).recording("1_verify", {}, "", never).content == "a\n1\n"


def test_a_growing_recording_is_waited_for_and_followed(tmp_path, monkeypatch):
    """It appears, grows by a line and a half, and is taken when it has stood still."""
    place, said = tmp_path / "1_verify.csv", []
    clock = Clock(
        lambda: None, lambda: place.write_bytes(b"a\n1\n"), lambda: None, lambda: place.write_bytes(b"a\n1\n2\n3")
    )
    monkeypatch.setattr("matching.bed.verify.time", clock)

    def estimate(copy):
        lines = copy.read_text().splitlines()
        if len(lines) < 3:
            raise InputError(str(copy), "is too short", "record longer")
        return f"{len(lines)} lines"

    taken = ByHand(tmp_path, 2.0, said.append).recording("1_verify", {}, "run it", estimate)
    assert taken.content == "a\n1\n2\n"
    assert said[0].startswith(f"waiting for {place}: run it")
    assert said[1].startswith("1_verify.csv: not yet: ")
    assert str(place) in said[1]
    assert said[2] == "1_verify.csv: 3 lines"
    assert clock.now == pytest.approx(4 * 0.25 + 2.0)


def test_a_recording_in_the_encoding_of_a_spreadsheet_is_taken_and_no_text_is_one_line(tmp_path):
    place, hand = tmp_path / "1_verify.csv", ByHand(tmp_path, None, never)
    place.write_bytes("angle [°]\n1\n".encode("cp1252"))
    assert hand.recording("1_verify", {}, "", never).content == "angle [°]\n1\n"
    place.write_bytes(b"\xff\x81\x8d")
    with pytest.raises(InputError, match=r"1_verify\.csv: is no text"):
        hand.recording("1_verify", {}, "", never)


def test_a_recording_in_two_formats_is_one_line(tmp_path):
    for suffix in (".csv", ".mf4"):
        (tmp_path / f"1_verify{suffix}").write_bytes(b"a\n1\n")
    with pytest.raises(InputError, match=r"1_verify\.csv: is there as 1_verify\.mf4 too; leave one of them"):
        ByHand(tmp_path, None, never).recording("1_verify", {}, "", never)


def test_a_step_keeps_one_recording(tmp_path):
    keep_recording(tmp_path, HandedRecording("recording.csv", "a\n1\n"))
    assert kept_recording(tmp_path).read_text() == "a\n1\n"
    keep_recording(tmp_path, HandedRecording("recording.mf4", b"MDF"))
    assert kept_recording(tmp_path).name == "recording.mf4"
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["recording.mf4"]
