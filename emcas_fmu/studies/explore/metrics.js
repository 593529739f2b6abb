"use strict";
/* The figures of a response, a port of those of bench/metrics.py that the page shows: a browser has no numpy and scipy.
 * A test compares both. SI throughout. */

/** The last index at which `test` holds; -1 if there is none. */
function lastIndex(values, test) {
    let k = values.length - 1;
    while (k >= 0 && !test(values[k])) --k;
    return k;
}

/** The first time [s] at which `values` reach `level` from below, by linear interpolation; NaN if never. */
function crossing(time, values, level) {
    const k = values.findIndex(value => value >= level);
    if (k <= 0) return k < 0 ? NaN : time[0];
    return time[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (time[k] - time[k - 1]);
}

/** The time [s] from the first row after which `distance` stays within `band`; Infinity if this is in the last third. */
function settled(time, distance, band) {
    const last = time.length - 1, k = lastIndex(distance, value => !(value <= band));
    if (k < 0) return 0;
    if (k === last) return Infinity;
    const inside = (distance[k] - band) / (distance[k] - distance[k + 1]);
    const after = time[k] - time[0] + inside * (time[k + 1] - time[k]);
    return after > (1 - DATA.constants.HELD) * (time[last] - time[0]) ? Infinity : after;
}

/** The rows from `start` to `end` [s], to within a nanosecond. */
function between(start, end, time, ...columns) {
    const first = time.findIndex(t => t >= start - 1e-9), last = lastIndex(time, t => t <= end + 1e-9) + 1;
    return [time, ...columns].map(column => column.subarray(first, last));
}

const mean = values => values.reduce((sum, x) => sum + x, 0) / values.length;
const largest = values => values.reduce((most, x) => Math.max(most, x), -Infinity);
const smallest = values => values.reduce((least, x) => Math.min(least, x), Infinity);
const magnitude = values => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
const degrees = angle => angle * 180 / Math.PI;
const rms = values => Math.sqrt(mean(values.map(x => x * x)));

/** The figures of a response [rad] to a constant command [rad]. */
function holdFigures(time, response, command) {
    const error = response.map(angle => angle - command), held = lastThird(time, error).map(Math.abs);
    const angles = lastThird(time, response);
    return {
        time_to_accuracy: settled(time, error.map(Math.abs), DATA.constants.ACCURACY),
        steady_error: mean(lastThird(time, error)), held_error: largest(held),
        held_angle: smallest(angles.map(Math.abs)),
        ripple: largest(angles) - smallest(angles),
    };
}

/** The last third of a column. */
function lastThird(time, column) {
    const end = time[time.length - 1], start = end - DATA.constants.HELD * (end - time[0]);
    return column.subarray(time.findIndex(t => t >= start - 1e-9));
}

/** The figures of a motion [rad] commanded at `start` [s] to a level [rad]. */
function stepMetrics(time, response, start, command) {
    const travel = command - response[0], share = response.map(angle => (angle - response[0]) / travel);
    const [tenth, most] = [0.1, 0.9].map(level => crossing(time, share, level));
    return {
        rise_time: most - tenth,
        settling_time: settled(time, share.map(x => Math.abs(x - 1)), 0.02),
        time_to_90_percent: most - start,
        overshoot: Math.max(largest(share) - 1, 0),
        ...holdFigures(time, response, command),
        sustained_rate: Math.abs(travel) * 0.6 / (crossing(time, share, 0.8) - crossing(time, share, 0.2)),
    };
}

/** The figures of the last jump of the command. */
function motion({excitation: {time: rows, columns}, outputs}) {
    const move = moves(rows, columns.fin_command).pop();
    const [time, angle, rate] = between(move.start, move.end, rows, outputs.fin_angle, outputs.fin_rate);
    return {...stepMetrics(time, angle, move.start, move.level), peak_rate: magnitude(rate),
        ...currentRipple(move.start, move.end, rows, outputs)};
}

/** The figures of a fin that a hinge moment moves at command 0. */
function rest({excitation: {time: rows, begin, columns}, outputs}) {
    const [time, angle] = between(begin, Infinity, rows, outputs.fin_angle), side = Math.sign(mean(columns.aero_torque));
    return {...holdFigures(time, angle, 0), ...currentRipple(begin, Infinity, rows, outputs),
        rebound: Math.max(largest(angle.map(x => -side * x)), 0)};
}

function currentRipple(start, end, rows, {motor_current: whole}) {
    if (!whole) return {};
    const current = lastThird(...between(start, end, rows, whole)), middle = mean(current);
    return {current_ripple: rms(current.map(x => x - middle))};
}

const REDUCTIONS = {peak: magnitude, rms, share: column => mean(column.map(x => Number(x > 0.5)))};

/** The figures of any run from `begin` [s] on, as far as its outputs allow. */
function usage({excitation: {time: rows}, outputs: whole}, begin = 0) {
    const [time, ...columns] = between(begin, Infinity, rows, ...Object.values(whole)), figures = {};
    const outputs = Object.fromEntries(Object.keys(whole).map((name, k) => [name, columns[k]]));
    for (const [name, [reduction, output]] of Object.entries(DATA.usage)) {
        if (outputs[output]) figures[name] = REDUCTIONS[reduction](outputs[output]);
    }
    const power = outputs.supply_power;
    if (power) {
        const energy = sign => time.reduce((sum, t, k) => k === 0 ? 0 : sum +
            (Math.max(sign * power[k], 0) + Math.max(sign * power[k - 1], 0)) / 2 * (t - time[k - 1]), 0);
        Object.assign(figures, {
            peak_power: Math.max(largest(power), 0), energy_drawn: energy(1), energy_returned: energy(-1),
            peak_returned_power: Math.max(-smallest(power), 0)});
    }
    return figures;
}

/** All figures of a run: those of a motion where the command jumps once. */
function figures(run) {
    const command = run.excitation.columns.fin_command;
    const single = command && moves(run.excitation.time, command).length === 1;
    return {...(single ? motion(run) : {}), ...usage(run)};
}
