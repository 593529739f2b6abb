/* The actuator linearised at rest at 0, and the margins of its loop broken at the drive's reference: a port of
 * bench/linear, with finite differences of the equations without quantisation. Sampling and delay are exact. */

const DIFFERENCE = 1e-6; // step of differences, relative to an argument above 1; Jacobians are accurate to 1e-7
const AT_A_POLE = 1e-6; // distance from a pole z within which a response is not evaluated: bench/linear/frequency.py
const DECAYS = 1 - 1e-10; // limit of the magnitudes of a stable loop's poles z, as in bench/linear/systems.py

const zeros = (rows, columns) => Array.from({length: rows}, () => new Float64Array(columns));
const unit = size => zeros(size, size).map((row, i) => row.fill(1, i, i + 1));
const applied = (matrix, vector) => matrix.map(row => row.reduce((sum, x, k) => sum + x * vector[k], 0));
const product = (a, b) => a.map(row => b[0].map((_, j) => row.reduce((sum, x, k) => sum + x * b[k][j], 0)));

/** The values and the Jacobian, by central differences, of a function of an array. The shifted calls choose the same
    sides of conditions as the call at the centre, as in ops/symbols. */
function differenced(f, at) {
    const x = Float64Array.from(at), values = f(x), slopes = zeros(values.length, x.length);
    for (const [j, middle] of at.entries()) {
        const h = DIFFERENCE * Math.max(1, Math.abs(middle));
        const [[up, above], [down, below]] = [middle + h, middle - h].map(moved => {
            x[j] = moved;
            return [f(x, true), x[j]];
        });
        x[j] = middle;
        slopes.forEach((row, i) => { row[j] = (up[i] - down[i]) / (above - below); });
    }
    return {values, slopes};
}

/** The solution of linear equations, by elimination; the last element of each row is its right side. */
function solved(rows) {
    for (const k of rows.keys()) {
        let p = k;
        for (let i = k; i < rows.length; ++i) if (Math.abs(rows[i][k]) > Math.abs(rows[p][k])) p = i;
        const pivot = rows[p].map(x => x / rows[p][k]);
        rows[p] = rows[k];
        rows = rows.map((row, i) => i === k ? pivot : row.map((x, j) => x - row[k] * pivot[j]));
    }
    return rows.map(row => row.at(-1));
}

/** The exponential of a matrix, by scaling, a power series and repeated squaring. */
function exponential(a) {
    const size = largest(a.map(row => row.reduce((sum, x) => sum + Math.abs(x), 0)));
    const halvings = Math.max(0, Math.ceil(Math.log2(size)) + 2), scale = 2 ** -halvings;
    let sum = unit(a.length), term = sum;
    for (let k = 1; k < 14; ++k) {
        term = product(term, a.map(row => row.map(x => x * scale / k)));
        sum = sum.map((row, i) => row.map((x, j) => x + term[i][j]));
    }
    for (let k = 0; k < halvings; ++k) sum = product(sum, sum);
    return sum;
}

/** The sum of a row's elements at the indices. */
const sumAt = (row, indices) => indices.reduce((sum, j) => sum + row[j], 0);

/** The indices of the moving states, in groups of states whose rates have equal values and slopes: they move together. */
function groupsOf(values, slopes, count) {
    const groups = new Map();
    for (let i = 0; i < count; ++i) {
        const key = [values[i], ...slopes[i]].join();
        if (slopes[i].some(Boolean)) groups.set(key, [...groups.get(key) ?? [], i]);
    }
    return [...groups.values()];
}

/** The plant at rest at 0, by Newton's method: arguments, groups of moving states, Jacobian; null if it cannot rest. */
function equilibrium(plant, start, sampledStates) {
    const count = start.length, x = [...start, 0, 0, ...sampledStates];  // the zeros are reference and hinge moment
    let moving;
    for (let k = 0; k < 30; ++k) {
        const {values, slopes} = differenced(plant, x);
        moving ??= groupsOf(values, slopes, count);
        const unknown = [...moving, [count]], n = unknown.length;
        const rows = unknown.map(([i]) => {
            const row = [...unknown.map(group => sumAt(slopes[i], group)), -values[i]];
            const size = magnitude(row.slice(0, n)) || 1;
            return Float64Array.from(row, value => value / size);
        });
        const change = solved(rows);
        if (!change.every(Number.isFinite)) return null;
        unknown.forEach((group, k) => group.forEach(i => { x[i] += change[k]; }));
        if (change.every((step, j) => Math.abs(step) <= 1e-12 * (1 + Math.abs(x[unknown[j][0]])))) {
            return {x, moving, slopes};
        }
    }
    return null;
}

