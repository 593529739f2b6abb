/* The figures of a response that the page shows, a port of bench/metrics.py. All values are in SI. */

const mean = values => values.reduce((sum, x) => sum + x, 0) / values.length;
const largest = values => values.reduce((most, x) => Math.max(most, x), -Infinity);
const smallest = values => values.reduce((least, x) => Math.min(least, x), Infinity);
const magnitude = values => largest(values.map(Math.abs));
const degrees = angle => angle * 180 / Math.PI;
const rms = values => Math.sqrt(mean(values.map(x => x * x)));

/** Gain [dB] and unwrapped phase [°] of responses [real, imaginary]; the phase begins within 180° of `last`. */
function bode(responses, last) {
    const gain = responses.map(response => 20 * Math.log10(Math.hypot(...response)));
    const phase = responses.map(([real, imaginary]) => {
        const lag = degrees(Math.atan2(imaginary, real));
        last = lag - 360 * Math.round((lag - last) / 360);
        return last;
    });
    return {gain, phase};
}

/** The first time [s] at which `values` reach `level` from below, by linear interpolation; NaN if never. */
function crossing(time, values, level) {
    const k = values.findIndex(value => value >= level);
    if (k <= 0) return k < 0 ? NaN : time[0];
    return time[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (time[k] - time[k - 1]);
}

/** The time [s] from the first row until `distance` stays within `band`; Infinity for a time in the last third. */
function settled(time, distance, band) {
    const last = time.length - 1, k = distance.findLastIndex(value => !(value <= band));
    if (k < 0) return 0;
    if (k === last) return Infinity;
    const inside = (distance[k] - band) / (distance[k] - distance[k + 1]);
    const after = time[k] - time[0] + inside * (time[k + 1] - time[k]);
    return after > (1 - DATA.constants.HELD) * (time[last] - time[0]) ? Infinity : after;
}

/** The rows of time and columns from `start` to `end` [s], including rows up to a nanosecond outside. */
function between(start, end, time, ...columns) {
    const first = time.findIndex(t => t >= start - 1e-9), last = time.findLastIndex(t => t <= end + 1e-9) + 1;
    return [time, ...columns].map(column => column.subarray(first, last));
}

function lastThird(time, column) {
    const end = time[time.length - 1];
    return between(end - DATA.constants.HELD * (end - time[0]), end, time, column)[1];
}

/** The figures of a hold from `start` to `end` [s] at a constant command [rad]. */
function hold({excitation: {time: rows}, outputs: {fin_angle: angle, motor_current: current}}, start, end, command) {
    const [time, response] = between(start, end, rows, angle), error = response.map(x => x - command);
    const held = lastThird(time, response), off = lastThird(time, error), figures = {
        time_to_accuracy: settled(time, error.map(Math.abs), DATA.constants.ACCURACY),
        steady_error: mean(off), held_error: magnitude(off), held_angle: smallest(held.map(Math.abs)),
        ripple: largest(held) - smallest(held),
    };
    if (!current) return figures;
    const flowing = lastThird(...between(start, end, rows, current));
    const second = Math.max(Math.round((time.length - 1) / Math.max(time.at(-1) - time[0], 1e-9)), 1), deviations = [];
    for (let end = flowing.length; end > Math.min(second, flowing.length - 1); end -= second) {
        const within = flowing.subarray(Math.max(end - second - 1, 0), end), middle = mean(within);
        deviations.push(rms(within.map(x => x - middle)));
    }
    return {...figures, current_ripple: largest(deviations)};
}

/** The figures of the last jump of the command. */
function motion(run) {
    const {excitation: {time: rows, columns}, outputs} = run;
    const {start, end, level} = moves(rows, columns.fin_command).pop();
    const [time, angle, rate] = between(start, end, rows, outputs.fin_angle, outputs.fin_rate);
    const travel = level - angle[0], share = angle.map(x => (x - angle[0]) / travel);
    const [tenth, fifth, most, ninth] = [0.1, 0.2, 0.8, 0.9].map(reached => crossing(time, share, reached));
    return {
        rise_time: ninth - tenth, settling_time: settled(time, share.map(x => Math.abs(x - 1)), 0.02),
        time_to_90_percent: ninth - start, overshoot: Math.max(largest(share) - 1, 0), ...hold(run, start, end, level),
        sustained_rate: Math.abs(travel) * 0.6 / (most - fifth), peak_rate: magnitude(rate),
    };
}

/** The figures of a fin that is held at command 0 under a hinge moment. */
function rest(run) {
    const {excitation: {time, begin, columns}, outputs} = run, side = Math.sign(mean(columns.aero_torque));
    const [, angle] = between(begin, Infinity, time, outputs.fin_angle);
    return {...hold(run, begin, Infinity, 0), rebound: Math.max(largest(angle.map(x => -side * x)), 0)};
}

const REDUCTIONS = {peak: magnitude, rms, share: column => mean(column.map(x => Number(x > 0.5)))};

/** The usage figures of a run from `begin` [s] on; those of outputs that the run does not have are left out. */
function usage({excitation: {time: rows}, outputs: whole}, begin = 0) {
    const [time, ...columns] = between(begin, Infinity, rows, ...Object.values(whole)), figures = {};
    const outputs = Object.fromEntries(Object.keys(whole).map((name, k) => [name, columns[k]]));
    for (const [name, {reduction, needs: [output]}] of Object.entries(DATA.figures)) {
        if (reduction && outputs[output]) figures[name] = REDUCTIONS[reduction](outputs[output]);
    }
    return outputs.supply_power ? {...figures, ...powerFigures(time, outputs.supply_power)} : figures;
}

/** The usage figures of the supply's power [W]; integrals by the trapezoidal rule. */
function powerFigures(time, power) {
    const integral = column => column.reduce((sum, x, k) =>
        k ? sum + (x + column[k - 1]) / 2 * (time[k] - time[k - 1]) : 0, 0);
    const [drawn, returned] = [1, -1].map(sign => power.map(x => Math.max(sign * x, 0)));
    const net = integral(power), duration = time[time.length - 1] - time[0];
    return {
        peak_power: largest(drawn), energy_drawn: integral(drawn), peak_returned_power: largest(returned),
        energy_returned: integral(returned), net_energy: net, mean_power: net / duration,
        rms_power: Math.sqrt(integral(power.map(x => x * x)) / duration),
    };
}

/** All figures of a run; those of a motion only if the command jumps exactly once from `begin` of the excitation on. */
function figures(run) {
    const {time, begin, columns: {fin_command: command}} = run.excitation;
    const jumps = command ? moves(time, command).filter(({start}) => start > begin - STEP / 2) : [];
    return {...(jumps.length === 1 ? motion(run) : {}), ...usage(run)};
}
