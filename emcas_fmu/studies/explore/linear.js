"use strict";
/* The actuator linearised at rest at 0, and the margins of its loop broken at the drive's reference: a port of
 * bench/linear. Its equations, the kernel's without quantisation, are differenced; sampling and delay are exact. */

const DIFFERENCE = 1e-6; // of an argument above 1; Jacobians are accurate to 1e-7
const AT_A_POLE = 1e-6; // distance from a pole below which a loop has no value, as in bench/linear/frequency.py
const DECAYS = 1 - 1e-10; // largest magnitude of a pole z of a stable loop, as in bench/linear/systems.py

const zeros = (rows, columns) => Array.from({length: rows}, () => new Float64Array(columns));
const product = (a, b) => a.map(row => b[0].map((_, j) => row.reduce((sum, x, k) => sum + x * b[k][j], 0)));

/** Values and Jacobian of a function of an array, by central differences; a choice keeps its side, as in ops/symbols. */
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

/** Solves (re + i im) x = b by elimination; rows have b as their last element. Returns [real, imaginary] of x. */
function solved(re, im) {
    const n = re.length;
    for (let k = 0; k < n; ++k) {
        let p = k, most = -1;
        for (let i = k; i < n; ++i) {
            const size = re[i][k] * re[i][k] + im[i][k] * im[i][k];
            if (size > most) [p, most] = [i, size];
        }
        for (const rows of [re, im]) [rows[k], rows[p]] = [rows[p], rows[k]];
        const u = re[k], v = im[k], a = u[k] / most, b = v[k] / most;
        for (let j = k; j <= n; ++j) {
            const x = u[j], y = v[j];
            u[j] = x * a + y * b;
            v[j] = y * a - x * b;
        }
        for (let i = k + 1; i < n; ++i) {
            const s = re[i], t = im[i], x = s[k], y = t[k];
            if (x === 0 && y === 0) continue;
            for (let j = k; j <= n; ++j) {
                s[j] -= x * u[j] - y * v[j];
                t[j] -= x * v[j] + y * u[j];
            }
        }
    }
    for (let k = n - 1; k > 0; --k) {
        const x = re[k][n], y = im[k][n];
        for (let i = 0; i < k; ++i) {
            re[i][n] -= x * re[i][k] - y * im[i][k];
            im[i][n] -= x * im[i][k] + y * re[i][k];
        }
    }
    return [re, im].map(rows => rows.map(row => row[n]));
}

/** The exponential of a matrix, by its series for a share of it, squared. */
function exponential(a) {
    const size = largest(a.map(row => row.reduce((sum, x) => sum + Math.abs(x), 0)));
    const halvings = Math.max(0, Math.ceil(Math.log2(size)) + 2), scale = 2 ** -halvings;
    let sum = a.map((_, i) => a[0].map((_, j) => Number(i === j))), term = sum;
    for (let k = 1; k < 14; ++k) {
        term = product(term, a.map(row => row.map(x => x * scale / k)));
        sum = sum.map((row, i) => row.map((x, j) => x + term[i][j]));
    }
    for (let k = 0; k < halvings; ++k) sum = product(sum, sum);
    return sum;
}

/** The sum of a row's elements. */
const over = (row, indices) => indices.reduce((sum, j) => sum + row[j], 0);

/** The states that move, in groups of those with equal rates, which are one mode. */
function groupsOf(values, slopes, count) {
    const groups = new Map();
    for (let i = 0; i < count; ++i) {
        const key = [values[i], ...slopes[i]].join();
        if (slopes[i].some(Boolean)) groups.set(key, [...groups.get(key) ?? [], i]);
    }
    return [...groups.values()];
}

/** The plant at rest at 0: arguments, groups of moving states, Jacobian; null if it cannot rest. */
function rested(plant, start, held) {
    const count = start.length, x = [...start, 0, 0, ...held];  // reference, hinge moment
    let moving;
    for (let k = 0; k < 30; ++k) {
        const {values, slopes} = differenced(plant, x);
        moving ??= groupsOf(values, slopes, count);
        const unknown = [...moving, [count]], n = unknown.length;
        const rows = unknown.map(([i]) => {
            const row = [...unknown.map(group => over(slopes[i], group)), -values[i]];
            const size = magnitude(row.slice(0, n)) || 1;
            return Float64Array.from(row, value => value / size);
        });
        const [change] = solved(rows, zeros(n, n + 1));
        unknown.forEach((group, k) => group.forEach(i => { x[i] += change[k]; }));
        if (!change.every(Number.isFinite)) return null;
        if (change.every((step, j) => Math.abs(step) <= 1e-12 * (1 + Math.abs(x[unknown[j][0]])))) {
            return {x, moving, slopes};
        }
    }
    return null;
}

