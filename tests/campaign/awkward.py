"""Recordings on which a diagnosis has to answer, whatever it answers: a fault of the program is what counts.

Two or three inertias with free play, hard dry friction, both or neither; torques that are pseudo-random, stepped,
square or constant, held between samples; shafts that stand; channels that never change, that have gaps, that are
rounded; one record in fifteen has 50 rows. ``python -m tests.campaign.awkward --cases 300 --seed 6301`` makes them with
an integrator of its own, runs ``rigmatch diagnose`` on each as a user would, and goes on where it was stopped.
"""

import argparse
import json
import os
import resource
import time
from collections import Counter
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

STEP = 5e-5  # s, of the integrator
GRID = 2e-3  # s, of what is kept of the motion
LONGEST = 14.0  # s
RATES = (500, 250, 125)  # rows a second
TORQUES = ("pseudo-random", "steps", "square", "constant")
WRITTEN = ("diagnosis.json", "report.html", "extended.toml")
UNENDED, MISSING = -100, -101  # in the place of an exit code
HIDDEN = ("play", "friction", "play and friction", "nothing")


def draw(rng: np.random.Generator, number: int) -> dict[str, Any]:
    """One drive, what is hidden in it, and how it is recorded."""
    count = int(rng.integers(2, 4))
    J = np.exp(rng.uniform(*np.log([0.05, 0.5]), 3)) * np.array([1.0, 3.0, 5.0])
    behind = np.array([J[1:count].sum(), J[2] if count == 3 else 1.0])
    k = np.minimum(J[:2], behind) * (2 * np.pi * rng.uniform(3, 14, 2)) ** 2
    return {
        "count": count,
        "J": J,
        "drag": J * rng.uniform(0.05, 0.4, 3),
        "k": k,
        "c": rng.uniform(0.02, 0.08, 2) * np.sqrt(k * J[:2]),
        "size": float(np.exp(rng.uniform(0.5, 3.5))),
        "torque": TORQUES[number % 4],
        "hidden": HIDDEN[(number // 4) % 4],
        "stands": bool(rng.random() < 0.15),  # the last inertia: its friction is never overcome
        "second": str(rng.choice(["", "zero", "stepped"], p=[0.6, 0.2, 0.2])),  # a torque on the last inertia
        "rate": int(rng.choice(RATES)),
        "rows": 50 if number % 15 == 14 else int(rng.integers(600, 1700)),
        "noise": float(rng.choice([0.0, 0.002, 0.02])),  # of a channel's spread
        "rounded": bool(rng.random() < 0.3),
        "gaps": bool(rng.random() < 0.15),
        "uncertain": float(rng.choice([0.0, 0.6, 1.0], p=[0.15, 0.6, 0.25])),  # share of the quantities
        "unseen": bool(rng.random() < 0.25),  # the last third of the recording is held out
        "seed": int(rng.integers(2**31)),
    }


def _torque(rng: np.random.Generator, kind: str, t: np.ndarray) -> np.ndarray:
    """A torque (t,) of about one."""
    mean = rng.choice([0.0, 0.5])
    if kind == "pseudo-random":
        clock = rng.uniform(0.02, 0.25)
        levels = rng.choice([-1.0, 1.0], int(t[-1] / clock) + 2)
        return mean + levels[(t / clock).astype(int)]
    if kind == "square":
        return mean + np.sign(np.sin(2 * np.pi * t / rng.uniform(0.4, 4) + 1e-9))
    if kind == "steps":
        edges = np.sort(rng.uniform(0, t[-1] / 2, int(rng.integers(1, 4))))
        return np.r_[0.0, rng.uniform(-1, 1, len(edges))][np.searchsorted(edges, t)]
    return np.full(len(t), rng.choice([0.0, 1.0], p=[0.2, 0.8]))


def motions(
    drawn: list[dict[str, Any]], longest: float = LONGEST
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Torques put in (t, m, 2), speeds and angles (t, m, 3), shaft torques (t, m, 2) of all drives at once.

    Semi-implicit Euler steps; dry friction is an impulse that stops what it can stop.
    """
    J, drag, k, c = (np.array([one[key] for one in drawn]) for key in ("J", "drag", "k", "c"))
    m, t = len(drawn), np.arange(round(longest / GRID)) * GRID
    three = np.array([one["count"] == 3 for one in drawn])
    k[~three, 1] = c[~three, 1] = 0.0
    gap, friction, u = np.zeros((m, 2)), np.zeros((m, 3)), np.zeros((len(t), m, 2))
    for i, one in enumerate(drawn):
        rng, last = np.random.default_rng(one["seed"]), one["count"] - 1
        every = GRID * np.round(t / GRID // (1 / one["rate"] / GRID) * (1 / one["rate"] / GRID))  # held
        u[:, i, 0] = one["size"] * _torque(rng, one["torque"], every)
        if one["second"] == "stepped":
            u[:, i, 1] = one["size"] * _torque(rng, "steps", every)
        if "play" in one["hidden"]:
            gap[i, rng.integers(0, last)] = one["size"] / k[i, 0] * rng.uniform(0.2, 2.0)
        if "friction" in one["hidden"]:
            friction[i, rng.integers(0, last + 1)] = one["size"] * rng.uniform(0.05, 0.6)
        if one["stands"]:
            friction[i, last] = 20 * one["size"]
    last = np.where(three, 2, 1)
    omega, angle, twist, rows = np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 2)), np.arange(m)
    speeds, angles, torques = np.zeros((len(t), m, 3)), np.zeros((len(t), m, 3)), np.zeros((len(t), m, 2))
    for n in range(len(t)):
        for _ in range(round(GRID / STEP)):
            rate = omega[:, :2] - omega[:, 1:]
            beyond = twist - np.clip(twist, -gap, gap)
            touching = (beyond != 0) | (gap == 0)
            torque = k * beyond + c * rate * touching
            torque = np.where((gap > 0) & (torque * beyond < 0), 0.0, torque)  # flanks push, they do not pull
            onto = -drag * omega
            onto[:, :2] -= torque
            onto[:, 1:] += torque
            onto[:, 0] += u[n, :, 0]
            onto[rows, last] += u[n, :, 1]
            momentum = J * omega + STEP * onto
            omega = (momentum - np.clip(momentum, -STEP * friction, STEP * friction)) / J
            twist = twist + STEP * (omega[:, :2] - omega[:, 1:])
            angle = angle + STEP * omega
        if n + 1 < len(t):
            speeds[n + 1], angles[n + 1], torques[n + 1] = omega, angle, torque
    return u, speeds, angles, torques


def _columns(one: dict[str, Any], motion: tuple[np.ndarray, ...], i: int) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns of a recording, and the sensors' lines of the model file."""
    u, speeds, angles, torques = (part[:, i] for part in motion)
    rng, every = np.random.default_rng([one["seed"], 1]), round(1 / one["rate"] / GRID)
    rows = slice(0, min(one["rows"] * every, len(u)), every)
    columns = {"time [s]": np.arange(len(u))[rows] * GRID, "motor_torque [N*m]": u[rows, 0]}
    if one["second"]:
        columns["load_torque [N*m]"] = u[rows, 1]
    last, lines = one["count"] - 1, list[str]()
    sensors = [("motor_speed", "speed", "motor", "rad/s", speeds[rows, 0])]
    if rng.random() < 0.7:
        sensors.append(("load_speed", "speed", "load", "rad/s", speeds[rows, last]))
    else:
        sensors.append(("load_angle", "angle", "load", "rad", angles[rows, last]))
    if rng.random() < 0.5:
        j = int(rng.integers(0, last))
        sensors.append((f"torque_{j}", "torque", f"shaft{j}", "N*m", torques[rows, j]))
    for name, measures, of, unit, values in sensors:
        spread = float(values.std()) or {"speed": 0.5, "angle": 0.01, "torque": 0.5}[measures]
        noisy = values + one["noise"] * spread * rng.standard_normal(len(values))
        uncertainty = max(one["noise"], 1e-4) * spread
        if one["rounded"]:
            step = float(f"{rng.choice([0.01, 0.1]) * spread:.1g}")
            noisy, uncertainty = np.round(noisy / step) * step, float(np.hypot(uncertainty, step / np.sqrt(12)))
        if one["gaps"]:
            begin = int(rng.integers(1, len(noisy)))
            noisy[begin : begin + int(rng.integers(1, len(noisy) // 5))] = np.nan
        columns[f"{name} [{unit}]"] = noisy
        lines += [f"[sensors.{name}]", f'measures = "{measures}"', f'of = "{of}"', f"uncertainty = {uncertainty:.4g}"]
    return columns, lines


def _write(place: Path, one: dict[str, Any], motion: tuple[np.ndarray, ...], i: int) -> None:
    """``model.toml``, ``recording.csv``, perhaps ``unseen.csv``, and last ``about.json``."""
    rng = np.random.default_rng([one["seed"], 2])

    def value(true: float) -> str:
        if rng.random() >= one["uncertain"]:
            return f"{true:.6g}"
        return f"{{ value = {true * rng.uniform(0.7, 1.3):.6g}, tolerance = 0.5 }}"

    names = ["motor", "middle", "load"] if one["count"] == 3 else ["motor", "load"]
    lines: list[str] = []
    for name, J, drag in zip(names, one["J"], one["drag"], strict=False):
        lines += [f"[inertias.{name}]", f"J = {value(J)}", f"drag = {value(drag)}"]
    for j in range(len(names) - 1):
        lines += [f"[shafts.shaft{j}]", f"between = {json.dumps(names[j : j + 2])}"]
        lines += [f"stiffness = {value(one['k'][j])}", f"damping = {value(one['c'][j])}"]
    lines += ["[inputs.motor_torque]", 'on = "motor"']
    if one["second"]:
        lines += ["[inputs.load_torque]", 'on = "load"']
    columns, sensors = _columns(one, motion, i)
    place.mkdir(parents=True, exist_ok=True)
    (place / "model.toml").write_text("\n".join(lines + sensors) + "\n")
    rows = [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in zip(*columns.values(), strict=True)]
    cut = len(rows) * 2 // 3 if one["unseen"] else len(rows)
    for file, part in (("recording.csv", rows[:cut]), ("unseen.csv", rows[cut:])):
        if part:
            (place / file).write_text("\n".join([",".join(columns), *part]) + "\n")
    about = {key: each for key, each in one.items() if not isinstance(each, np.ndarray)}
    (place / "about.json").write_text(json.dumps(about))


def make(folder: Path, cases: int, seed: int) -> None:
    """Make the recordings that are not there yet."""
    rng = np.random.default_rng(seed)
    drawn = [draw(rng, number) for number in range(cases)]
    if not (folder / f"{cases - 1:03d}" / "about.json").exists():
        motion = motions(drawn)
        for i, one in enumerate(drawn):
            _write(folder / f"{i:03d}", one, motion, i)


def _command(place: Path, words: list[str]) -> None:
    """The command in a process of its own, its standard error in a file; exit code of the process."""
    from matching.cli import main as command

    os.chdir(place)
    with open("stderr.txt", "w", encoding="utf-8") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os._exit(command(words))


def run(place: Path, limit: float) -> dict[str, Any]:
    """Diagnose a recording by the command; its exit code, what it said, processor and wall time."""
    words = ["diagnose", "model.toml", "recording.csv", "--out", "out", "--time-limit", f"{limit:g}", "--traceback"]
    if (place / "unseen.csv").exists():
        words += ["--holdout", "unseen.csv"]
    begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    one = get_context("fork").Process(target=_command, args=(place, words))  # what is imported is imported once
    one.start()
    one.join(10 * limit)
    code: int | None = one.exitcode
    if code is None:
        one.kill()
        one.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if code == 0 and not all((place / "out" / name).exists() for name in WRITTEN):
        code = MISSING
    return {"number": place.name, "code": UNENDED if code is None else code,
            "said": (place / "stderr.txt").read_text()[-3000:], "seconds": seconds, "wall": time.monotonic() - begin,
            "about": json.loads((place / "about.json").read_text())}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=6301)
    parser.add_argument("--limit", type=float, default=30.0, help="seconds a diagnosis (--time-limit)")
    parser.add_argument("--seconds", type=float, default=7200.0, help="after which no further recording is begun")
    given = parser.parse_args()
    make(given.folder, given.cases, given.seed)
    import matching.api
    import matching.diagnosis.diagnose
    import matching.report.diagnosis  # noqa: F401

    record = given.folder.with_suffix(".jsonl")
    done = [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []
    numbers, end = {row["number"] for row in done}, time.monotonic() + given.seconds
    for place in sorted(given.folder.glob("[0-9]*")):
        if place.name in numbers or time.monotonic() > end:
            continue
        done.append(run(place, given.limit))
        with record.open("a", encoding="utf-8") as file:
            file.write(json.dumps(done[-1]) + "\n")
    codes = Counter(row["code"] for row in done)
    for row in done:
        if row["code"] != 0:
            print(row["number"], row["code"], *row["said"].strip().splitlines()[-1:])
    seconds = sorted(row["seconds"] for row in done)
    print(f"{len(done)} recordings, by exit code ({UNENDED}: no end, {MISSING}: a file is missing): {dict(codes)}")
    print(f"processor time {seconds[len(seconds) // 2]:.1f} s in the median, {seconds[-1]:.1f} s at most")


if __name__ == "__main__":
    main()
