"""The direct drive integrated by SciPy, without any function of the package, for `emcas validate`."""

import numpy as np
from scipy.integrate import solve_ivp

MOTION = [f"{kind}.{axis}" for kind in ("acceleration", "angular_rate", "angular_acceleration") for axis in "xyz"]
ATTITUDE = ["attitude.roll", "attitude.pitch"]


def of_vehicle(p, row):
    """Return a function of fin angle [rad]: the moment [N.m] of the vehicle's motion on fin and rotor about the hinge.

    The fin is a plate with its masses at their centres. The axes are the body axes, turned about x by the azimuth.
    """
    cosine, sine = np.cos(p["mounting.azimuth"]), np.sin(p["mounting.azimuth"])
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])
    acceleration, rate, faster = np.array([row[name] for name in MOTION]).reshape(3, 3)
    roll, pitch = row["attitude.roll"], row["attitude.pitch"]
    down = np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    station = np.array([p["mounting.station"], 0.0, 0.0])
    hinge = acceleration + np.cross(faster, station) + np.cross(rate, np.cross(rate, station))
    force = turn @ ((9.80665 * down if p["loads.gravity"] else 0.0) - hinge)
    w, (_, about_hinge, _) = turn @ rate, turn @ faster
    parts = ("fin", "shaft", "fork")
    inertia = sum(p[f"inertia.{part}"] for part in parts)
    x, z = (sum(p[f"mass.{part}"] * p[f"center_of_mass.{part}.{axis}"] for part in parts) for axis in "xz")

    def moment(angle):
        c, s = np.cos(angle), np.sin(angle)
        weight = (z * c - x * s) * force[0] - (x * c + z * s) * force[2]
        plate = inertia * ((w[0] ** 2 - w[2] ** 2) * s * c + w[0] * w[2] * (c * c - s * s))
        return weight + plate - (inertia + p["motor.inertia"]) * about_hinge

    return moment


def simulate(parameters, inputs):
    """Return fin angle, fin rate and motor current [SI] at the rows of `inputs`, each of which is held until the next.

    `parameters` are by name, SI; `inputs` has the row times ``time`` [s] and any columns of inputs [SI].
    """
    p, time = parameters, np.asarray(inputs["time"])
    starts = {"fin_command": 0.0, "aero_torque": 0.0, "supply_voltage": p["drive.supply_voltage"], "enable": 1.0,
              **dict.fromkeys([*MOTION, *ATTITUDE], 0.0)}
    rows = [dict(zip(starts, row)) for row in zip(*(np.broadcast_to(inputs.get(n, s), time.shape)
                                                    for n, s in starts.items()))]
    period, limit, stop = p["controller.sample_time"], p["command.limit"], p["fin.stop_angle"]
    samples = np.arange(int(time[-1] / period) + 1) * period
    instants = np.unique(np.round(np.concatenate([time, samples]), 9))
    sampled, row_at = set(np.round(samples, 9)), {t: k for k, t in enumerate(np.round(time, 9))}
    state, integral, reference, records = np.array([p["fin.start_angle"], 0.0, 0.0]), 0.0, 0.0, []
    row, moment = rows[0], of_vehicle(p, rows[0])
    inertia = p["motor.inertia"] + p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]

    def rates(_, y):
        angle, rate, current = y
        voltage = np.clip(reference, -row["supply_voltage"], row["supply_voltage"]) if row["enable"] else 0.0
        torque = (p["motor.torque_constant"] * current + row["aero_torque"] + moment(angle)
                  - p["spring.stiffness"] * angle - p["hinge.damping"] * rate)
        rise = voltage - p["motor.resistance"] * current - p["motor.back_emf_constant"] * rate
        return rate, torque / inertia, rise / p["motor.inductance"]

    def meets_stop(_, y):
        return stop - abs(y[0])

    meets_stop.terminal, meets_stop.direction = True, -1.0
    for begin, end in zip(instants, [*instants[1:], None]):
        if begin in row_at:
            records.append(state.copy())
            row, moment = rows[row_at[begin]], of_vehicle(p, rows[row_at[begin]])
        if end is None:
            break
        if begin in sampled:
            command = np.clip(row["fin_command"], -limit, limit)
            demand = (p["controller.kp"] * (p["controller.setpoint_weight"] * command - state[0]) + integral
                      - p["controller.kd"] * state[1])
            clipped = abs(demand) > row["supply_voltage"]
            reference = float(np.clip(demand, -row["supply_voltage"], row["supply_voltage"]))
            integral += 0.0 if clipped else period * p["controller.ki"] * (command - state[0])
            if not row["enable"]:
                reference = integral = 0.0
        while begin < end:
            run = solve_ivp(rates, (begin, end), state, method="LSODA", rtol=1e-9, atol=1e-11, events=meets_stop)
            state, begin = run.y[:, -1], float(run.t[-1])
            if run.status == 1:  # at the inelastic stop the fin rests or turns back
                state = np.array([np.sign(state[0]) * stop * (1.0 - 1e-12), 0.0, state[2]])
    return {"time": time, **dict(zip(("fin_angle", "fin_rate", "motor_current"), np.array(records).T))}