/** The loop from the reference to the controllers' answer, over samples: x' = a x + b u, reference = c x; with the
    sample time [s]. Null if the actuator cannot rest at 0. */
function linearised(actuator, parameters, supply) {
    const {states: count, kept, sampled} = DATA.linear;
    const {start, plant, controllers, schedule} = actuator.equations(parameters, supply);
    const [period, , , arrival, , , whole] = schedule;
    const rest = rested(plant, start.slice(0, count), start.slice(count + kept - sampled));
    if (!rest) return null;
    const {x, moving, slopes} = rest, n = moving.length, ins = 1 + sampled, late = whole + Number(arrival > 0);
    /* The plant over the parts of a period before and after the delayed reference arrives. */
    const sources = [[count], ...Array.from({length: sampled}, (_, k) => [count + 2 + k])];
    const [before, after] = [arrival, period - arrival].map(time => exponential([
        ...moving.map(([i]) => Float64Array.from([...moving, ...sources], group => time * over(slopes[i], group))),
        ...zeros(ins, n + ins)]));
    const through = product(after.slice(0, n).map(row => row.subarray(0, n)), before.slice(0, n));
    const aged = age => through.map((row, i) => age === whole ? after[i][n] : age === whole + 1 ? row[n] : 0);
    /* The controllers, without constant states such as an integral whose gain is 0. */
    const {slopes: of} = differenced(controllers, [...start.slice(count), ...x.slice(0, count), 0]);
    const own = [...Array(kept).keys()].filter(i => of[i].some((slope, j) => slope !== Number(i === j)));
    const columns = [...moving.map(group => group.map(i => kept + i)), ...Array(late).fill([]), ...own.map(i => [i])];
    const row = i => Float64Array.from(columns, group => over(of[i], group)), size = columns.length;
    const fed = sources.slice(1).map((_, k) => row(kept + 2 + k));
    const lines = Array.from({length: late + 1}, (_, k) => aged(k));
    const a = [
        ...through.map((free, i) => Float64Array.from(columns, (_, j) => (j < n ? free[j] :
            j < n + late ? lines[j - n + 1][i] : 0) +
            fed.reduce((sum, line, k) => sum + (free[n + 1 + k] + after[i][n + 1 + k]) * line[j], 0))),
        ...Array.from({length: late}, (_, k) => Float64Array.from(columns, (_, j) => Number(k > 0 && j === n + k - 1))),
        ...own.map(row)];
    const b = Float64Array.from(columns, (_, i) => i < n ? lines[0][i] : Number(late > 0 && i === n));
    if (!a.every(each => each.every(Number.isFinite))) return null;
    /* Scaled, and with few elements below the diagonal, so that responses are fast. */
    const [[, ...c], ...rows] = hessenberg(balanced([[0, ...row(kept)], ...a.map((each, i) => [b[i], ...each])]));
    return {a: rows.map(each => each.subarray(1)), b: rows.map(each => each[0]), c, period, size};
}

/** The response of a loop L, closed by 1 + L, at a point z = [real, imaginary]. */
function loopAt({a, b, c, size}, [x, y]) {
    const re = zeros(size, size + 1), im = zeros(size, size + 1);
    for (let i = 0; i < size; ++i) {
        for (let j = 0; j < size; ++j) re[i][j] = -a[i][j];
        re[i][i] += x;
        im[i][i] = y;
        re[i][size] = b[i];
    }
    return solved(re, im).map(states => -states.reduce((sum, state, k) => sum + c[k] * state, 0));
}

/** The poles z of a loop, or with its loop closed, as [real, imaginary]. */
function polesOf({a, b, c}, closed = false) {
    return eigenvalues(closed ? a.map((row, i) => row.map((x, j) => x + b[i] * c[j])) : a);
}

/** The growth of a response over a sample: the largest magnitude of a pole z. */
const growthOf = poles => largest(poles.map(z => Math.hypot(...z)));
const isStable = poles => growthOf(poles) < DECAYS;

/** The frequency [Hz] between two at which a function changes its sign, by false position (Illinois). */
function signChange(f, from, to) {
    let [low, high] = [Math.log(from), Math.log(to)], below = f(from), above = f(to), side = 0;
    for (let k = 0; k < 60 && high - low > 1e-12; ++k) {
        const middle = (low * above - high * below) / (above - below), value = f(Math.exp(middle));
        if (value === 0) return Math.exp(middle);
        const left = value > 0 === below > 0;
        if (left) [low, below, above] = [middle, value, side === 1 ? above / 2 : above];
        else [high, above, below] = [middle, value, side === -1 ? below / 2 : below];
        side = left ? 1 : -1;
        if (Math.abs(value) < 1e-10) return Math.exp(middle);
    }
    return Math.exp((low + high) / 2);
}