/** For a setting with changed parameters: the transposed transition matrices of one sample, `open` with the loop broken
    at the reference and `closed`, and the sample time `period` [s]. Null if the actuator cannot rest at 0, or if the
    matrices are not finite. */
function linearised(actuator, setting, changes) {
    const {states: count, kept, sampled, supply} = DATA.linear;
    const {start, plant, controllers, schedule} = actuator.equations(
        {...setting.parameters, ...changes}, supply ? Number(setting.get(supply)) : 0);
    const [period, , , arrival, , , whole] = schedule;
    const rest = equilibrium(plant, start.slice(0, count), start.slice(count + kept - sampled));
    if (!rest) return null;
    const {x, moving, slopes} = rest, n = moving.length, ins = 1 + sampled, delayed = whole + Number(arrival > 0);
    /* The plant in the parts of a period before and after the delayed reference arrives. */
    const sources = [[count], ...Array.from({length: sampled}, (_, k) => [count + 2 + k])];
    const [before, after] = [arrival, period - arrival].map(time => exponential([
        ...moving.map(([i]) => Float64Array.from([...moving, ...sources], group => time * sumAt(slopes[i], group))),
        ...zeros(ins, n + ins)]));
    /* The controllers, without constant states such as an integral whose gain is 0. */
    const {slopes: jacobian} = differenced(controllers, [...start.slice(count), ...x.slice(0, count), 0]);
    const varying = [...Array(kept).keys()].filter(i => jacobian[i].some((slope, j) => slope !== Number(i === j)));
    /* The states after a sample: plant, delayed references (newest first), controllers. */
    const sample = (states, closed) => {
        const at = Array(kept + count + 1).fill(0);
        moving.forEach((group, k) => group.forEach(i => { at[kept + i] = states[k]; }));
        varying.forEach((i, k) => { at[i] = states[n + delayed + k]; });
        const next = applied(jacobian, at), plantInputs = next.slice(kept + 2);
        const sent = [closed ? next[kept] : 0, ...states.slice(n, n + delayed), 0];
        const middle = applied(before, [...states.slice(0, n), sent[whole + 1], ...plantInputs]);
        const end = applied(after, [...middle.slice(0, n), sent[whole], ...plantInputs]);
        return [...end.slice(0, n), ...sent.slice(0, delayed), ...varying.map(i => next[i])];
    };
    const size = n + delayed + varying.length;
    const [open, closed] = [false, true].map(each => unit(size).map(states => sample(states, each)));
    return closed.every(row => row.every(Number.isFinite)) ? {open, closed, period} : null;
}

/** The response L of a loop at a point z = [x, y], from the poles: 1 + L = det(z - closed) / det(z - open). */
function loopAt(opened, closed, z) {
    const ratios = closed.map((pole, k) => divided(minus(z, pole), minus(z, opened[k])));
    return minus(ratios.reduce(multiplied, [1, 0]), [1, 0]);
}

/** The growth of a response per sample: the largest magnitude of the poles z. */
const growthOf = poles => largest(poles.map(z => Math.hypot(...z)));

/** The frequency [Hz] between `low` and `high` at which a function changes its sign, by bisection to the last bit. */
function signChange(f, low, high) {
    const below = f(low) > 0;
    for (let k = 0; k < 52; ++k) {
        const middle = (low + high) / 2;
        if (f(middle) > 0 === below) low = middle;
        else high = middle;
    }
    return low;
}

/** Additional points [frequency in Hz, response] between two points if the response turns by more than 20°, or changes
    by more than a factor of 1.39, between them. */
function turning(at, low, high, depth = 16) {
    const [[from, [a, b]], [to, [c, d]]] = [low, high], size = Math.hypot(a, b) * Math.hypot(c, d);
    const turned = a * c + b * d < 0.94 * size, changed = Math.abs(Math.log(Math.hypot(c, d) / Math.hypot(a, b))) > 0.33;
    if (!depth || !(turned || changed)) return [];
    const f = (from + to) / 2, middle = [f, at(f)];
    return [...turning(at, low, middle, depth - 1), middle, ...turning(at, middle, high, depth - 1)];
}

