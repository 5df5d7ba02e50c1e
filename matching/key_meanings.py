"""What every key of an input file means, in one line."""

MODEL = {
    "title": "a line for reports",
    "reference": "inertia to whose shaft reduced values are reported",
    "inertias": "rotating masses",
    "shafts": "springs with dampers between two inertias",
    "gears": "rigid and ideal ratios between two inertias",
    "gearboxes": "gears with a clutch each, whose torques are inputs: for a simulation of shifts",
    "differentials": "ideal differentials: a cage that drives two sides",
    "planetary_gears": "ideal planetary gears whose three members all turn; with one held it is one of the gears",
    "inputs": "torques on inertias",
    "sensors": "what is measured",
    "effects": "a list of what goes beyond the linear chain",
    "mirror": "`pairs`: what left/right symmetry exchanges",
}
MODEL_TABLES = {
    "inertias": {"J": "moment of inertia", "drag": "viscous friction to ground; 0 unless stated"},
    "shafts": {
        "between": "two inertias; twist = angle(first)/ratio − angle(second)",
        "ratio": "speed(first)/speed(second); 1 unless stated; stiffness and torque are on the second's side",
        "stiffness": "of the spring",
        "damping": "of the damper in parallel; 0 unless stated",
        "length": "of a round bar or tube, in place of stiffness; half of its inertia is added to each end",
        "diameter": "outer one",
        "inner_diameter": "of a tube; 0 unless stated",
        "shear_modulus": "steel unless stated, 79.3 GPa",
        "density": "steel unless stated, 7850 kg/m³; 0 adds no inertia",
    },
    "gears": {
        "between": "two inertias",
        "ratio": "speed(first) = ratio · speed(second)",
        "efficiency": "power out over power in; ideal unless stated; the effect `gear_loss`",
        "efficiency_reverse": "the same where the second end drives; as efficiency unless stated",
    },
    "gearboxes": {
        "between": "two inertias",
        "ratios": "by gear: speed(first) = ratio · speed(second) while the gear's clutch sticks",
        "capacities": "by gear: the input that is the torque its clutch can carry, N·m at the first inertia",
        "deflection": "by which a clutch gives way before it slips under its whole torque, angle of the first inertia",
        "settling": "time with which it does so; 2 ms unless stated",
        "converter": "torque converter beside the only gear, whose clutch is then its lock-up clutch; tables over "
        "turbine speed over pump speed: pump torque over its speed squared, N·m·s²/rad², and turbine over pump torque",
        "engages_below": "makes dog clutches of the clutches: slip below which they engage, speed of the first inertia",
    },
    "differentials": {"cage": "the driven inertia", "left": "first output", "right": "second output"},
    "planetary_gears": {
        "sun": "inertia of the sun",
        "carrier": "inertia of the carrier, with that of the planets about the axis",
        "ring": "inertia of the ring",
        "ratio": "teeth of the ring over teeth of the sun: (1 + ratio)·carrier = sun + ratio·ring",
    },
    "inputs": {
        "on": "the inertia that the torque (N·m) acts on, or whose motion is imposed",
        "measures": "`torque`, or `speed` or `angle` of an imposed motion; unless stated torque, or imposed speed",
        "reference": "the channel that the controller of this input follows, e.g. a commanded speed; optional",
    },
    "sensors": {
        "measures": "`angle`, `speed` or `acceleration` of an inertia, `torque` of a shaft",
        "of": "the inertia or the shaft",
        "uncertainty": "standard uncertainty (k = 1): also the noise that a fit assumes",
        "counts": "counts a turn of an encoder whose speed is counts over a sample: the noise of a match follows from "
        "them and the loop's sample time, in addition to `uncertainty`",
    },
}
CASE = {
    "title": "a line for reports",
    "vehicle": "model file of what has to be reproduced",
    "rig": "model file of what stands on the bed; shared components carry the vehicle's names",
    "dynamometers": "`torque_input`, `torque_sensor` (none without a torque flange), `speed_sensor`, and `follows`, "
    "the shaft that is cut; `dead_time`, `inverter_lag`, `torque_sensor_lag` where it has others than `[loop]` states",
    "loop": "control structure, delays and gains",
    "targets": "a list: `mode` of the vehicle by number, `frequency_tolerance` (relative), `damping_tolerance`",
    "response": "`band` (Hz), `compare` (pairs of `input`, `sensor`), `tolerance`, `unmeasured_tolerance`",
    "manoeuvre": "torques over time by input: a kind with its quantities, a list of segments, or a recorded torque",
    "limits": "what must not be exceeded",
    "move": "what may be tuned: `\"NAME\" = { lower, upper }`; of an adapter also `catalogue` or `step`",
    "operating_point": "the steady motion that the manoeuvre begins from; standstill unless stated",
    "operating_range": "speeds of the vehicle that one observer has to cover; the match is reported about their middle",
    "drives": "a list: manoeuvres that judge it, each from a steady speed: torques by input (of a clutch: "
    "what it carries), or a speed profile",
    "uncertainty": "half-widths of what is not known exactly, by name or pattern; beds are drawn from it",
    "vehicle_in_the_loop": "the vehicle as others simulate it, an FMU; `vehicle` is then what the observer is "
    "designed with, and may be coarse",
    "residual_vehicle": "`model`: a model file of a residual vehicle of one's own, simpler than the vehicle",
}  # fmt: skip
LIMITS = {
    "modulus_margin": "least distance of the open loop from −1; 0.5 unless stated",
    "margin_from": "from where the margin counts; twice the highest target mode unless stated",
    "rolled_off": "largest \\|T\\| of the loop from `rolled_off_from` on; 0.5 unless stated",
    "rolled_off_from": "from where \\|T\\| counts; 100 Hz unless stated",
    "command_noise": "largest rms torque that sensor noise may make; 2 % of `dynamometer_torque` unless stated; "
    '`"dynamometers.NAME.command_noise"` for one of them',
    "sensor_offset": "largest flange torque that an observer does not expect, a minute after every sensor is off by "
    "its uncertainty; 2 % of `dynamometer_torque` unless stated",
    "damping_ratio": "least damping ratio of any closed-loop mode; 0.01 unless stated",
    "damping_share": "of the damping of the vehicle's mode that a mode on a bed reproduces, else of the least damping "
    "of the target modes; 1/3 unless stated",
    "opened_shafts": "whether the bed has to stay stable with free play in the shafts at the cut; true unless stated, "
    "false where they have none",
    "dynamometer_torque": 'largest torque of a dynamometer; `"dynamometers.NAME.torque"` where one has another',
    "dynamometer_speed": "largest speed",
    "dynamometer_power": "largest power",
}
OPERATING = {
    "vehicle_speed": "of the vehicle, with `rolling_radius`",
    "rolling_radius": "of the wheels, m",
    "road_load": "`constant` (N), `linear` (N·s/m), `quadratic` (N·s²/m²); added to the vehicle's drag",
}
RANGE = {
    "vehicle_speed": "lowest and highest speed; below 0 backwards",
    "rolling_radius": "of the wheels, m",
    "road_load": "as under `[operating_point]`",
}
VEHICLE = {
    "fmu": "file of the FMU: FMI 2.0 or 3.0, co-simulation with a fixed step",
    "torques": "by dynamometer the FMU's input for the torque (N·m) into the vehicle at this cut, positive as it "
    "drives",
    "speeds": "by dynamometer the FMU's output for the speed (rad/s) of the vehicle at this cut",
    "inputs": "by input of the vehicle beyond the cuts (brakes, road loads) the FMU's input for the same",
    "step": "of the FMU, a whole number of samples; `sample_time` unless stated",
    "late": "samples between the moment to which a speed belongs and the one in which the controller reads it; 0 "
    "unless stated: the vehicle steps between two samples. A connection that is late by one sample each way makes it 2",
}
DRIVE = {
    "title": "a line for reports",
    "vehicle_speed": "from which it begins; that of the profile, or 0, unless stated",
    "profile": "file with `time`, `vehicle_speed` and, where the road climbs, `grade` (rise over length on the map); a "
    "driver follows it",
    "driver": "`input` that it acts on, `brakes` (inputs) that it pulls; `proportional` (40 N·m·s/rad) and `integral` "
    "(20 N·m/rad) by the error of the body's speed, `largest` torque (400 N·m)",
}
CHANNEL = {
    "channel": "its name in the recording; of a matrix in a `.mat` the column: `data[:,2]` or `data(:,3)` is the third",
    "unit": "replaces the unit in the recording",
    "sign": "−1 where it is positive in the other direction",
    "factor": "is multiplied by",
    "group": "of an MDF, where several groups have the name",
    "period": "after how much the channel starts anew (a counter, an angle that wraps), in the recording's unit",
}
BUDGET = {
    "title": "a line for reports",
    "coverage": "probability of the interval; 0.95 unless stated",
    "coverage_factor": "k, instead of a probability",
    "measurand": "`name`, `formula`, `unit`, `description` of the result",
    "measurands": "several of them, by name",
    "inputs": "what the formula needs",
    "correlations": "a list: `between` two inputs, coefficient `r`",
    "lines": "straight lines fitted to readings (GUM H.3)",
}
INPUT = {
    "value": "best estimate",
    "unit": "any unit; 1 unless stated",
    "distribution": "its shape; follows from the other keys unless stated",
    "half_width": "of a bounded distribution",
    "half_width_tolerance": "how far the half-width itself is known",
    "uncertainty": "standard uncertainty",
    "expanded_uncertainty": "U, with `coverage_factor`",
    "coverage_factor": "k of `expanded_uncertainty`",
    "degrees_of_freedom": "of the uncertainty; infinite unless stated",
    "beta": "of a trapezoid: the upper side over the base",
    "readings": "a list of readings (type A)",
    "simultaneous": "readings with the same name were read together and are correlated",
    "cause": "branch of the cause-and-effect diagram",
    "description": "a line for the table",
}  # fmt: skip
LINE = {
    "abscissa": "readings in x",
    "ordinate": "readings in y",
    "abscissa_unit": "unit of x",
    "ordinate_unit": "unit of y",
    "origin": "x at which the intercept is taken",
    "cause": "branch of the cause-and-effect diagram",
    "description": "a line for the table",
}
FIDELITY = {
    "title": "a line for reports",
    "f_max": "largest relevant frequency, Hz; 30 unless stated",
    "arithmetic": "`definition`, or `published` as in the paper's table",
    "nrmse": "form of Eq. 18: `definition` or `literal`",
    "longest_delay": "largest delay that is searched, s",
    "recordings": "`reference` and `test` with their channel files, for signals that are measured",
    "weights": "of the domains; they sum to 1",
    "system_dynamics": "signals of the system under test",
    "residual_vehicle_model": "signals of the residual vehicle model",
    "measurement_uncertainty": "sensors with their expanded uncertainty and range",
}
FIDELITY_SIGNAL = {
    "nrmse_fidelity": "stated R_NRMSE",
    "nrmse_uncertainty": "its standard uncertainty",
    "delay": "stated delay",
    "delay_uncertainty": "its standard uncertainty",
    "reference": "channel of the reference recording",
    "test": "channel of the test recording",
    "reference_noise": "standard uncertainty of the reference signal",
    "test_noise": "standard uncertainty of the test signal",
}
FIDELITY_SENSOR = {
    "fidelity": "stated R_MU of the sensor",
    "expanded_uncertainty": "U",
    "range": "of the signal",
    "signal": "signal whose range counts",
    "budget": "budget file that gives U",
    "measurand": "of that budget",
    "coverage_factor": "k of U; 2 unless stated",
    "degrees_of_freedom": "of U",
}
