"""Passivity of the controlled bed at the cut, against a bed that is put together here from masses and springs."""

import numpy as np
import pytest
from scipy.linalg import expm

from matching.match.case_file import load_case
from matching.match.loop import SampledController, controller_of
from matching.match.passivity import passivity_of

OBSERVER = "examples/road_to_rig/observer.toml"
SIDES = "left", "right"


@pytest.fixture(scope="module")
def case():
    return load_case(OBSERVER)


@pytest.fixture(scope="module")
def controller(case):
    return controller_of(case)


def bed(case, inertia=0.0, spring=0.0):
    """A, B of both sides [adapter, rotor speeds, twist of the flange, angle of the adapter, air gap, lagged torque].

    ``inertia`` and ``spring`` to ground are a specimen at each cut.
    """
    value = {name: quantity.value for name, quantity in case.rig.parameters.items()}
    A, B, C = [], [], []
    for side in SIDES:
        J, R = value[f"inertias.adapter_{side}.J"] + inertia, value[f"inertias.rotor_{side}.J"]
        k, d = (value[f"shafts.flange_{side}.{what}"] for what in ("stiffness", "damping"))
        drag, lag, sensor = (
            value[f"inertias.rotor_{side}.drag"],
            case.loop["inverter_lag"],
            case.loop["torque_sensor_lag"],
        )
        A.append(np.array([
            [-d / J, d / J, -k / J, -spring / J, 0, 0],
            [d / R, -(d + drag) / R, k / R, 0, 1 / R, 0],
            [1, -1, 0, 0, 0, 0],
            [1, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, -1 / lag, 0],
            [d / sensor, -d / sensor, k / sensor, 0, 0, -1 / sensor],
        ]))  # fmt: skip
        B.append(np.array([0, 0, 0, 0, 1 / lag, 0]))
        C.append((np.eye(6)[5], np.eye(6)[1]))
    zero = np.zeros((6, 6))
    return np.block([[A[0], zero], [zero, A[1]]]), np.stack([np.r_[B[0], 0 * B[0]], np.r_[0 * B[1], B[1]]], axis=1), C


def largest_pole(case, controller, **specimen):
    """|z| of the slowest pole that is no rest: bed, delay line and controller from sample to sample."""
    A, B, C = bed(case, **specimen)
    if not specimen.get("spring"):  # the angle of a free adapter is no motion
        kept = [i for i in range(12) if i % 6 != 3]
        A, B = A[np.ix_(kept, kept)], B[kept]
        C = [tuple(row[[0, 1, 2, 4, 5]] for row in side) for side in C]
    step, n = case.loop["sample_time"], len(A)
    late = float(case.loop.command_delays(None)[0])
    whole, rest = int(late / step + 1e-9), late % step if late % step > 1e-9 else 0.0

    def held(time):
        block = expm(np.block([[A, B], [np.zeros((2, n + 2))]]) * time)
        return block[:n, :n], block[:n, n:]

    over, new = held(step - rest)[0] @ held(rest)[0], held(step - rest)[1]
    old = held(step - rest)[0] @ held(rest)[1]
    half = n // 2
    reads = np.zeros((len(controller.sensors), n))
    for i, side in enumerate(C):
        for what, row in enumerate(side):
            reads[2 * what + i, i * half : (i + 1) * half] = row
    K, o, y, registers = controller, controller.reached, len(controller.sensors), whole + 1
    size = n + 2 * registers
    P, Q = np.zeros((size, size)), np.zeros((size, 2))
    P[:n, :n] = over
    for age, acting in ((whole, new), (whole + 1, old)):  # commands so many samples ago
        if age:
            P[:n, n + 2 * (age - 1) : n + 2 * age] += acting
        else:
            Q[:n] += acting
    P[n + 2 :, n:-2] = np.eye(size - n - 2)
    Q[n : n + 2] = np.eye(2)
    read = np.hstack([reads, np.zeros((y, size - n))])
    closed = np.block([
        [P + Q @ K.D[:, :y] @ read, Q @ K.C[:, :o]],
        [K.B[:o, :y] @ read, K.A[:o, :o]],
    ])  # fmt: skip
    z = np.linalg.eigvals(closed)
    return np.abs(z[np.abs(z - 1) > 1e-6]).max()


