"""Recordings of models that lack nothing: a diagnosis that names a cause here is wrong.

``python -m tests.campaign.perfect --cases 60 --seed 4907 [--workers 1] [--keep DIR]`` draws chains, branches, gears and
ratios, diagnoses them and counts the causes. Nothing is shared with the program: the motion follows from matrix
exponentials between the samples, in speeds and twists, exact for held and straight inputs.

Drawn are the structure, its values, the excitation, 90 to 1000 Hz, what inputs do between their samples (held,
straight, smooth), noise, 12-bit channels, encoder counts, uneven sampling, and where the uncertain quantities begin:
anywhere within −50 to +80 % of the truth, within their stated range.
"""

import argparse
import json
import time as clock
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import chirp, lfilter

BETWEEN = ("held", "straight", "smooth")
FINE = 8  # straight pieces of a smooth input between two samples
BEGIN = (-0.5, 0.8)  # where an uncertain quantity begins, relative to the truth
LEVELS = 4096


@dataclass
class Drawn:
    """A drawn recording: model file as a dictionary, columns, and what was drawn."""

    model: dict[str, Any]
    columns: dict[str, np.ndarray]
    about: dict[str, Any] = field(default_factory=dict)


@dataclass
class _Drive:
    """Inertias that turn freely (q), and those that gears hold to them: speeds = S·q; shafts between inertias."""

    J: np.ndarray
    drag: np.ndarray
    S: np.ndarray
    ends: list[tuple[int, int]]
    ratio: np.ndarray
    k: np.ndarray
    c: np.ndarray

    def matrices(self, on: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """ẋ = A·x + B·u of x = (q, twists, angles of q); speeds = S·q; twist rates = rate·q."""
        n, s = self.S.shape[1], len(self.ends)
        D = np.zeros((s, len(self.J)))
        for i, (first, second) in enumerate(self.ends):
            D[i, first], D[i, second] = 1 / self.ratio[i], -1.0
        rate = D @ self.S
        inverse = np.linalg.inv(self.S.T @ np.diag(self.J) @ self.S)
        A = np.zeros((2 * n + s, 2 * n + s))
        A[:n, :n] = -inverse @ (self.S.T @ np.diag(self.drag) @ self.S + rate.T @ np.diag(self.c) @ rate)
        A[:n, n : n + s] = -inverse @ rate.T @ np.diag(self.k)
        A[n : n + s, :n] = rate
        A[n + s :, :n] = np.eye(n)
        B = np.zeros((2 * n + s, len(on)))
        B[:n] = inverse @ self.S.T[:, on]
        return A, B, self.S, rate


def _drive(rng: np.random.Generator) -> tuple[_Drive, dict[str, Any], list[str]]:
    """A tree of 2 to 5 inertias; its first is the motor."""
    n, branched = int(rng.integers(2, 6)), rng.random() < 0.35
    J, parent, joint, ratio = [float(np.exp(rng.uniform(*np.log([0.02, 0.3]))))], [-1], [""], [1.0]
    turn = [1.0]  # speed of each over that of the motor
    for i in range(1, n):
        parent.append(int(rng.integers(0, i)) if branched else i - 1)
        stiff = i == n - 1 or rng.random() < 0.75  # the last is behind a shaft
        joint.append("shaft" if stiff else "gear")
        reduction = float(rng.uniform(3, 10)) if rng.random() < (0.3 if stiff else 1.0) else 1.0
        if reduction > 1 and turn[parent[i]] < 0.05:
            reduction = 1.0 if stiff else 0.5
        ratio.append(reduction)
        turn.append(turn[parent[i]] / reduction)
        J.append(float(np.exp(rng.uniform(*np.log([0.3, 6.0])))) * J[0] / turn[i] ** 2)
    if "shaft" not in joint:
        joint[-1] = "shaft"
    free = [i for i in range(n) if joint[i] != "gear"]
    S = np.zeros((n, len(free)))
    for i in range(n):
        S[i] = S[parent[i]] / ratio[i] if joint[i] == "gear" else np.eye(len(free))[free.index(i)]
    total = sum(J[i] * turn[i] ** 2 for i in range(n))
    drag = np.array([total / turn[i] ** 2 * rng.uniform(0.02, 0.3) / n for i in range(n)])
    names = [f"part{i}" for i in range(n)]
    ends, k, c, shaft_ratio, model = [], [], [], [], {"inertias": {}, "shafts": {}, "gears": {}}
    for i in range(1, n):
        if joint[i] == "gear":
            model["gears"][f"gear{i}"] = {"between": [names[parent[i]], names[i]], "ratio": ratio[i]}
            continue
        behind = sum(J[j] * (turn[j] / turn[i]) ** 2 for j in range(i, n))
        before = sum(J[j] * (turn[j] / turn[i]) ** 2 for j in range(i))
        mass = behind * before / (behind + before)
        omega = 2 * np.pi * float(np.exp(rng.uniform(*np.log([1.5, 18.0]))))
        ends.append((parent[i], i))
        k.append(mass * omega**2)
        c.append(2 * rng.uniform(0.01, 0.08) * mass * omega)
        shaft_ratio.append(ratio[i])
    drive = _Drive(np.array(J), drag, S, ends, np.array(shaft_ratio), np.array(k), np.array(c))
    return drive, model, names


def _quantity(rng: np.random.Generator, true: float, share: float) -> Any:
    """As a model file has it: exact, or with a range that holds the truth and begins elsewhere."""
    if rng.random() > share:
        return true
    begin = true * (1 + rng.uniform(*BEGIN))
    low, high = min(begin, true), max(begin, true)
    return {"value": begin, "lower": low * rng.uniform(0.5, 0.95), "upper": high * rng.uniform(1.05, 1.8)}


def _signal(rng: np.random.Generator, t: np.ndarray, between: str, highest: float) -> np.ndarray:
    """A torque between about −1 and 1 over times (t,), s."""
    span = float(t[-1])
    slow = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3)) for f in rng.uniform(0.1, 0.9, 3)) / 3
    if rng.random() < 0.5:
        tones = np.exp(rng.uniform(np.log(0.5), np.log(highest), 14))
        fast = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3)) for f in tones) / np.sqrt(14)
    else:
        fast = chirp(t, 0.4, span, highest, phi=rng.uniform(0, 360))
    if between == "smooth":
        return 0.5 * slow + 0.5 * fast + rng.uniform(-0.2, 0.2)
    edges = np.cumsum(rng.uniform(0.3, 2.0, int(span) + 8))
    steps = rng.choice([-1.0, 1.0], len(edges) + 1) * rng.uniform(0.2, 1.0, len(edges) + 1)
    return 0.4 * steps[np.searchsorted(edges, t)] + 0.2 * slow + 0.4 * fast