/** The loop of a setting with changed parameters: frequency [Hz], refined at resonances, gain [dB], unwrapped phase
    [°], margins, and the crossovers [Hz] of gain and phase margin. Margins are NaN if the closed loop is unstable or the
    loop's gain is 0. Null if there is no linear model. */
function loopOf(actuator, setting, changes) {
    const loop = linearised(actuator, setting, changes);
    if (!loop) return null;
    const {open, closed, period} = loop, highest = 0.499 / period;
    const {LOOP_LOWEST: lowest, LOOP_POINTS: points} = DATA.constants;
    const grid = Array.from({length: points}, (_, k) => lowest * (highest / lowest) ** (k / (points - 1)));
    const [opened, poles] = [open, closed].map(eigenvalues), stable = growthOf(poles) < DECAYS;
    /* The response is infinite at an undamped pole: only the points around it are used. */
    const regular = opened.filter(([x, y]) => Math.abs(1 - Math.hypot(x, y)) > AT_A_POLE);
    const peaks = regular.map(([x, y]) => Math.atan2(y, x) / (2 * Math.PI * period));
    const at = f => loopAt(opened, poles, [Math.cos, Math.sin].map(wave => wave(2 * Math.PI * f * period)));
    const known = [...grid, ...peaks.filter(f => f > lowest && f < highest)].sort((f, g) => f - g).map(f => [f, at(f)]);
    const refined = known.flatMap((point, k) => k ? [...turning(at, known[k - 1], point), point] : [point]);
    const frequency = refined.map(([f]) => f), response = refined.map(([, value]) => value);
    const {gain, phase} = bode(response, -180);
    if (!stable || gain.every(value => value < -200)) {
        const none = {gain_margin: NaN, phase_margin: NaN, delay_margin: NaN, marks: []};
        return {period, frequency, gain, phase, poles, stable, idle: stable, ...none};
    }
    const crossed = f => [...frequency.keys()].slice(1).filter(k =>
        f(response[k - 1]) * f(response[k]) < 0).map(k => signChange(g => f(at(g)), frequency[k - 1], frequency[k]));
    const isFree = z => opened.every(([x, y]) => Math.hypot(x - z, y) > AT_A_POLE);
    const ends = [[1, 0], [-1, 0.5 / period]].filter(([z]) => isFree(z)).map(([z, f]) =>
        [loopAt(opened, poles, [z, 0])[0], f]);
    const real = [...crossed(value => value[1]).map(f => [at(f)[0], f]), ...ends].filter(([value]) => value < 0);
    const gains = real.map(([value, f]) => [Math.abs(20 * Math.log10(-value)), f]);
    const phases = crossed(value => Math.hypot(...value) - 1).map(f => {
        const [x, y] = at(f), angle = Math.atan2(-y, -x);
        return [angle, f, (angle < 0 ? angle + 2 * Math.PI : angle) / (2 * Math.PI * f)];
    });
    const least = (rows, size) => rows.reduce((a, b) => size(b) < size(a) ? b : a, [Infinity, NaN, Infinity]);
    const [gainMargin, phaseCrossover] = least(gains, ([x]) => x);
    const [phaseMargin, gainCrossover] = least(phases, ([x]) => Math.abs(x));
    /* The phase is shifted by whole turns to be as near as possible to -90° at the gain crossover. */
    const read = (column, f) => resampled([f], frequency, column)[0];
    const turns = gainCrossover ? Math.round((read(phase, gainCrossover) + 90) / 360) : 0;
    phase.forEach((lag, k) => { phase[k] = lag - 360 * turns; });
    const marks = [phaseCrossover, gainCrossover].filter(f => f > 0 && f <= highest).map(f =>
        ({frequency: f, gain: read(gain, f), phase: read(phase, f)}));
    return {period, frequency, gain, phase, poles, stable, marks, phaseCrossover, gainCrossover,
        gain_margin: gainMargin, phase_margin: phaseMargin, delay_margin: least(phases, row => row[2])[2]};
}
