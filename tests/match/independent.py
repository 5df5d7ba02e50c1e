"""A tuned case once more, by other means: equations written here, dead time as a transport line, plain stepping.

Nothing of :mod:`modelling` or :mod:`matching.frequency.verification` computes here: only names and values are read off
a case, and the matrices of the feed-forward, which are the controller's settings. Shafts with ratio, damping and slip;
no gears, differentials or other effects.
"""

import numpy as np
from scipy.linalg import expm, matrix_balance
from scipy.signal import lsim


def mechanics(system):
    """A, B (per inertia) of a system: states [angles, speeds, slips], and rows of every shaft's torque."""
    names = [part.name for part in system.inertias]
    value = {name: own.value for name, own in system.parameters.items()}
    slips = {effect.at.removeprefix("shafts."): effect for effect in system.effects if effect.kind == "slip"}
    assert len(slips) == len(system.effects)
    assert not system.gears
    assert not system.differentials
    n, m = len(names), len(slips)
    A = np.zeros((2 * n + m, 2 * n + m))
    A[:n, n : 2 * n] = np.eye(n)
    J = np.array([value[f"inertias.{name}.J"] for name in names])
    for i, name in enumerate(names):
        A[n + i, n + i] -= value.get(f"inertias.{name}.drag", 0.0) / J[i]
    torques = {}
    for shaft in system.shafts:
        first, second = (names.index(end) for end in shaft.between)
        ratio = value.get(f"shafts.{shaft.name}.ratio", 1.0)
        k, d = (value.get(f"shafts.{shaft.name}.{what}", 0.0) for what in ("stiffness", "damping"))
        row = np.zeros(2 * n + m)
        row[[first, second]] = k / ratio, -k
        row[[n + first, n + second]] = d / ratio, -d
        if shaft.name in slips:
            c = dict(slips[shaft.name].parameters)["coefficient"].value
            z = 2 * n + list(slips).index(shaft.name)
            row[z] -= k
            A[z] = row / (c + d)
            row = c * A[z]
        torques[shaft.name] = row
        A[n + first] -= row / ratio / J[first]
        A[n + second] += row / J[second]
    B = {name: np.eye(2 * n + m)[n + i] / J[i] for i, name in enumerate(names)}
    speeds = {name: np.eye(2 * n + m)[n + i] for i, name in enumerate(names)}
    return A, B, speeds, torques


def on(system):
    return {own.name: own.on for own in system.inputs}


def of(system, sensor):
    return next(own.of for own in system.sensors if own.name == sensor)


def controller(case):
    """A, B, C, D of the feedback controller from [flange torques, rotor speeds] to torque commands."""
    dynos, loop = case.loop.dynamometers, case.loop
    cuts = {own.shaft: own for own in case.residual_vehicle.interfaces}
    k = len(dynos)
    blocks = [mechanics(part) for part in case.residual_vehicle.parts]
    sizes = [len(block[0]) for block in blocks]
    n = sum(sizes)
    A, drive, wanted = np.zeros((n, n)), np.zeros((n, k)), np.zeros((k, n))
    at = 0
    for (own, pushes, speeds, _), part, size in zip(blocks, case.residual_vehicle.parts, sizes):
        A[at : at + size, at : at + size] = own
        for j, dyno in enumerate(dynos):
            end = cuts[dyno.follows].vehicle_end
            if end in [one.name for one in part.inertias]:
                drive[at : at + size, j] = pushes[end]
                wanted[j, at : at + size] = speeds[end]
        at += size
    kp, ki = loop["proportional_gain"], loop["integral_gain"]
    kt, ka, lead = (loop[name] for name in ("torque_feed_forward", "acceleration_feed_forward", "lead_time"))
    size = n + 2 * k  # residual vehicle, integrals of the error, lead
    F, G = np.zeros((size, size)), np.zeros((size, 2 * k))
    F[:n, :n], G[:n, :k] = A, drive
    F[n : n + k, :n], G[n : n + k, k:] = wanted, -np.eye(k)
    H, D = np.zeros((k, size)), np.zeros((k, 2 * k))
    H[:, :n] = kp * wanted + ka * wanted @ A
    H[:, n : n + k] = ki * np.eye(k)
    D[:, :k], D[:, k:] = ka * wanted @ drive - kt * np.eye(k), -kp * np.eye(k)
    if lead <= 1e-6:
        return F[:-k, :-k], G[:-k], H[:, :-k], D
    fast = lead / 5  # y = (1 + s·lead)/(1 + s·fast)·x  =  5·x − 4·x/(1 + s·fast)
    F[n + k :], G[n + k :] = H / fast, D / fast
    F[n + k :, n + k :] = -np.eye(k) / fast
    out = 5 * H
    out[:, n + k :] = -4 * np.eye(k)
    return F, G, out, 5 * D


def bed(case):
    """A, B (commands), E (motor), C of rig, inverters and torque sensors; C gives [flange torques, rotor speeds]."""
    A0, pushes, speeds, torques = mechanics(case.rig)
    dynos, loop, n = case.loop.dynamometers, case.loop, len(A0)
    k = len(dynos)
    A = np.zeros((n + 2 * k, n + 2 * k))
    A[:n, :n] = A0
    B, C = np.zeros((n + 2 * k, k)), np.zeros((2 * k, n + 2 * k))
    for j, dyno in enumerate(dynos):
        A[:n, n + j] = pushes[on(case.rig)[dyno.torque_input]]
        A[n + j, n + j], B[n + j, j] = -1 / loop["inverter_lag"], 1 / loop["inverter_lag"]
        flange = torques[of(case.rig, dyno.torque_sensor)]
        A[n + k + j, :n] = flange / loop["torque_sensor_lag"]
        A[n + k + j, n + k + j] = -1 / loop["torque_sensor_lag"]
        C[j, n + k + j] = 1
        C[k + j, :n] = speeds[of(case.rig, dyno.speed_sensor)]
    E = np.zeros(n + 2 * k)
    E[:n] = pushes[on(case.rig)["motor_torque"]]
    return A, B, E, C