def _motion(A: np.ndarray, B: np.ndarray, t: np.ndarray, u: np.ndarray, held: bool) -> np.ndarray:
    """States (t, x) at times (t,) from rest for inputs (t, u) that are held or straight in between; exact."""
    x, m, step = len(A), B.shape[1], np.diff(t)
    block = np.zeros((x + 2 * m, x + 2 * m))
    block[:x, :x], block[:x, x : x + m] = A, B
    block[x : x + m, x + m :] = np.eye(m)
    same, which = np.unique(np.round(step, 12), return_inverse=True)
    over = expm(block[None] * same[:, None, None])
    out = np.zeros((len(t), x))
    for i, h in enumerate(step):
        slope = np.zeros(m) if held else (u[i + 1] - u[i]) / h
        out[i + 1] = (over[which[i]] @ np.concatenate([out[i], u[i], slope]))[:x]
    return out


def draw(seed: int, number: int) -> Drawn:
    """One recording."""
    rng = np.random.default_rng([seed, number])
    drive, model, names = _drive(rng)
    rate = float(np.exp(rng.uniform(np.log(90), np.log(1000))))
    count = int(np.clip(rate * rng.uniform(10, 25), 1500, 8000))
    t = np.arange(count) / rate
    jitter = rng.random() < 0.25
    if jitter:
        t[1:] += rng.uniform(-0.25, 0.25, count - 1) / rate
    t = np.round(t, 7)
    between = str(rng.choice(BETWEEN))
    on = [0] if rng.random() < 0.5 else [0, len(names) - 1]
    A, B, S, rates = drive.matrices(on)
    n = S.shape[1]
    highest = float(min(35.0, rate / (15 if between == "smooth" else 5)))
    fine = np.interp(np.arange((count - 1) * FINE + 1) / FINE, np.arange(count), t) if between == "smooth" else t
    size = 10.0 * float(np.exp(rng.uniform(0, 3)))
    u = np.stack([size * _signal(rng, fine, between, highest) for _ in on], axis=1)
    if len(on) > 1:  # both ends of a drive carry about the same power
        u[:, 1] *= np.sqrt(drive.J[-1] / drive.J[0]) / 2
    states = _motion(A, B, fine, u, between == "held")
    if between == "smooth":
        states, u = states[::FINE], u[::FINE]
    speeds, twists, angles = states[:, :n] @ S.T, states[:, n : n + len(rates)], states[:, n + len(rates) :] @ S.T
    twist_rates = states[:, :n] @ rates.T
    columns = {"time [s]": t}
    fine_bits = rng.random() < 0.35
    model["inputs"] = {}
    for j, part in enumerate(on):
        name = f"drive{j}"
        model["inputs"][name] = {"on": names[part]}
        values, step = u[:, j], 2 * 1.2 * float(np.abs(u[:, j]).max()) / LEVELS
        columns[f"{name} [N*m]"] = np.round(values / step) * step if fine_bits else values
    model["sensors"] = {}
    noise = float(np.exp(rng.uniform(np.log(5e-4), np.log(2e-2))))

    def read(name: str, measures: str, of: str, unit: str, values: np.ndarray, step: float) -> None:
        sigma = noise * float(values.std())
        noisy = values + sigma * rng.standard_normal(count)
        if step:
            noisy = np.round(noisy / step) * step
        model["sensors"][name] = {
            "measures": measures, "of": of, "uncertainty": float(f"{np.hypot(sigma, step / np.sqrt(12)):.4g}"),
        }  # fmt: skip
        columns[f"{name} [{unit}]"] = noisy

    counted = rng.random() < 0.3
    measured = sorted({0, len(names) - 1} if rng.random() < 0.6 else {int(rng.integers(0, len(names)))})
    for i in measured:
        if counted and rng.random() < 0.5:
            read(f"angle{i}", "angle", names[i], "rad", angles[:, i] + rng.uniform(-3, 3), 2e-3)
        else:
            read(f"speed{i}", "speed", names[i], "rad/s", speeds[:, i], 2e-3 * float(speeds[:, i].std()) * counted)
    if rng.random() < 0.7 or len(model["sensors"]) < 2:
        j = int(rng.integers(0, len(drive.ends)))
        torque = drive.k[j] * twists[:, j] + drive.c[j] * twist_rates[:, j]
        step = 2 * 1.2 * float(np.abs(torque).max()) / LEVELS * fine_bits
        read(f"torque{j}", "torque", f"shaft{j}", "N*m", torque, step)
    for i, name in enumerate(names):
        model["inertias"][name] = {"J": _quantity(rng, float(drive.J[i]), 0.3),
                                   "drag": _quantity(rng, float(drive.drag[i]), 0.5)}  # fmt: skip
    for j, (first, second) in enumerate(drive.ends):
        model["shafts"][f"shaft{j}"] = {
            "between": [names[first], names[second]], "ratio": float(drive.ratio[j]),
            "stiffness": _quantity(rng, float(drive.k[j]), 0.7), "damping": _quantity(rng, float(drive.c[j]), 0.6),
        }  # fmt: skip
    about = {"between": between, "rate": rate, "count": count, "jitter": jitter, "bits": fine_bits,
             "counted": counted, "noise": noise, "inertias": len(names), "gears": len(model["gears"])}  # fmt: skip
    return Drawn(model, columns, about)


