/* The tests of requirements, a port of bench/measure.py, and their verdicts, a port of bench/verdict.py. SI, unless a
 * unit is given. The function `respond(excitation, outputs)` returns a run, or null if it does not reach its end. */

/** The excitation of a test, whose columns are lists of [value, count]. The values of constant inputs are shares of the
    setting's values. */
function testExcitation({begin, stop, columns}, setting) {
    const whole = Object.entries(columns).map(([name, counted]) => {
        const unit = CONSTANT_INPUTS.some(v => v.name === name) ? Number(setting.get(name)) : 1;
        return [name, Float64Array.from(counted.flatMap(([value, count]) => Array(count).fill(unit * value)))];
    });
    return {time: times(stop), begin, columns: Object.fromEntries(whole)};
}

/** The figures of a test, in each direction if it has two; none if a run does not reach its end. */
function measure(test, setting, respond) {
    if (test.kind === "sine") return [bandwidths(test.figures, sines(test.amplitude, 0, respond).at)];
    const runs = test.runs.map(run => respond(testExcitation(run, setting), test.outputs));
    if (runs.includes(null)) return [{}];
    if (test.kind === "repeat") {
        const [used, fresh] = runs.map(({excitation: {time, begin}, outputs: {fin_angle: angle}}) =>
            between(begin, Infinity, time, angle)[1]);
        return [{repeat_error: magnitude(used.map((x, k) => x - fresh[k]))}];
    }
    const sides = runs.map(sideFigures), rates = sides.map(side => side.sustained_rate);
    return sides.map(side => ({...side, rate_asymmetry: 1 - Math.min(...rates) / Math.max(...rates)}));
}

/** The figures of a step, slew or load in one direction. */
function sideFigures(run) {
    const {time, begin, columns: {fin_command: command}} = run.excitation;
    const figures = {...usage(run, begin), ...(moves(time, command).length ? motion(run) : rest(run))};
    return {...figures, steady_error: Math.abs(figures.steady_error)};
}

/** The fundamental of the fin angle over a sine of the command, [real, imaginary]; NaN if the angle is not a sine. */
function describingFunction(amplitude, load, frequency, respond) {
    const {CYCLES, FITTED, TRANSIENT: [cycles, seconds], PURE} = DATA.constants, turn = 2 * Math.PI * frequency;
    const begin = Math.max(cycles / frequency, seconds);
    const end = begin + Math.ceil(Math.max(CYCLES / frequency, FITTED) * frequency) / frequency, time = times(end);
    const columns = {fin_command: time.map(t => amplitude * Math.sin(turn * t)), aero_torque: time.map(() => load)};
    const run = respond({time, begin, columns}, ["fin_angle"]);
    if (!run) return [NaN, NaN];
    const rows = [time.findIndex(t => t >= begin), time.findLastIndex(t => t <= end) + 1];
    const waves = [Math.cos, Math.sin].map(wave => time.map(t => wave(turn * t)));
    const [c, s, angle] = [...waves, run.outputs.fin_angle].map(column => {
        const fitted = column.subarray(...rows), middle = mean(fitted);
        return fitted.map(x => x - middle);  // for least squares with an offset
    });
    const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
    const [cc, ss, cs, cy, sy] = [dot(c, c), dot(s, s), dot(c, s), dot(c, angle), dot(s, angle)];
    const [a, b] = [cy * ss - sy * cs, sy * cc - cy * cs].map(x => x / (cc * ss - cs * cs));
    const pure = (a * a + b * b) / 2 >= PURE * dot(angle, angle) / angle.length;
    return pure ? [b / amplitude, a / amplitude] : [NaN, NaN];
}

/** The responses to sines of an amplitude [rad] under a load [N.m]: the function `at(frequency)`, and the map `known` of
    those computed so far. */
function sines(amplitude, load, respond) {
    const known = new Map();
    const at = frequency => {
        if (!known.has(frequency)) known.set(frequency, describingFunction(amplitude, load, frequency, respond));
        return known.get(frequency);
    };
    return {known, at};
}

const LEVELS = {bandwidth_3db: gain => Math.hypot(...gain) - 10 ** (-3 / 20), bandwidth_90deg: ([real]) => real};

/** The frequencies [Hz] at which gain or lag cross their levels, by name of the figure; without those that are NaN. */
function bandwidths(figures, at) {
    const crossings = figures.map(name => [name, crossed(f => LEVELS[name](at(f)))]);
    return Object.fromEntries(crossings.filter(([, value]) => !Number.isNaN(value)));
}

/** The frequency [Hz] at which a function `level`, positive at low frequency, first falls to zero, by bisection; the
    highest of the grid if it stays positive, the lowest if it is never positive; NaN if it is NaN before. */
function crossed(level) {
    const {BANDWIDTHS: [lowest, highest], BISECTIONS, GRID} = DATA.constants;
    let low = lowest, high = lowest, there = 1;
    for (high of GRID) {
        there = level(high);
        if (!(there > 0)) break;
        low = high;
    }
    if (low === highest) return highest;
    for (let k = 0; k < BISECTIONS && low < high && !Number.isNaN(there); ++k) {
        const middle = Math.sqrt(low * high);
        there = level(middle);
        if (there > 0) low = middle;
        else high = middle;
    }
    return Number.isNaN(there) ? NaN : Math.sqrt(low * high);
}

/** The frequency response: frequencies [Hz] at which it is a sine, gain [dB], unwrapped phase [°], bandwidths [Hz]. */
function frequencyResponse(amplitude, load, respond) {
    const {known, at} = sines(amplitude, load, respond), levels = bandwidths(Object.keys(LEVELS), at);
    for (const [k, frequency] of DATA.constants.GRID.entries()) {
        if (k) at(Math.sqrt(frequency * DATA.constants.GRID[k - 1]));
        at(frequency);
    }
    const pure = [...known].filter(([, [real]]) => !Number.isNaN(real)).sort(([f], [g]) => f - g);
    return {frequency: pure.map(([f]) => f), ...bode(pure.map(([, response]) => response), 0), ...levels};
}

/** The sign of a bandwidth [Hz] at an end of the search, which is only a bound; otherwise "". */
function boundOf(bandwidth) {
    const [lowest, highest] = DATA.constants.BANDWIDTHS;
    return bandwidth <= lowest ? "< " : bandwidth >= highest ? "> " : "";
}

/** The verdict on a requirement: value and margin in the requirement's unit, margin in % of the limit, worst case, and
    whether the requirement is met. `measured` has the figures of all directions for each test and case. */
function judged({test, figure, cases, sense, limit, factor}, measured) {
    const most = sense === "<=", worse = most ? Math.max : Math.min;
    const values = cases.map(name => worse(...measured[test][name].map(side => side[figure] ?? NaN)));
    const worst = worse(...values), value = worst * factor, margin = most ? limit - value : value - limit;
    return {value, margin, percent: limit ? 100 * margin / Math.abs(limit) : NaN,
        case: cases[values.findIndex(x => Object.is(x, worst))],
        bound: figure.startsWith("bandwidth") ? boundOf(worst) : "",
        passed: Number.isFinite(value) && margin >= 0};
}