def transport(delay, nodes):
    """Chebyshev collocation of a line that delays its input: dz/dt = A·z + B·u, y = last of z."""
    x = np.cos(np.pi * np.arange(nodes + 1) / nodes)
    c = np.array([2.0, *np.ones(nodes - 1), 2.0]) * (-1.0) ** np.arange(nodes + 1)
    gap = x[:, None] - x[None] + np.eye(nodes + 1)
    D = np.outer(c, 1 / c) / gap
    D -= np.diag(D.sum(axis=1))
    rate = 2 / delay * D
    return rate[1:, 1:], rate[1:, 0]


def poles(case, nodes=20):
    """Poles of the feedback loop with the dead time as a transport line; angles of rigid motions are left out."""
    A, B, _, C = bed(case)
    F, G, H, D = controller(case)
    k = B.shape[1]
    line, enters = transport(case.loop["dead_time"], nodes)
    n, m, z = len(A), len(F), len(line)
    whole = np.zeros((n + m + k * z,) * 2)
    whole[:n, :n], whole[n : n + m, n : n + m] = A, F
    whole[n : n + m, :n] = G @ C
    for j in range(k):
        at = n + m + j * z
        whole[:n, at + z - 1] = B[:, j]
        whole[at : at + z, at : at + z] = line
        whole[at : at + z, :n] += np.outer(enters, D[j] @ C)
        whole[at : at + z, n : n + m] += np.outer(enters, H[j])
    return np.linalg.eigvals(_deflated(whole))


def _deflated(A):
    """The matrix without what it maps to 0: the rest of its eigenvalues, free of the rounding that moves those off 0.

    On the null space N and its orthogonal complement Q the matrix is [0 ∗; 0 QᵀAQ], as A·N = 0.
    """
    A = matrix_balance(A, permute=False)[0]
    _, sizes, rows = np.linalg.svd(A)
    Q = rows[sizes > 1e-13 * sizes[0]]
    return Q @ A @ Q.T


def vehicle_motion(case, torque, step):
    """Motor speed (t,) of the vehicle for a motor torque (t,) that is linear over steps."""
    A, pushes, speeds, _ = mechanics(case.vehicle)
    system = A, pushes[on(case.vehicle)["motor_torque"]][:, None], speeds["motor"][None], np.zeros((1, 1))
    return lsim(system, torque, np.arange(len(torque)) * step)[1]


def rig_motion(case, feed_forward, torque, step, fine=10):
    """Motor speed (t,) of the matched rig: sampled controller, dead time as a queue of fine steps, torque linear.

    ``feed_forward`` is that of the structure ``model_based``, None for ``pi``. The feedback is stepped by Tustin's
    rule. The queue is half a sample shorter than the dead time, which counts the hold.
    """
    A, B, E, C = bed(case)
    F, G, H, D = controller(case)
    n, k, small = len(A), B.shape[1], step / fine
    block = expm(np.block([[A, B, E[:, None]], [np.zeros((k + 1, n + k + 1))]]) * small)
    Ad, Bd = block[:n, :n], block[:n, n:]
    half = np.linalg.inv(np.eye(len(F)) - F * step / 2)
    Fd, Gd = half @ (np.eye(len(F)) + F * step / 2), half @ G * step
    Hd, Dd = H @ half, D + H @ half @ G * step / 2
    delay = round(case.loop["dead_time"] / small)
    queue = [np.zeros(k)] * max(delay - fine // 2, 0)
    speeds = mechanics(case.rig)[2]["motor"]
    rig, control = np.zeros(n), np.zeros(len(F))
    ahead_of_time = _FeedForward(feed_forward, k) if feed_forward else None
    found = np.empty(len(torque))
    for i, motor in enumerate(torque):
        found[i] = speeds @ rig[: len(speeds)]
        seen, ahead = C @ rig, np.zeros(k)
        if ahead_of_time:
            ahead, expected = ahead_of_time.step(motor, case)
            seen = seen - expected
        correction = Hd @ control + Dd @ seen
        control = Fd @ control + Gd @ seen
        rise = torque[min(i + 1, len(torque) - 1)] - motor
        for j in range(fine):
            queue.append(ahead + correction)
            rig = Ad @ rig + Bd @ [*queue.pop(0), motor + rise * (j + 0.5) / fine]
    return found


class _FeedForward:
    """The feed-forward as its design data say: state, commands on their way, measured motor torque."""

    def __init__(self, feed_forward, k):
        self.own, self.x = feed_forward, np.zeros(len(feed_forward.A))
        self.sent = [np.zeros(k)] * feed_forward.delay

    def step(self, motor, case):
        own = self.own
        news = np.array([motor if name == "motor_torque" else 0.0 for name in own.measured])
        names = [f"{dyno.name} {what}" for what in ("torque", "speed") for dyno in case.loop.dynamometers]
        rows = [own.outputs.index(name) for name in names]
        expected = own.C[rows] @ self.x + own.D[rows] @ news
        ahead = self.x
        for command in self.sent:
            ahead = own.A @ ahead + own.B @ command + own.W @ news
        command = -own.F @ ahead - own.G @ news
        self.sent.append(command)
        self.x = own.A @ self.x + own.B @ self.sent.pop(0) + own.W @ news
        return command, expected