def coloured(drawn: Drawn, times: float, seed: int) -> Drawn:
    """The same with a slow error of every sensor, so many times its uncertainty (rms): dynamics that are right beside
    channels that are not."""
    rng = np.random.default_rng([seed, 1])
    columns = dict(drawn.columns)
    for name, sensor in drawn.model["sensors"].items():
        head = next(head for head in columns if head.startswith(f"{name} ["))
        memory = float(np.exp(-1 / rng.uniform(20, 300)))
        slow = lfilter([1], [1, -memory], rng.standard_normal(len(columns[head])))
        columns[head] = columns[head] + times * sensor["uncertainty"] * slow / slow.std()
    return Drawn(drawn.model, columns, drawn.about | {"coloured": times})


def write(drawn: Drawn, place: Path) -> None:
    """Write ``model.toml``, ``recording.csv`` and ``about.json`` into a folder."""
    place.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    for table, parts in drawn.model.items():
        for name, values in parts.items():
            lines.append(f"[{table}.{name}]")
            for key, value in values.items():
                if isinstance(value, dict):
                    inner = ", ".join(f"{k} = {v:.9g}" for k, v in value.items())
                    lines.append(f"{key} = {{ {inner} }}")
                elif isinstance(value, float):
                    lines.append(f"{key} = {value:.9g}")
                else:
                    lines.append(f"{key} = {json.dumps(value)}")
    (place / "model.toml").write_text("\n".join(lines) + "\n")
    table = np.stack(list(drawn.columns.values()), axis=1)
    head = ",".join(drawn.columns)
    np.savetxt(place / "recording.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
    (place / "about.json").write_text(json.dumps(drawn.about))


def diagnosed(place: Path) -> dict[str, Any]:
    """The answer to a recording."""
    from matching.diagnosis.diagnose import diagnose
    from modelling.model_file import load
    from modelling.recordings.read import read_recording

    system = load(place / "model.toml")
    begin = clock.process_time()
    row: dict[str, Any] = {"number": place.name, "about": json.loads((place / "about.json").read_text())}
    try:
        found = diagnose(system, [read_recording(place / "recording.csv", system)])
    except Exception as fault:  # a campaign goes on
        return row | {"failed": f"{type(fault).__name__}: {fault}", "seconds": clock.process_time() - begin}
    worst = max((one.after_holdout / one.noise for one in found.errors.values()), default=0.0)
    causes = [
        [cause.kind, cause.at, round(cause.confidence, 2), *([] if cause.in_model else ["not in the model"])]
        for cause in found.causes
    ]
    return row | {"verdict": found.verdict, "causes": causes, "worst": worst, "notes": found.notes,
                  "seconds": clock.process_time() - begin}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=4907)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--coloured", type=float, default=0.0, help="slow error of every sensor, in times its noise")
    parser.add_argument("--keep", type=Path, default=Path("out/perfect"))
    given = parser.parse_args()
    places = []
    for number in range(given.cases):
        places.append(given.keep / f"{given.seed}_{number:03d}{'_coloured' if given.coloured else ''}")
        if not (places[-1] / "about.json").exists():
            drawn = draw(given.seed, number)
            write(coloured(drawn, given.coloured, number) if given.coloured else drawn, places[-1])
    rows = []
    with ProcessPoolExecutor(given.workers) as pool:
        for row in pool.map(diagnosed, places):
            rows.append(row)
            said = row.get("failed") or f"{row['verdict']} {row['causes']} worst {row['worst']:.3g}"
            about = " ".join(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in row["about"].items())
            print(f"{row['number']} {said} {row['seconds']:.0f} s | {about}", flush=True)
    caused = [row for row in rows if row.get("causes")]
    sure = [row for row in caused if max(cause[2] for cause in row["causes"]) > 0.5]
    adequate = sum(row.get("verdict") == "adequate" for row in rows)
    taken = sum(any(len(cause) < 4 for cause in row["causes"]) for row in caused)
    print(f"{len(rows)} models: {len(caused)} with a cause, {taken} in the model, {len(sure)} over 0.5; "
          f"{adequate} adequate; "
          f"{sum('failed' in row for row in rows)} failed; {sum(row['seconds'] for row in rows):.0f} s")  # fmt: skip


if __name__ == "__main__":
    main()
