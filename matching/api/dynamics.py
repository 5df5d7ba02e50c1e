"""What a drivetrain does: modes, frequency responses, motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from matching.api.files import File, recording_of, system_of

if TYPE_CHECKING:
    import numpy as np

    from modelling.linear.response import Response
    from modelling.measurement.recording import Recording
    from modelling.modal.result import Modes
    from modelling.model.system import System
    from modelling.simulation.result import Simulation


def modes(model: System | File, values: Mapping[str, float] | None = None, *, damped: bool = False) -> Modes:
    """Modes with energy shares and symmetry (Eqs. 1–8 of the paper).

    Parameters
    ----------
    model : System or path
        A model.
    values : mapping of str to float, optional
        Replace those of the model by name, SI, e.g. ``{"shafts.link.stiffness": 400}``.
    damped : bool
        Modes with damping, at the operating point; else undamped.

    Returns
    -------
    Modes
        A sequence of modes, in order of frequency: ``frequency`` (Hz), ``damping_ratio``, ``kinetic`` and ``potential``
        energy shares by part, ``symmetry``.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> modes = rm.modes("examples/road_to_rig/vehicle.toml")
    >>> print(f"{modes[1].frequency:.3f} Hz, {modes[1].symmetry}")
    1.600 Hz, antisymmetric
    """
    from modelling.modal.damped_modes import damped_modes
    from modelling.modal.modes import modes as undamped

    return (damped_modes if damped else undamped)(system_of(model), values)


def response(model: System | File, frequencies: np.ndarray) -> Response:
    """Frequency responses of all sensors to all inputs.

    Parameters
    ----------
    model : System or path
        A model.
    frequencies : ndarray (f,)
        Hz.

    Returns
    -------
    Response
        ``values`` (f, y, u), complex: the sensor's SI unit per N·m.

    Raises
    ------
    InputError
        One line that names file and key.

    Examples
    --------
    >>> import numpy as np
    >>> response = rm.response("examples/diagnosis/model.toml", np.array([1.0, 10.0, 50.0]))
    >>> response.values.shape  # frequencies, sensors, inputs
    (3, 3, 1)
    """
    from modelling.linear.response import response as of

    return of(system_of(model), frequencies)


def simulate(
    model: System | File,
    recording: Recording | File,
    *,
    channels: File | None = None,
    start: Any = "recorded",
    tolerance: float | None = None,
) -> Simulation:
    r"""The model's response to the inputs of a recording.

    Parameters
    ----------
    model : System or path
        A model.
    recording : Recording or path
        Its inputs vary linearly between the samples.
    channels : path, optional
        A file that says what the channels are called in the recording.
    start : "recorded", "rest", "steady", states by name or all states
        ``"recorded"``: estimated from the first quarter second of the recorded sensors, at rest if there are none;
        others as :func:`modelling.simulation.simulate.simulate` has them.
    tolerance : float, optional
        Largest error of the integration, as a share of each reading's range; by default 1e-4.

    Returns
    -------
    Simulation
        ``time`` (t,) in s, readings of all sensors (t,) by name, SI.

    Raises
    ------
    InputError
        One line that names file, key or column.
    SimulationError
        If a state is not finite.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "\n".join(f"{k / 1000},{10 if k >= 100 else 0}" for k in range(500))
    >>> _ = Path("tip_in.csv").write_text("time [s],motor_torque [N*m]\n" + rows)
    >>> simulated = rm.simulate("examples/diagnosis/model.toml", "tip_in.csv", start="rest")
    >>> print(f"{simulated.readings['link_torque'].max():.1f} N·m")
    17.8 N·m
    """
    from modelling.equations.compiled import compiled
    from modelling.simulation.recorded_start import recorded_start
    from modelling.simulation.simulate import simulate as run
    from modelling.simulation.simulate import with_stick_speed
    from modelling.simulation.speed_units import check_speed_units
    from modelling.simulation.step_control import TOLERANCE

    built = compiled(system_of(model))
    measured = recording_of(recording, built.system, channels)
    measured.check_continuous()
    check_speed_units(built, measured)
    inputs = measured.inputs(built.system)
    if isinstance(start, str) and start == "recorded":
        start = recorded_start(built, measured, with_stick_speed(built, measured.time, inputs, built.p0))
    return run(built, measured.time, inputs, start=start, tolerance=TOLERANCE if tolerance is None else tolerance)