def test_a_bed_without_control_is_passive(case, controller):
    off = SampledController(
        controller.A, 0 * controller.B, controller.C, 0 * controller.D, controller.reached, controller.sensors,
        controller.known, controller.dynamometers, controller.sample_time,
    )  # fmt: skip
    found = passivity_of(case, off)
    assert found.passive_to is None


def simulated_admittance(case, controller, frequency, settle=3.0, seconds=2.0, fine=20):
    """Speeds of the adapters for torques at the cut (2, 2) at a frequency, Hz: demodulated from a motion in time."""
    A, B, C = bed(case)
    step, n, y = case.loop["sample_time"], len(A), len(controller.sensors)
    delay = round(float(case.loop.command_delays(None)[0]) / (step / fine))
    value = {name: quantity.value for name, quantity in case.rig.parameters.items()}
    cut = np.zeros((n, 2))
    for i, side in enumerate(SIDES):
        cut[6 * i, i] = 1 / value[f"inertias.adapter_{side}.J"]
    h = step / fine
    block = expm(np.block([[A, B, cut], [np.zeros((4, n + 4))]]) * h)
    over, held = block[:n, :n], block[:n, n:]
    reads = np.zeros((y, n))
    for i, side in enumerate(C):
        for what, row in enumerate(side):
            reads[2 * what + i, 6 * i : 6 * i + 6] = row
    o, count = controller.reached, round((settle + seconds) / step)
    w, found = 2 * np.pi * frequency, np.zeros((2, 2), complex)
    window, begun = np.hanning(round(seconds / step) * fine), round(settle / step) * fine
    for column in range(2):
        x, c, sent, kept = np.zeros(n), np.zeros(o), np.zeros((count * fine + delay + fine, 2)), []
        for sample in range(count):
            read = reads @ x
            at = sample * fine + delay
            sent[at : at + fine] = controller.C[:, :o] @ c + controller.D[:, :y] @ read
            c = controller.A[:o, :o] @ c + controller.B[:o, :y] @ read
            for k in range(sample * fine, (sample + 1) * fine):
                kept.append(x[[0, 6]])
                torque = np.zeros(2)
                torque[column] = np.sin(w * (k + 0.5) * h)
                x = over @ x + held @ np.concatenate([sent[k], torque])
        speeds = np.array(kept)[begun:]
        turning = np.exp(-1j * w * h * np.arange(begun, begun + len(speeds)))
        found[:, column] = 2j * (window * turning) @ speeds / window.sum()
    return found


def test_the_least_real_part_is_that_of_a_motion_in_time(case, controller):
    found = passivity_of(case, controller)
    admittance = simulated_admittance(case, controller, found.worst_at)
    real = (admittance + admittance.conj().T) / 2
    least = np.linalg.eigvalsh(real)[0] / np.linalg.norm(admittance, 2)
    assert least == pytest.approx(found.worst, abs=0.02)


def test_where_the_bed_gives_energy_a_lossless_specimen_swings(case, controller):
    """An inertia, or a spring to ground, that resonates with the bed where it is worst."""
    found = passivity_of(case, controller)
    assert found.stable_alone == (largest_pole(case, controller) < 1)
    assert found.worst < 0
    assert found.passive_to <= found.worst_at
    w = 2 * np.pi * found.worst_at
    reactance = -1 / np.imag(simulated_admittance(case, controller, found.worst_at)).diagonal().mean()
    swinging = {"inertia": -reactance / w} if reactance < 0 else {"spring": reactance * w}
    assert largest_pole(case, controller, **swinging) > 1
