"use strict";
/* The figures of a response, as bench/metrics.py defines them; SI throughout. A port and not compiled: numpy and scipy
 * are no C. It has only what the page shows, and a test holds it against the original. */

/** The last place where `test` holds; -1 where it does nowhere. */
function lastIndex(values, test) {
    let k = values.length - 1;
    while (k >= 0 && !test(values[k])) --k;
    return k;
}

/** The first time [s] `values` reach `level` from below, by linear interpolation; NaN if never. */
function crossing(time, values, level) {
    const k = values.findIndex(value => value >= level);
    if (k <= 0) return k < 0 ? NaN : time[0];
    return time[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (time[k] - time[k - 1]);
}

/** The time [s] from the first row on after which `distance` stays within `band` for good; Infinity if it is not. */
function settling(time, distance, band) {
    const k = lastIndex(distance, value => !(value <= band));
    if (k < 0) return 0;
    if (k === time.length - 1) return Infinity;
    const inside = (distance[k] - band) / (distance[k] - distance[k + 1]);
    return time[k] - time[0] + inside * (time[k + 1] - time[k]);
}

/** The rows from `start` [s] on, up to `end` [s]; a nanosecond beside is on time. */
function between(start, end, time, ...columns) {
    const first = time.findIndex(t => t >= start - 1e-9), last = lastIndex(time, t => t <= end + 1e-9) + 1;
    return [time, ...columns].map(column => column.subarray(first, last));
}

const mean = values => values.reduce((sum, x) => sum + x, 0) / values.length;
const largest = values => values.reduce((most, x) => Math.max(most, x), -Infinity);
const magnitude = values => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
const rms = values => Math.sqrt(mean(values.map(x => x * x)));

/** The figures of a motion [rad] commanded at `start` [s] to a level [rad]. */
function stepMetrics(time, response, start, command) {
    const travel = command - response[0], share = response.map(angle => (angle - response[0]) / travel);
    const [tenth, most] = [0.1, 0.9].map(level => crossing(time, share, level));
    const tail = response.filter((_, k) => time[k] > time[time.length - 1] - DATA.constants.TAIL);
    return {
        rise_time: most - tenth,
        settling_time: settling(time, share.map(x => Math.abs(x - 1)), 0.02),
        time_to_accuracy: settling(time, response.map(x => Math.abs(x - command)), DATA.constants.ACCURACY),
        time_to_90_percent: most - start,
        overshoot: Math.max(largest(share) - 1, 0),
        steady_error: mean(response.subarray(-Math.max(Math.floor(time.length / 10), 1))) - command,
        ripple: largest(tail) + largest(tail.map(x => -x)),
        sustained_rate: Math.abs(travel) * 0.6 / (crossing(time, share, 0.8) - crossing(time, share, 0.2)),
    };
}

/** The last jump of a run's command. */
function lastMove({excitation: {time, columns}}) {
    const jumps = moves(time, columns.fin_command);
    return jumps[jumps.length - 1];
}

/** The figures of the last jump of the command. */
function motion(run) {
    const {excitation, outputs} = run, move = lastMove(run);
    const [time, angle, rate] = between(move.start, move.end, excitation.time, outputs.fin_angle, outputs.fin_rate);
    return {...stepMetrics(time, angle, move.start, move.level), peak_rate: magnitude(rate)};
}

/** The mean fin angle - command [rad] over the end of a hold. */
function heldError(run) {
    const {excitation: {time}, outputs} = run;
    const end = outputs.fin_angle.filter((_, k) => time[k] > time[time.length - 1] - DATA.constants.HELD);
    return mean(end) - lastMove(run).level;
}

const REDUCTIONS = {peak: magnitude, rms, share: column => mean(column.map(x => Number(x > 0.5)))};

/** The figures any run has, as far as the actuator has the outputs. */
function usage({excitation: {time}, outputs}) {
    const figures = {};
    for (const [name, [reduction, output]] of Object.entries(DATA.usage)) {
        if (outputs[output]) figures[name] = REDUCTIONS[reduction](outputs[output]);
    }
    const power = outputs.supply_power;
    if (power) {
        const energy = sign => time.reduce((sum, t, k) => k === 0 ? 0 : sum +
            (Math.max(sign * power[k], 0) + Math.max(sign * power[k - 1], 0)) / 2 * (t - time[k - 1]), 0);
        Object.assign(figures, {
            peak_power: Math.max(largest(power), 0), energy_drawn: energy(1), energy_returned: energy(-1),
            peak_returned_power: Math.max(largest(power.map(x => -x)), 0)});
    }
    return figures;
}

/** All figures of a run: those of a motion where the command jumps once. */
function figures(run) {
    const command = run.excitation.columns.fin_command;
    const single = command && moves(run.excitation.time, command).length === 1;
    return {...(single ? motion(run) : {}), ...usage(run)};
}

/** The rows by which a response lags its command most alike; looked for within 0.25 s, beyond which none would. */
function lagOf(command, response) {
    const reach = Math.round(0.25 / STEP);
    let best = -Infinity, lag = 0;
    for (let shift = -reach; shift <= reach; ++shift) {
        let sum = 0;
        const last = command.length - Math.max(shift, 0);
        for (let k = Math.max(-shift, 0); k < last; ++k) sum += command[k] * response[k + shift];
        if (sum > best) [best, lag] = [sum, shift];
    }
    return Math.max(lag, 0);
}

/** Cross- and auto-spectrum, sums over Hann segments: the command's conjugate by the response, and by itself, a bin. */
function spectra(command, response, length, bins) {
    const points = 8 * length, step = length - Math.floor(DATA.constants.OVERLAP * length);
    const cosine = Float64Array.from({length: points}, (_, k) => Math.cos(2 * Math.PI * k / points));
    const sine = Float64Array.from({length: points}, (_, k) => Math.sin(2 * Math.PI * k / points));
    const cross = bins.map(() => [0, 0]), auto = bins.map(() => 0);
    const c = new Float64Array(length), r = new Float64Array(length);
    for (let first = 0; first + length <= command.length; first += step) {
        for (let k = 0; k < length; ++k) {
            const window = 0.5 - 0.5 * cosine[8 * k];
            [c[k], r[k]] = [window * command[first + k], window * response[first + k]];
        }
        bins.forEach((bin, i) => {
            let at = 0, cc = 0, cs = 0, rc = 0, rs = 0;
            for (let k = 0; k < length; ++k) {
                cc += c[k] * cosine[at], cs -= c[k] * sine[at], rc += r[k] * cosine[at], rs -= r[k] * sine[at];
                at += bin;
                if (at >= points) at -= points;
            }
            cross[i][0] += cc * rc + cs * rs;
            cross[i][1] += cc * rs - cs * rc;
            auto[i] += cc * cc + cs * cs;
        });
    }
    return {cross, auto};
}

/** The H1 estimate of a run under a sweep: frequency [Hz], gain [dB], phase [rad, unwrapped], both bandwidths [Hz]. */
function frequencyResponse({excitation: {columns: {fin_command: given}}, outputs: {fin_angle: angle}}) {
    const lag = lagOf(given, angle), [low, high] = DATA.constants.SWEPT;
    const command = given.subarray(0, given.length - lag), response = angle.subarray(lag);
    const length = Math.min(Math.round(DATA.constants.SEGMENT / STEP), command.length);
    const spacing = 1 / (8 * length * STEP);
    const bins = Array.from({length: Math.floor(high / spacing) + 1}, (_, bin) => bin);
    const {cross, auto} = spectra(command, response, length, bins);
    auto[0] /= 2;  // of a one-sided density
    const strongest = largest(auto);
    const taken = bins.filter(bin => bin * spacing >= low && auto[bin] > DATA.constants.EXCITED * strongest);
    const frequency = taken.map(bin => bin * spacing);
    const gain = taken.map(bin => 20 * Math.log10(Math.hypot(...cross[bin]) / auto[bin]));
    const phase = taken.map(bin =>
        Math.atan2(cross[bin][1], cross[bin][0]) - 2 * Math.PI * bin * spacing * lag * STEP);
    const turn = 2 * Math.PI;
    phase.forEach((_, i) => { phase[i] -= turn * Math.round((phase[i] - (i ? phase[i - 1] : 0)) / turn); });
    return {frequency, gain, phase, bandwidth: crossing(frequency, gain.map(x => -x), 3),
        phase_bandwidth: crossing(frequency, phase.map(x => -x), Math.PI / 2)};
}

const degrees = angle => angle * 180 / Math.PI;
/** What bench/verdict.py measures for the rows of Table 2, of finished runs. */
const MEASURES = {
    range: runs => degrees(Math.min(...runs.map(run => Math.abs(lastMove(run).level + heldError(run))))),
    accuracy: runs => degrees(Math.max(...runs.map(run => Math.abs(heldError(run))))),
    rate: runs => degrees(runs.reduce((least, run) => Math.min(least, motion(run).sustained_rate), Infinity)),
    bandwidth: ([run]) => run.frequency.bandwidth,
};