/** Points [Hz, response] between two, where a narrow resonance or notch turns or changes the response by a third. */
function turning(at, low, high, depth = 16) {
    const [[from, [a, b]], [to, [c, d]]] = [low, high], size = Math.hypot(a, b) * Math.hypot(c, d);
    const turned = a * c + b * d < 0.94 * size, changed = Math.abs(Math.log(Math.hypot(c, d) / Math.hypot(a, b))) > 0.33;
    if (!depth || !(turned || changed)) return [];
    const f = (from + to) / 2, middle = [f, at(f)];
    return [...turning(at, low, middle, depth - 1), middle, ...turning(at, middle, high, depth - 1)];
}

/** Frequency [Hz], also those of resonances, gain [dB] and unwrapped phase [°] of a loop, and the figures of its
    margins, with the frequencies [Hz] of those of gain and phase; NaN if it is unstable when closed. */
function openLoop(loop) {
    const {LOOP_LOWEST: lowest, LOOP_POINTS: points} = DATA.constants, {period} = loop, highest = 0.499 / period;
    const grid = Array.from({length: points}, (_, k) => lowest * (highest / lowest) ** (k / (points - 1)));
    const opened = polesOf(loop), peaks = opened.map(([x, y]) => Math.atan2(y, x) / (2 * Math.PI * period));
    const at = f => loopAt(loop, [Math.cos, Math.sin].map(wave => wave(2 * Math.PI * f * period)));
    const known = [...grid, ...peaks.filter(f => f > lowest && f < highest)].sort((f, g) => f - g).map(f => [f, at(f)]);
    const followed = known.flatMap((point, k) => k ? [...turning(at, known[k - 1], point), point] : [point]);
    const frequency = Float64Array.from(followed, ([f]) => f), response = followed.map(([, value]) => value);
    const gain = Float64Array.from(response, value => 20 * Math.log10(Math.hypot(...value)));
    let last = -180;
    const phase = Float64Array.from(response, ([real, imaginary]) => {
        const lag = degrees(Math.atan2(imaginary, real));
        last = lag - 360 * Math.round((lag - last) / 360);
        return last;
    });
    const poles = polesOf(loop, true), stable = isStable(poles);
    if (!stable || gain.every(value => value < -200)) {
        const none = {gain_margin: NaN, phase_margin: NaN, delay_margin: NaN, margins: []};
        return {frequency, gain, phase, poles, stable, idle: stable, ...none};
    }
    const crossed = f => [...frequency.keys()].slice(1).filter(k =>
        f(response[k - 1]) * f(response[k]) < 0).map(k => signChange(g => f(at(g)), frequency[k - 1], frequency[k]));
    const free = z => opened.every(([x, y]) => Math.hypot(x - z, y) > AT_A_POLE);
    const ends = [[1, 0], [-1, 0.5 / period]].filter(([z]) => free(z)).map(([z, f]) => [loopAt(loop, [z, 0])[0], f]);
    const real = [...crossed(value => value[1]).map(f => [at(f)[0], f]), ...ends].filter(([value]) => value < 0);
    const gains = real.map(([value, f]) => [Math.abs(20 * Math.log10(-value)), f]);
    const phases = crossed(value => Math.hypot(...value) - 1).map(f => {
        const [x, y] = at(f), angle = Math.atan2(-y, -x);
        return [angle, f, (angle < 0 ? angle + 2 * Math.PI : angle) / (2 * Math.PI * f)];
    });
    const least = (rows, size) => rows.reduce((a, b) => size(b) < size(a) ? b : a, [Infinity, NaN, Infinity]);
    const [gainMargin, phaseCrossover] = least(gains, ([x]) => x);
    const [phaseMargin, gainCrossover] = least(phases, ([x]) => Math.abs(x));
    /* The branch of the phase nearest to -90° at the crossover. */
    const read = (column, f) => sampled([f], frequency, column)[0];
    const turns = gainCrossover ? Math.round((read(phase, gainCrossover) + 90) / 360) : 0;
    phase.forEach((lag, k) => { phase[k] = lag - 360 * turns; });
    const margins = [phaseCrossover, gainCrossover].filter(f => f > 0 && f <= highest).map(f =>
        ({frequency: f, gain: read(gain, f), phase: read(phase, f)}));
    return {frequency, gain, phase, poles, stable, margins, phaseCrossover, gainCrossover, gain_margin: gainMargin,
        phase_margin: phaseMargin, delay_margin: least(phases, row => row[2])[2]};
}

/** The linearised loop of a setting with changed parameters, and its figures; null if the actuator cannot rest. */
function loopOf(actuator, setting, changes = {}) {
    const {supply} = DATA.linear, parameters = {...setting.parameters, ...changes};
    const loop = linearised(actuator, parameters, supply ? Number(setting.get(supply)) : 0);
    return loop && {...loop, ...openLoop(loop)};
}
